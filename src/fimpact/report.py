"""The page: what a diagnosis found, for someone who has a minute. One HTML file, without a network or a script."""

import base64
import hashlib
import json
import os
import platform
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import matplotlib.pyplot as plt
import mujoco
import numpy as np
from markupsafe import Markup

from fimpact.effects.base import words
from fimpact.experiment import COMMANDS, START, commands, described, write_experiment
from fimpact.film import draw_film
from fimpact.mismatch.diagnose import Diagnosis, parameter_rows, to_json
from fimpact.mismatch.discriminate import Experiment
from fimpact.mismatch.explain import Explanation
from fimpact.mismatch.mjcf import ASSETS
from fimpact.mismatch.model import CALLBACK, XML, write_model
from fimpact.mismatch.per_run import error_per_run, floor_per_run, unit_of
from fimpact.mismatch.shape import shapes
from fimpact.report_figures import pictures, shown_run
from fimpact.report_look import draw, inline, store
from fimpact.units import channel_unit

PAGE, DATA, FIGURES, FILM = "report.html", "diagnosis.json", "figures", "motion.gif"
OURS = {PAGE, DATA, FIGURES, XML, CALLBACK, ASSETS, COMMANDS, START}
DIGITS = 10  # significant, in the JSON: beyond them results are not reproducible
SHAPES = 3  # of an unnamed force that are told
PACKAGES = ("fimpact", "mujoco", "numpy", "scipy")
SEEDS = {"joint draws of scores": 0, "bootstrap": 0}


def describe_inputs(paths: Iterable[Path | str]) -> dict[str, Any]:
    """Provenance of a diagnosis: sha256 of its input files, versions and seeds."""
    files = list(dict.fromkeys(Path(path) for path in paths))
    names = [path.name for path in files]
    hashes = {  # by name, and where several have one, by path
        path.name if names.count(path.name) == 1 else path.as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
    }
    return {"inputs": hashes, "versions": _versions(), "seeds": SEEDS}


def write_report(
    diagnosis: Diagnosis, folder: Path | str, experiment: Experiment | None = None, *, provenance: Mapping[str, Any]
) -> Path:
    """Write the page, `diagnosis.json`, the figures, the improved model and the next experiment to `folder`, all or
    nothing.

    Args:
        folder: made, or replaced if it holds nothing but an earlier report.
        experiment: what would tell the answer's members apart, if there are several.
        provenance: groups of named values, such as "inputs" (file -> sha256), "versions" and "seeds".

    Returns:
        Path of the page.

    Raises:
        FileExistsError: `folder` holds files that are no part of a report.
    """
    folder = Path(folder)
    check_folder(folder)
    folder.absolute().parent.mkdir(parents=True, exist_ok=True)
    building = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.absolute().parent))
    try:
        _fill(diagnosis, building, experiment, provenance)
        building.chmod(0o755)
        _swap(building, folder)
    finally:
        shutil.rmtree(building, ignore_errors=True)
    return folder / PAGE


def check_folder(folder: Path) -> None:
    """Whether a report may be written to `folder`, which need not exist yet.

    Raises:
        FileExistsError: it holds files that are no part of a report. PermissionError: nothing can be written there.
    """
    strange = sorted(p.name for p in folder.iterdir() if p.name not in OURS) if folder.is_dir() else []
    if strange or folder.is_file():
        raise FileExistsError(f"{folder} holds {strange or 'a file'}, no report of ours; choose another folder")
    above = next(parent for parent in folder.absolute().parents if parent.exists())
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


def _fill(diagnosis: Diagnosis, folder: Path, experiment: Experiment | None, provenance: Mapping[str, Any]) -> None:
    content, drawn = contents(diagnosis, folder, provenance), pictures(diagnosis)
    content["experiment"] = described(diagnosis, experiment) if experiment else None
    if experiment and content["experiment"]["files"]:
        write_experiment(diagnosis, experiment, folder)
        drawn |= {"experiment": draw(commands, diagnosis, experiment)} if experiment.ctrl.shape[1] else {}
    (folder / DATA).write_text(to_text(content), encoding="utf-8")
    for name, figure in drawn.items():
        store(figure, folder / FIGURES / name)
    images = {"experiment": ""} | {name: inline(figure, name) for name, figure in drawn.items()}
    images["film"] = _embedded(folder / content["film"]["file"]) if content["film"]["file"] else ""
    for figure in drawn.values():
        plt.close(figure)
    (folder / PAGE).write_text(_page(diagnosis, content, images), encoding="utf-8")


def _embedded(path: Path) -> str:
    code = base64.b64encode(path.read_bytes()).decode()
    return f'<img alt="Recorded, naive and improved motion side by side" src="data:image/gif;base64,{code}">'


