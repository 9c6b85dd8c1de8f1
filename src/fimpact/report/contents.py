"""What a diagnosis found as plain data: everything that the page says, and what it was made of."""

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from fimpact.diagnosis.held_out import horizons_of, starts_of
from fimpact.diagnosis.pipeline import UNNAMED, Diagnosis, to_json
from fimpact.effects.fields import fields_of
from fimpact.export.improved_model import Exported, Predicted, write_model
from fimpact.export.replay import XML
from fimpact.recordings import Run
from fimpact.report.film import draw_film
from fimpact.report.numbers import short
from fimpact.simulation.horizon import MOST_WINDOWS, predict_windows
from fimpact.simulation.window_fit import Starts
from fimpact.simulation.windows import cut

DATA, FIGURES, FILM, TIMING = "diagnosis.json", "figures", "motion.gif", "timing.json"
DIGITS = 10  # significant, in the JSON: beyond them results are not reproducible
PACKAGES = ("fimpact", "mujoco", "numpy", "scipy")
SEEDS = {"random features": 0}


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
    found, recording = to_json(diagnosis), diagnosis.recording
    laws, spec = {placed.name: placed for placed in diagnosis.best.placed}, recording.spec()
    for row in found["effects"]:
        law = laws[row["name"]]
        row |= {part: getattr(law.effect, part) for part in ("equation", "sentence", "reference")}
        row["fields"] = fields_of(law.effect, spec, law.site)
    runs = recording.held_out or recording.training
    starts = diagnosis.proof.starts if diagnosis.proof else _starts_of(diagnosis, runs)
    exported = _export(diagnosis, folder, runs, starts)
    found["held_out"] |= _overall(diagnosis)
    found["model"] = {
        "files": sorted(path.relative_to(folder).as_posix() for path in exported.files),
        "difference": exported.difference,
        "refusal": exported.refusal,
        "numerics": _numerics(folder / XML) if exported.files else "",
    }
    reason = draw_film(diagnosis, runs, starts, folder / FIGURES / FILM)
    found["film"] = {"file": "" if reason else f"{FIGURES}/{FILM}", "reason": reason}
    found["alternatives"] = alternatives(diagnosis)
    return {**found, "provenance": {"versions": _versions(), **provenance}}


def _starts_of(diagnosis: Diagnosis, runs: Sequence[Run]) -> Sequence[Starts]:
    prepared = diagnosis.prepared
    return starts_of(diagnosis.recording, runs, prepared.noise, prepared.track.simulator)


def _overall(diagnosis: Diagnosis) -> dict[str, Any]:
    """The horizon by which runs are compared, s, and the errors over all held-out runs there."""
    if diagnosis.proof is None:
        return {"horizon": None, "overall": {}}
    names = [name for name in diagnosis.proof.runs[0] if name.startswith("error_")]
    every = {name: np.array([row[name] for row in diagnosis.proof.runs], float) for name in names}
    overall = {name.removeprefix("error_"): float(np.sqrt(np.mean(own**2))) for name, own in every.items()}
    horizons, own = horizons_of(diagnosis.recording)
    return {"horizon": horizons[own], "overall": overall}


def _export(diagnosis: Diagnosis, folder: Path, runs: Sequence[Run], starts: Sequence[Starts]) -> Exported:
    """Write the improved model, checked on windows of `runs`, unless it is none or held-out runs refuse it."""
    if not diagnosis.best.placed:
        return Exported([], refusal="No model is exported: no effect was added.")
    overall = _overall(diagnosis)["overall"]
    if overall and not overall["improved"] < overall["naive"]:
        return Exported([], refusal="No model is exported: it predicts held-out runs no better than the naive fit.")
    recording, simulator = diagnosis.recording, diagnosis.prepared.proving
    horizon = _overall(diagnosis)["horizon"] or 1.0
    windows = cut(runs, max(2, round(horizon / recording.period)), MOST_WINDOWS)
    predicted, states = predict_windows(simulator, diagnosis.best, windows, starts, diagnosis.prepared.noise)
    return write_model(recording, diagnosis.best, folder, diagnosis.verdict, Predicted(windows, *states, predicted))


def alternatives(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """What the recordings cannot tell from the answer: its name, its share of the belief, and how it differs."""
    total = sum(member.weight for member in diagnosis.members) + diagnosis.nameless
    own: set[str] = set()
    rows = []
    for member in diagnosis.members:
        names = {placed.name for placed in member.hypothesis.placed}
        own = own or names
        rows.append(
            {"name": member.name, "weight": member.weight / total, "without": sorted(own - names)}
            | {"with": sorted(names - own)}
        )
    if UNNAMED in diagnosis.answer_set and diagnosis.members:
        rows.append({"name": UNNAMED, "weight": diagnosis.nameless / total, "without": [], "with": []})
    return rows


def _numerics(path: Path) -> str:
    """Integrator and time step of an MJCF."""
    option = mujoco.MjModel.from_xml_path(str(path)).opt
    name = mujoco.mjtIntegrator(option.integrator).name.removeprefix("mjINT_")
    return f"{'RK4' if name == 'RK4' else name.lower()} integrator at {short(1000 * option.timestep)} ms"


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
