"""Diagnose one case: from its file to its page. The command line and the workflow both do this and no more."""

from collections.abc import Callable
from pathlib import Path

from fimpact.cases import inputs, read_case
from fimpact.effects.own import load_effects
from fimpact.experiment import next_experiment
from fimpact.mismatch.diagnose import Diagnosis, diagnose
from fimpact.report import check_folder, write_report
from fimpact.report_contents import describe_inputs


def diagnose_recording(
    case: Path | str,
    data: Path | str | None,
    folder: Path | str,
    progress: Callable[[str], None],
    effects: Path | str | None = None,
) -> tuple[Diagnosis, Path]:
    """Read `case`, diagnose it, and write the page and all that belongs to it to `folder`.

    Args:
        data: folder of the data files; None: the one that the case names.
        progress: receives one line at the start of each piece of work.
        effects: Python file that adds effects to the catalogue; None: there is none.

    Returns:
        The diagnosis, and the path of its page.

    Raises:
        CaseError: the case or its data cannot be used. FileExistsError: `folder` holds files that are no report.
        ValueError: `effects` cannot be run, or adds nothing.
    """
    check_folder(Path(folder))  # a diagnosis takes too long to be lost at its end
    recording = read_case(case, data)
    if effects:
        progress(f"adding {', '.join(load_effects(effects))} to the catalogue")
    files = [Path(case), *inputs(case, data), *([Path(effects)] if effects else [])]
    provenance = describe_inputs(files)  # of what was read, whatever becomes of it meanwhile
    found = diagnose(recording, progress)
    if len(found.naming.contenders) > 1:
        progress("designing the experiment that tells the names apart")
    experiment = next_experiment(found)
    progress("writing the page")
    return found, write_report(found, folder, experiment, provenance=provenance)
