"""What `fimpact check` says of the motions of a case, before anything is fitted."""

from fimpact.diagnosis.identifiability.quick_look import look
from fimpact.diagnosis.identifiability.sentences import HEADINGS, findings_to_tell
from fimpact.recordings import Recording


def shown_by_motions(recording: Recording) -> list[str]:
    """Lines for a terminal about what the training runs' motions can show."""
    sight = look(recording)
    if isinstance(sight, str):
        return [f"what these motions can show, only `fimpact diagnose` tells: {sight}"]
    found = findings_to_tell(sight.judge.judged(), sight.judge.asked, sight)
    if not found:
        return [f"these motions show, and tell apart, all {len(sight.judge.asked)} parameters and effects asked first"]
    lines, last = [], ""
    for own in found:
        lines += [f"{HEADINGS[own.kind]}:"] if own.kind != last else []
        lines += [f"  {own.what}", *([f"    {own.motion}"] if own.motion else [])]
        last = own.kind
    return lines
