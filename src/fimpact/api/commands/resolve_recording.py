"""Which of the names that a diagnosis could not tell apart is left, once a further experiment is recorded."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from fimpact.cases import inputs, read_case
from fimpact.cases.errors import CaseError
from fimpact.diagnosis.experiments.resolve import Resolved, resolve
from fimpact.effects.plugins import load_effects
from fimpact.recordings import Recording, Run
from fimpact.report.contents import DATA, describe_inputs


def resolve_recording(
    case: Path | str,
    data: Path | str | None,
    folder: Path | str,
    progress: Callable[[str], None],
    effects: Path | str | None = None,
) -> tuple[list[Resolved], list[str]]:
    """Diagnose anew what the diagnosis in `folder` could not tell apart, with the runs that `case` lists since.

    Args:
        data: folder of the data files; None: the one that the case names.
        progress: receives one line at the start of each piece of work.
        effects: Python file that adds effects to the catalogue; None: there is none.

    Returns:
        What is left and what is no longer, in falling order of weight, and the names of what still cannot be told
        apart; of a diagnosis that left one name, or none, nothing and its answer.

    Raises:
        CaseError: the case or its data cannot be used, or `folder` holds no diagnosis of it.
        ValueError: `effects` cannot be run, or adds nothing.
    """
    recording = read_case(case, data)
    if effects:
        load_effects(effects)
    earlier = _earlier(Path(folder) / DATA, case)
    if len(earlier["members"]) < 2:
        return [], [earlier["answer"]]
    _check_inputs(earlier["provenance"]["inputs"], inputs(case, data), case)
    known, added = _split(recording, set(earlier["runs"]), case)
    names = ["+".join(sorted(member)) for member in earlier["members"]]
    progress(f"diagnosing anew with {', '.join(run.name for run in added)}: {', '.join(names)} could not be told apart")
    return resolve(known, added, names, progress)


def _earlier(path: Path, case: Path | str) -> dict[str, Any]:
    if not path.is_file():
        raise CaseError(f"{path} is missing; run `fimpact diagnose {case}` first, or name its folder with --out")
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if not all([found["answer"], found["runs"], found["provenance"]["inputs"]]):
            raise TypeError("a part of it is empty")
        len(found["members"])
    except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError):
        raise CaseError(f"{path} is no diagnosis of this version; run `fimpact diagnose {case}` again") from None
    return found


def _check_inputs(before: dict[str, str], files: list[Path], case: Path | str) -> None:
    """Whether what was diagnosed is still what the case names: new files may stand beside it."""
    now = describe_inputs(files)["inputs"]
    names = {Path(name).name for name in now} - {Path(case).name}  # the case itself has a run more
    changed = sorted(name for name, told in before.items() if Path(name).name in names and told not in now.values())
    if changed:
        raise CaseError(f"{changed[0]} is not the file that was diagnosed; run `fimpact diagnose {case}` again")


def _split(recording: Recording, seen: set[str], case: Path | str) -> tuple[Recording, list[Run]]:
    """The recording as it was diagnosed, and the runs that came since."""
    added = [run for run in recording.runs if run.name not in seen]
    lost = sorted(seen - {run.name for run in recording.runs})
    if lost:
        raise CaseError(f"{case} no longer has the run {lost[0]}; put it back, or run `fimpact diagnose {case}` again")
    if not added:
        raise CaseError(f"{case} has no run that was not diagnosed; list the log of the experiment under runs: first")
    if any(run.held_out for run in added):
        raise CaseError(f"{case}: the run {added[0].name} is new and held out; resolving fits it: remove held_out")
    return replace(recording, runs=tuple(run for run in recording.runs if run.name in seen)), added
