"""What a diagnosis found as plain data: everything that the page says, and what it was made of."""

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from fimpact.film import draw_film
from fimpact.mismatch.diagnose import Diagnosis, to_json
from fimpact.mismatch.explain import Explanation
from fimpact.mismatch.export import XML
from fimpact.mismatch.model import write_model
from fimpact.mismatch.per_run import error_per_run, floor_per_run, unit_of
from fimpact.mismatch.shape import shapes
from fimpact.report_numbers import short

DATA, FIGURES, FILM = "diagnosis.json", "figures", "motion.gif"
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
