"""What the naive model would do in the recorded states, against what was recorded.

A naive model is wrong, that is the point of recording; but no missing physics makes it right again when one column is
read in degrees, 1000 times smaller, reversed, or exchanged with another. So each such reading is tried, and believed
only if the model fails as declared and agrees after it.
"""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import lsq_linear
from scipy.signal import savgol_coeffs

from fimpact.cases import kinds
from fimpact.cases.channels import Channel
from fimpact.cases.misreadings import Reading, States, read, readings
from fimpact.cases.start import position_columns
from fimpact.recordings import Recording

SAMPLES = 400  # states that are compared
CAPS = (60, 98)  # percentiles of acceleration up to which samples weigh in full; the better counts
FRICTION = 10.0  # friction decelerates at most this many times as strongly as recorded
NEAR = 0.1  # of the size of a geom: so close to another it may touch in reality
FEWEST = 20  # of them that touch nothing
SMOOTHERS = (7, 15, 45)  # samples of the local parabola; that in which the model agrees best counts
SCALE = 4.0  # masses of a naive model may be this much off
TERMS = (1 / SCALE, 1 / SCALE, 0.0), (SCALE, SCALE, SCALE)  # of what position, commands and speed do
POOR, GOOD, BETTER = 0.25, 0.25, 0.4  # unexplained share: as declared at least, after at most, ratio of the two


