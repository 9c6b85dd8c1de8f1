"""Diagnose one case: from its file to its page. The command line and the workflow both do this and no more."""

import json
import time
from collections.abc import Callable
from pathlib import Path

from fimpact.cases import inputs, read_case
from fimpact.diagnosis.experiments.next_experiment import next_experiment
from fimpact.diagnosis.pipeline import Diagnosis, diagnose
from fimpact.effects.plugins import load_effects
from fimpact.report.contents import TIMING, describe_inputs
from fimpact.report.page import reserved, write_report
from fimpact.selection.search_scope import Limits
from fimpact.support.atomic_files import check_apart, write_text


def diagnose_recording(
    case: Path | str,
    data: Path | str | None,
    folder: Path | str,
    progress: Callable[[str], None],
    effects: Path | str | None = None,
    limits: Limits | None = None,
) -> tuple[Diagnosis, Path]:
    """Read `case`, diagnose it, and write the page and all that belongs to it to `folder`.

    What differs from one time to the next, `timing.json`, is kept apart from what does not.

    Args:
        data: folder of the data files; None: the one that the case names.
        progress: receives one line at the start of each piece of work.
        effects: Python file that adds effects to the catalogue; None: there is none.
        limits: of what is asked for; None: of all.

    Returns:
        The diagnosis, and the path of its page.

    Raises:
        CaseError: the case or its data cannot be used. FileExistsError: `folder` holds files that are no report.
        ValueError: `effects` cannot be run, or adds nothing.
    """
    with reserved(Path(folder)):  # a diagnosis takes too long to be lost at its end
        return _diagnosed(case, data, folder, progress, effects, limits)


def _diagnosed(
    case: Path | str,
    data: Path | str | None,
    folder: Path | str,
    progress: Callable[[str], None],
    effects: Path | str | None,
    limits: Limits | None,
) -> tuple[Diagnosis, Path]:
    recording = read_case(case, data)
    for note in recording.notes:
        progress(f"note: {note}")
    if effects:
        progress(f"adding {', '.join(load_effects(effects))} to the catalogue")
    files = [Path(case), *inputs(case, data), *([Path(effects)] if effects else [])]
    check_apart(Path(folder), files)
    provenance = describe_inputs(files)  # of what was read, whatever becomes of it meanwhile
    begun = time.perf_counter()
    found = diagnose(recording, progress, limits=limits)
    seconds = time.perf_counter() - begun
    if len(found.members) > 1:
        progress("designing the experiment that tells the names apart")
    experiment = next_experiment(found)
    progress("writing the page")
    again = _again(case, data, effects)
    page = write_report(found, folder, experiment, provenance=provenance, again=again)
    timing = {"seconds": seconds, "seconds_with_page": time.perf_counter() - begun}
    write_text(json.dumps(timing, indent=1) + "\n", page.parent / TIMING)
    return found, page


def _again(case: Path | str, data: Path | str | None, effects: Path | str | None) -> str:
    """What the command line needs for the same case once more; not the folder: a page is the same wherever it lies."""
    return f"{case}" + (f" --data {data}" if data else "") + (f" --effects {effects}" if effects else "")