def contents(diagnosis: Diagnosis, folder: Path, provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Everything on the page in plain types; writes the film to `folder`, and the improved model if held-out
    data bear it out."""
    written = write_model(diagnosis, folder)
    exported = {
        "files": sorted(path.relative_to(folder).as_posix() for path in written.files),
        "difference": written.difference,
        "refusal": written.refusal,
        "numerics": _numerics(folder / XML) if written.files else "",
    }
    effects = [
        {"name": p.name, "equation": p.effect.equation, "sentence": p.effect.sentence, "reference": p.effect.reference}
        for member in {m.name: m for m in (diagnosis.naming.best, *diagnosis.naming.members)}.values()
        for p in member.placed
    ]
    found = {"model": exported, "effects": effects, "alike": alike(diagnosis), "shapes": _shapes(diagnosis)}
    found |= {"held_out": held_out(diagnosis), "film": _film(diagnosis, folder)}
    return {**to_json(diagnosis), **found, "provenance": {"versions": _versions(), **provenance}}


def _film(diagnosis: Diagnosis, folder: Path) -> dict[str, Any]:
    reason = draw_film(diagnosis, folder / FIGURES / FILM)
    return {"file": "" if reason else f"{FIGURES}/{FILM}", "reason": reason}


def held_out(diagnosis: Diagnosis) -> dict[str, Any]:
    """Error of every held-out run under the naive and the improved model, with its noise floor and the one unit."""
    made, naming = diagnosis.bench, diagnosis.naming
    naive, improved = (error_per_run(made, explanation.judged) for explanation in (naming.naive, naming.best))
    floor = floor_per_run(made)
    rows = [
        {"run": run, "error_naive": naive[run], "error_improved": improved[run], "noise_floor": floor[run]}
        for run in naive
    ]
    return {"unit": unit_of(made), "runs": rows}


def _shapes(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """For a force without a name: what it depends on, most telling first."""
    told = shapes(diagnosis.location)[:SHAPES] if diagnosis.answer == "unnamed" else []
    return [{k: getattr(shape, k) for k in ("dof", "regressor", "explained", "equation")} for shape in told]


def _numerics(path: Path) -> str:
    """Integrator and time step of an MJCF."""
    option = mujoco.MjModel.from_xml_path(str(path)).opt
    name = mujoco.mjtIntegrator(option.integrator).name.removeprefix("mjINT_")
    return f"{'RK4' if name == 'RK4' else name.lower()} integrator at {short(1000 * option.timestep)} ms"


def alike(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """The answer's members: name, weight, and the cosine between their projected sensitivity and the best one's."""
    naming = diagnosis.naming
    columns = {c.placed.name: c.column for step in reversed(naming.steps) for c in step.screened}
    best = columns.get(_newest(naming.best))
    rows = []
    for member in naming.members:
        own = columns.get(_newest(member))
        known = best is not None and own is not None
        cosine = (best * own).sum() / np.sqrt((best**2).sum() * (own**2).sum()) if known else None
        rows.append({"name": member.name, "weight": member.weight, "cosine": None if cosine is None else float(cosine)})
    return rows


def _newest(explanation: Explanation) -> str:
    """The effect that distinguishes an explanation from its rivals of the same step: the last one added."""
    return explanation.placed[-1].name if explanation.placed else ""


def to_text(content: Mapping[str, Any]) -> str:
    """JSON of `content`: keys sorted, floats to ten significant digits, no NaN: the same bytes each time."""
    return json.dumps(_plain(content), sort_keys=True, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None
    if isinstance(value, np.generic):
        return value.item()
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def _page(diagnosis: Diagnosis, content: Mapping[str, Any], images: Mapping[str, str]) -> str:
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    environment.filters |= {"short": short, "pair": pair, "words": words, "percent": _percent}
    template = environment.from_string(files("fimpact").joinpath("report.html.jinja").read_text(encoding="utf-8"))
    simulator, windows = diagnosis.bench.training.simulator, diagnosis.bench.held_out.windows
    recording, naming = diagnosis.recording, diagnosis.naming
    return template.render(
        c=content,
        images={name: Markup(svg) for name, svg in images.items()},
        rows=parameter_rows(naming, recording),
        best=naming.best.placed,
        withheld=not diagnosis.evidence.white,
        widened=naming.widened,
        run=windows.names[shown_run(diagnosis)],
        runs=(len(recording.training), len(recording.held_out)),
        units={channel: channel_unit(simulator.base, channel) for channel in recording.channels},
        candidates=len(naming.steps[0].screened) if naming.steps else 0,
        window=recording.window,
    )


def short(value: float | None, digits: int = 3) -> str:
    """A number for a reader: three digits, a true minus, a power of ten where it has to be."""
    if value is None or not np.isfinite(value):
        return "–"
    mantissa, mark, exponent = f"{value:.{digits}g}".partition("e")
    return (mantissa + (_power(int(exponent)) if mark else "")).replace("-", "−")


def _power(exponent: int) -> str:
    return "×10" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def pair(value: float, half: float) -> str:
    """A value and its interval's half width, to the digits that the width supports."""
    if not (np.isfinite(half) and half > 0):
        return short(value)
    if half >= abs(value) * 1e3:
        return f"{short(value)} ± {short(half, 2)}"
    power = int(np.floor(np.log10(max(abs(value), half))))
    scale = power if not -3 <= power <= 4 else 0
    digits = max(0, scale - int(np.floor(np.log10(half))) + 1)
    body = f"{value / 10.0**scale:.{digits}f} ± {half / 10.0**scale:.{digits}f}".replace("-", "−")
    return f"({body}){_power(scale)}" if scale else body


def _percent(value: float | None, digits: int = 0) -> str:
    return "–" if value is None else f"{100 * value:.{digits}f} %".replace("-", "−")
