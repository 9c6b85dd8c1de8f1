"""Tools that others would enter, on the same recordings and judged at the same bounds; none of them is told more.

- least squares per joint with all terms, as identification toolboxes do: inverse dynamics along the measured motion, on
  friction, rotor and offset at once; named is what its standard deviation tells by a factor of three;
- sparse regression of the same residual on a library of functions, thresholded again and again;
- `mujoco.sysid` with everything freed: friction, damping and armature of every joint beside the case's unknowns;
- a black box, which names nothing.
"""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from fimpact.benchmark.archive import load_recording
from fimpact.benchmark.comparators.free_parameters import freed_knobs
from fimpact.benchmark.comparators.toolboxes import black_box, fit_sysid, require_sysid
from fimpact.benchmark.jsonl import Report, each, held_out_error
from fimpact.diagnosis.freed_model import OF_JOINTS, freed
from fimpact.diagnosis.held_out import prove
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.effects.sites import driven
from fimpact.effects.wiring import drives
from fimpact.recordings import Recording
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.smoothing.prepare import Prepared, prepare

NONE = "none"
KNOWN = 1 / 3  # relative standard deviation below which a term of least squares counts, as is usual
SMALL = 0.03  # of what the motor gives: a sparse term that is worth less is dropped
PASSES = 10  # of thresholding
GROWN = 0.2  # typical sizes by which a freed parameter has to grow to be named
FREED = dict(zip(OF_JOINTS, ("viscous", "coulomb", "rotor_inertia"), strict=True))
TERMS = {  # effect: its value's name, whether it is at the motor, the function of (speed, acceleration, position)
    "coulomb": ("friction", False, lambda v, a, q: -np.sign(v)),
    "viscous": ("damping", False, lambda v, a, q: -v),
    "rotor_inertia": ("inertia", False, lambda v, a, q: -a),
    "torque_offset": ("offset", True, lambda v, a, q: np.ones_like(v)),
    "quadratic_damping": ("damping", False, lambda v, a, q: -np.abs(v) * v),
    "hardening_spring": ("cubic", False, lambda v, a, q: -(q**3)),
}
ALL_TERMS = tuple(TERMS)[:4]
SIGNED = ("torque_offset",)


def enter_part(recordings: Path, chosen: Sequence[str], report: Report) -> list[dict[str, Any]]:
    """A row for every tool and each of the `chosen` cases in the folder `recordings`.

    Raises:
        ValueError: mujoco.sysid is not installed.
    """
    if chosen:
        require_sysid()
    entries = {f"{case}: {tool}": {"tool": tool, "of": case} for case in chosen for tool in TOOLS}

    def work(name: str) -> dict[str, Any]:
        entry = entries[name]
        return enter(load_recording(recordings, entry["of"]), entry["tool"])

    return [row | entries[row["case"]] for row in each(entries, work, report)]


def enter(recording: Recording, tool: str) -> dict[str, Any]:
    """What one of `TOOLS` answers: ``answer``, ``sizes``, ``heldout_after`` and ``seconds``."""
    since = time.perf_counter()
    prepared, hypothesis, sizes = TOOLS[tool](recording)
    proof = prove(prepared, {"tool": (prepared.proving, hypothesis)}, own_only=True)
    return {
        "answer": ";".join(sorted(sizes)) or NONE,
        "sizes": sizes,
        "heldout_after": held_out_error(proof.runs, "tool") if proof else None,
        "seconds": time.perf_counter() - since,
    }


Found = tuple[Prepared, Hypothesis, dict[str, float]]


def _least_squares(recording: Recording) -> Found:
    return _regressed(recording, _all_terms)


def _sparse(recording: Recording) -> Found:
    return _regressed(recording, _thresholded)


def _regressed(recording: Recording, fit: Callable) -> Found:
    """Terms at every driven joint, by a `fit` of (motion, residual, applied) there."""
    prepared = prepare(recording)
    model, placed = prepared.track.model, []
    motion, residual, applied = _inverse_dynamics(prepared)
    for joint in driven(model):
        dof = model.joint(joint).dofadr[0]
        found = fit([own[:, dof] for own in motion], residual[:, dof], np.sqrt(np.mean(applied[:, dof] ** 2)))
        placed += [_placed(model, joint, name, value) for name, value in found.items() if name in SIGNED or value > 0]
    sizes = {own.name: float(next(iter(own.values.values()))) for own in placed}
    return prepared, Hypothesis(prepared.track.simulator.theta, tuple(placed)), sizes


