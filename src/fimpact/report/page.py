"""The page: what a diagnosis found, for someone who has a minute. One HTML file, without a network or a script."""

import base64
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import matplotlib.pyplot as plt
from markupsafe import Markup

from fimpact.diagnosis.experiments.next_experiment import COMMANDS, START, described, write_experiment
from fimpact.diagnosis.experiments.separating import Experiment
from fimpact.diagnosis.identifiability.sentences import HEADINGS
from fimpact.diagnosis.pipeline import Diagnosis
from fimpact.diagnosis.track_record import track_record
from fimpact.effects.base import words
from fimpact.effects.fields import SIMULATORS
from fimpact.export.mjcf import ASSETS
from fimpact.export.replay import CALLBACK, XML
from fimpact.report.contents import DATA, FIGURES, TIMING, contents, to_text
from fimpact.report.experiment_picture import commands
from fimpact.report.figures import pictures
from fimpact.report.look import draw, inline, store
from fimpact.report.numbers import estimate, pair, percent, short
from fimpact.support.atomic_files import draft_folder, made

PAGE = "report.html"
OURS = {PAGE, DATA, FIGURES, XML, CALLBACK, ASSETS, COMMANDS, START, TIMING}


def write_report(
    diagnosis: Diagnosis,
    folder: Path | str,
    experiment: Experiment | None = None,
    *,
    provenance: Mapping[str, Any],
    again: str = "case.yaml",
) -> Path:
    """Write the page, `diagnosis.json`, the figures, the improved model and the next experiment to `folder`, all or
    nothing.

    Args:
        folder: made, or replaced if it holds nothing but an earlier report.
        experiment: what would tell the answer's members apart, if there are several.
        provenance: groups of named values, such as "inputs" (file -> sha256), "versions" and "seeds".
        again: what the command line was given, so that the page can say what to run next.

    Returns:
        Path of the page.

    Raises:
        FileExistsError: `folder` holds files that are no part of a report.
    """
    folder = Path(folder).resolve()
    with reserved(folder) as building:
        _fill(diagnosis, building, experiment, provenance, again)
        building.chmod(0o755)
        _swap(building, folder)
    return folder / PAGE


@contextmanager
def reserved(folder: Path) -> Iterator[Path]:
    """Make the folder beside `folder` in which a report is made, and whatever folders are above; all of them are gone
    again if it fails, and of a process that was killed with the next one.

    Raises:
        FileExistsError: `folder` holds files that are no report. PermissionError: nothing can be written there.
    """
    check_folder(folder)
    folder = folder.resolve()
    with ExitStack() as stack:
        try:
            stack.enter_context(made(folder.parent))
            building = stack.enter_context(draft_folder(folder.parent, f".{folder.name}-draft-"))
        except OSError as error:
            raise PermissionError(f"{folder} cannot be made ({error.strerror}); choose another with --out") from None
        yield building


def check_folder(folder: Path) -> None:
    """Whether a report may be written to `folder`, which need not exist yet.

    Raises:
        FileExistsError: it holds files that are no part of a report. PermissionError: nothing can be written there.
    """
    strange = sorted(p.name for p in folder.iterdir() if p.name not in OURS) if folder.is_dir() else []
    if strange or (folder.exists() and not folder.is_dir()):
        what = f"holds {', '.join(strange[:6])}" if strange else "is no folder"
        raise FileExistsError(f"{folder} {what}, no report of ours; choose another folder with --out")
    if Path.cwd().is_relative_to(folder.resolve()):
        raise PermissionError(f"{folder} is where this runs and cannot be replaced; choose a folder in it with --out")
    above = next(parent for parent in folder.resolve().parents if parent.exists())
    if folder.is_mount() or not (above.is_dir() and os.access(above, os.W_OK | os.X_OK)):
        raise PermissionError(f"{folder} cannot be written or replaced; choose another folder with --out")


def _swap(building: Path, folder: Path) -> None:
    old = building.with_name(f"{building.name}-old")
    if folder.exists():
        os.rename(folder, old)
    try:
        os.rename(building, folder)
    except OSError:
        if old.exists():
            os.rename(old, folder)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _fill(
    diagnosis: Diagnosis, folder: Path, experiment: Experiment | None, provenance: Mapping[str, Any], again: str
) -> None:
    content = contents(diagnosis, folder, provenance)
    drawn = pictures(content)
    content["experiment"] = described(diagnosis, experiment) if experiment else None
    if experiment and content["experiment"]["files"]:
        write_experiment(diagnosis, experiment, folder)
        drawn |= {"experiment": draw(commands, diagnosis, experiment)} if experiment.ctrl.shape[1] else {}
    (folder / DATA).write_text(to_text(content), encoding="utf-8")
    images = dict.fromkeys(("horizon", "force", "film", "experiment"), "")
    for name, figure in drawn.items():
        store(figure, folder / FIGURES / name)
        images[name] = inline(figure, name)
        plt.close(figure)
    if content["film"]["file"]:
        images["film"] = _embedded(folder / content["film"]["file"])
    (folder / PAGE).write_text(_page(diagnosis, content, images, again), encoding="utf-8")


def _embedded(path: Path) -> str:
    code = base64.b64encode(path.read_bytes()).decode()
    return f'<img alt="Recorded, naive and improved motion side by side" src="data:image/gif;base64,{code}">'


def _page(diagnosis: Diagnosis, content: Mapping[str, Any], images: Mapping[str, str], again: str) -> str:
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    environment.filters |= {"short": short, "pair": pair, "estimate": estimate, "words": words, "percent": percent}
    template = environment.from_string(files("fimpact.report").joinpath("page.html.jinja").read_text(encoding="utf-8"))
    recording = diagnosis.recording
    return template.render(
        c=content,
        images={name: Markup(svg) for name, svg in images.items()},
        names=(("naive", "naive fit"), ("freed", "everything freed"), ("improved", "improved")),
        laws=list({row["effect"]: row for row in content["effects"]}.values()),
        fields=_fields(content["effects"]),
        simulators=SIMULATORS,
        unshown={kind: heading[:1].upper() + heading[1:] for kind, heading in HEADINGS.items()},
        again=again,
        record=track_record(diagnosis),
        runs=(len(recording.training), len(recording.held_out)),
        tried=len(diagnosis.explanation.rounds[0].tried) if diagnosis.explanation.rounds else 0,
    )


def _fields(effects: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, dict[str, str]]]:
    """Effects whose fields are the same, in one row: name, places and the field of each simulator."""
    rows: dict[tuple[str, ...], list[str]] = {}
    for row in effects:
        rows.setdefault((row["effect"], *row["fields"].values()), []).append(row["site"])
    return [(name, ", ".join(at), dict(zip(SIMULATORS, texts, strict=True))) for (name, *texts), at in rows.items()]