def derivative(values: np.ndarray, period: float, order: int, width: int = 9) -> np.ndarray:
    """Derivative (T,) by a local parabola; NaN at the ends and beside missing samples."""
    out = np.full(len(values), np.nan)
    if len(values) >= width:
        kernel = savgol_coeffs(width, 2, deriv=order, delta=period)
        out[width // 2 : len(values) - width // 2] = np.convolve(values, kernel, "valid")
    return out


@dataclass(frozen=True)
class Motion:
    """States in which the model is asked: for each width of `SMOOTHERS`, positions, speeds, accelerations, commands.

    joints: degrees of freedom of each joint that are compared as one.
    """

    model: mujoco.MjModel
    states: tuple[States, ...]
    joints: tuple[np.ndarray, ...]

    @staticmethod
    def of(recording: Recording, model: mujoco.MjModel, seen: list[Channel]) -> "Motion | None":
        """States of all runs, or None where the position of a joint is not measured or too few are left."""
        columns = position_columns(model, seen)
        if len(columns) < model.njnt or not model.njnt:
            return None
        states = [_states(recording, model, columns, width) for width in SMOOTHERS]
        states = [one for one in states if len(one[0]) >= FEWEST]
        return Motion(model, tuple(states), _compared_dofs(model)) if states else None


def _compared_dofs(model: mujoco.MjModel) -> tuple[np.ndarray, ...]:
    # Of a free joint only the translation: its rotation needs no force to be read right.
    both = zip(model.jnt_type, model.jnt_dofadr, strict=True)
    return tuple(np.arange(3 if kind == kinds.FREE else 1) + first for kind, first in both)


def _states(recording: Recording, model: mujoco.MjModel, columns: dict, width: int):
    parts = [_run_states(run, model, columns, width, recording.period) for run in recording.runs]
    joined = [np.concatenate(both) for both in zip(*parts, strict=True)]
    known = np.flatnonzero(np.isfinite(np.column_stack(joined)).all(axis=1))
    chosen = known[np.unique(np.linspace(0, len(known) - 1, SAMPLES).astype(int))] if len(known) else known
    return tuple(values[chosen] for values in joined)


def _run_states(run, model: mujoco.MjModel, columns: dict, width: int, period: float):
    count = len(run.measured)
    q, v, a = np.zeros((count, model.nq)), np.zeros((count, model.nv)), np.zeros((count, model.nv))
    for joint, place in columns.items():
        at, dof = model.joint(joint).qposadr[0], model.joint(joint).dofadr[0]
        q[:, at : at + len(place)] = run.measured[:, place]
        for i, column in enumerate(place[:3]):
            values = run.measured[:, column]
            q[:, at + i] = derivative(values, period, 0, width)
            v[:, dof + i], a[:, dof + i] = (derivative(values, period, order, width) for order in (1, 2))
    ctrl = np.column_stack([derivative(c, period, 0, width) for c in run.ctrl.T]) if model.nu else run.ctrl
    return q, v, a, ctrl


def doubts(motion: Motion) -> Iterator[tuple[str, str]]:
    """The reading under which the naive model agrees far better, if there is one: its kind, and one line."""
    declared = unexplained(motion, Reading("as declared", ""))
    if declared < POOR:
        return
    tried = sorted(
        ((unexplained(motion, one), i, one) for i, one in enumerate(readings(motion.model))), key=lambda t: t[:2]
    )
    best = [(error, one) for error, _, one in tried if error < GOOD and error < BETTER * declared]
    if best:
        causes = dict.fromkeys(one.cause for error, one in best if error < best[0][0] + 0.02)
        yield (
            best[0][1].doubt,
            f"the naive model explains {max(0.0, 1 - declared):.0%} of the recorded acceleration as declared, but "
            f"{1 - best[0][0]:.0%} if {' or '.join(list(causes)[:3])}; correct the case",
        )


def unexplained(motion: Motion, reading: Reading) -> float:
    """Share of the recorded acceleration that the naive model does not explain when columns are read so, 0 to 1."""
    return min(_error(motion, read(motion.model, state, reading)) for state in motion.states)


def _error(motion: Motion, state) -> float:
    terms, free = _terms(motion.model, *state)
    if free.sum() < FEWEST:
        return 1.0
    recorded, speed = state[2][free], state[1][free]
    power = [np.sum(recorded[:, dofs] ** 2) for dofs in motion.joints]
    moving = [dofs for dofs, size in zip(motion.joints, power, strict=True) if size > 1e-9 * max(power) > 0]
    both = [(recorded[:, dofs], [term[free][:, dofs] for term in terms], speed[:, dofs]) for dofs in moving]
    return min((float(np.mean([_left(*one, cap) for one in both])) for cap in CAPS if both), default=1.0)


def _left(recorded: np.ndarray, terms: list[np.ndarray], speed: np.ndarray, cap: float) -> float:
    """Share of `recorded` (n, k), beyond what friction alone explains, that the model's terms do not explain.

    Each term may be `SCALE` times larger or smaller, because inertias are guesses, and friction may help. Beyond
    the percentile `cap` an impact weighs no more: one that comes a sample early would hide everything else.
    """
    size = np.linalg.norm(recorded, axis=1)
    weight = np.minimum(1.0, 2 * np.percentile(size, cap) / np.maximum(size, 1e-300))[:, None]
    target = (weight * recorded).ravel()
    friction = [(weight * column).ravel() for column in (speed, np.sign(speed))]
    friction = [
        (-column, 0.0, FRICTION * np.linalg.norm(target) / np.linalg.norm(column))
        for column in friction
        if column.any()
    ]
    columns = [((weight * term).ravel(), low, high) for term, low, high in zip(terms, *TERMS, strict=True)]
    alone = _cost(target, friction)
    return min(1.0, _cost(target, [one for one in columns if one[0].any()] + friction) / alone) if alone else 1.0


def _cost(target: np.ndarray, columns: list[tuple[np.ndarray, float, float]]) -> float:
    if not columns or not target.any():
        return float(np.sum(target**2))
    # In units of the target, for the solver's sake.
    unit = np.linalg.norm(target)
    sizes = [np.linalg.norm(column) / unit for column, _, _ in columns]
    matrix = np.column_stack([column / size for (column, _, _), size in zip(columns, sizes, strict=True)]) / unit
    lows, highs = ([bounds[i] * size for bounds, size in zip(columns, sizes, strict=True)] for i in (1, 2))
    return float(2 * lsq_linear(matrix, target / unit, (lows, highs), method="bvls").cost * unit**2)


def _terms(model: mujoco.MjModel, q: np.ndarray, v: np.ndarray, a: np.ndarray, ctrl: np.ndarray):
    """Accelerations (n, nv) by position, by commands and by speed in each state, and where nothing touches (n,)."""
    still, driven, whole = np.zeros_like(v), np.zeros_like(v), np.zeros_like(v)
    model = _wary(model)
    data, free = mujoco.MjData(model), np.ones(len(q), bool)
    for row in range(len(q)):
        for out, speed, command in ((still, 0, 0), (driven, 0, ctrl[row]), (whole, v[row], ctrl[row])):
            data.qpos[:], data.qvel[:], data.ctrl[:] = q[row], speed, command
            mujoco.mj_forward(model, data)
            out[row] = data.qacc
        free[row] = data.ncon == 0
    terms = still, driven - still, whole - driven
    return terms, free & np.isfinite(whole).all(axis=1)


def _wary(model: mujoco.MjModel) -> mujoco.MjModel:
    """The same model, which reports contacts before they exert a force: real surfaces are some millimetres off."""
    model, sizes = copy(model), model.geom_rbound[model.geom_rbound > 0]
    near = NEAR * float(np.median(sizes)) if sizes.size else 0.0
    for margin, gap in ((model.geom_margin, model.geom_gap), (model.pair_margin, model.pair_gap)):
        margin += near
        gap += near
    return model