def _placed(model: mujoco.MjModel, joint: str, name: str, value: float) -> Placed:
    key, at_motor, _ = TERMS[name]
    site = model.actuator(drives(model, joint)[0]).name if at_motor else joint
    return Placed(EFFECTS[name], site, {key: float(value)})


def _inverse_dynamics(prepared: Prepared) -> tuple[tuple[np.ndarray, ...], np.ndarray, np.ndarray]:
    """Speeds, accelerations and positions along the measured motion, (N, nv) each, the force that the naive model lacks
    there, and what its motors give, (N, nv), N or N m."""
    track, begun = prepared.track, prepared.begun
    inside, data = np.flatnonzero(~track.last), mujoco.MjData(track.model)
    speed = (begun.qvel[inside + 1] + begun.qvel[inside]) / 2
    acceleration = (begun.qvel[inside + 1] - begun.qvel[inside]) / track.period
    lacking, applied = np.empty_like(speed), np.empty_like(speed)
    for row, k in enumerate(inside):
        data.qpos[:], data.qvel[:], data.ctrl[:] = begun.qpos[k], speed[row], track.ctrl[k, 0]
        mujoco.mj_forward(track.model, data)
        applied[row], data.qacc[:] = data.qfrc_actuator, acceleration[row]
        mujoco.mj_inverse(track.model, data)
        lacking[row] = data.qfrc_inverse - applied[row]
    return (speed, acceleration, begun.qpos[inside][:, : speed.shape[1]]), lacking, applied


def _columns(names: Sequence[str], motion: Sequence[np.ndarray]) -> np.ndarray:
    return np.stack([TERMS[name][2](*motion) for name in names], axis=1)


def _all_terms(motion, residual, applied) -> dict[str, float]:
    """Least squares on all terms at once; what is known to a third is kept."""
    columns = _columns(ALL_TERMS, motion)
    gram = np.linalg.pinv(columns.T @ columns)
    values = gram @ columns.T @ residual
    left = residual - columns @ values
    sd = np.sqrt(np.diag(gram) * (left @ left) / max(len(left) - len(values), 1))
    return {name: value for name, value, own in zip(ALL_TERMS, values, sd, strict=True) if own < KNOWN * abs(value)}


def _thresholded(motion, residual, applied) -> dict[str, float]:
    """Least squares on the library without the terms that are worth little, until none is dropped."""
    names = list(TERMS)
    for _ in range(PASSES):
        columns = _columns(names, motion)
        values = np.linalg.lstsq(columns, residual, rcond=None)[0]
        worth = np.abs(values) * np.sqrt(np.mean(columns**2, axis=0))
        kept = [name for name, own in zip(names, worth, strict=True) if own > SMALL * applied]
        if kept == names or not kept:
            break
        names = kept
    return dict(zip(names, values, strict=True)) if kept else {}


def _freed(recording: Recording) -> Found:
    more = freed(recording)
    prepared = prepare(more)
    knobs = freed_knobs(prepared)
    _, theta = fit_sysid(prepared, knobs)
    grown = (theta - np.where(np.isfinite(knobs.sd), knobs.mean, prepared.track.simulator.theta)) / knobs.scale
    extra = more.unknowns[len(recording.unknowns) :]
    rows = zip(extra, theta[-len(extra) :], grown[-len(extra) :], strict=True) if extra else ()
    sizes = {f"{FREED[u.field]}@{u.site}": float(v) for u, v, g in rows if u.field in FREED and g > GROWN}
    return prepared, Hypothesis(theta), sizes


def _black_box(recording: Recording) -> Found:
    prepared = prepare(recording)
    return prepared, black_box(prepared.naive), {}


TOOLS = {
    "least squares, all terms": _least_squares,
    "sparse regression": _sparse,
    "mujoco.sysid, everything freed": _freed,
    "black box": _black_box,
}
