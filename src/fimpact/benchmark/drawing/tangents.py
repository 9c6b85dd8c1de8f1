"""Tangents of a rig's windows: what starts, unknowns, clocks and unit forces do to the samples, by differences."""

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout

from fimpact.benchmark.drawing.motions import Motion
from fimpact.benchmark.planting.ground_truth import DRIVEN, FULL, new_world
from fimpact.benchmark.rigs.rig import CLOCK, Rig

PIECES = 5  # in which a window's disturbance is described


@dataclass(frozen=True)
class Windows:
    """Starts (W, 2 nv) and commands (W, n, nu) of windows; row in `states` and first sample of each, (W,)."""

    start: np.ndarray
    ctrl: np.ndarray
    row: np.ndarray
    first: np.ndarray


@dataclass(frozen=True)
class Tangents:
    """Whitened sensitivities of the windows, (W, n ny, columns): to starts, unknowns, the clock of each run in units of
    `CLOCK`, and unit disturbance. opens: whether a window opens its run, where alone the start is known, (W,)."""

    opens: np.ndarray
    start: np.ndarray
    unknown: np.ndarray
    clock: np.ndarray
    push: np.ndarray | None = None


def cut(rig: Rig, motion: Motion, states: np.ndarray, runs: np.ndarray) -> Windows:
    """Windows of the runs numbered `runs`, starting on `states` (runs, T, 2 nv)."""
    length = round(rig.window / rig.period) or rig.samples
    first = np.arange(0, rig.samples - length + 1, length)
    row, run, first = (
        np.repeat(np.arange(len(runs)), len(first)),
        np.repeat(runs, len(first)),
        np.tile(first, len(runs)),
    )
    ctrl = np.stack([motion.ctrl[r, f : f + length] for r, f in zip(run, first, strict=True)])
    return Windows(states[row, first], ctrl, row, first)


def gather(windows: Windows, samples: np.ndarray) -> np.ndarray:
    """The windows of an array of runs, (runs, T, ...) -> (W, n, ...)."""
    length = windows.ctrl.shape[1]
    return np.stack([samples[r, f : f + length] for r, f in zip(windows.row, windows.first, strict=True)])


def models(rig: Rig, errors: np.ndarray) -> mujoco.MjModel:
    """Coarse naive model whose unknowns are off by `errors` (p,)."""
    return new_world(rig, errors, fine=False).spec.compile()


def predict(rig: Rig, model, start: np.ndarray, ctrl: np.ndarray, push: np.ndarray | None = None) -> np.ndarray:
    """Whitened measurements (W, n ny) from starts (W, 2 nv); push: generalised forces per coarse step (W, N, nv)."""
    steps = ctrl.shape[1] * rig.coarse
    drive = np.repeat(ctrl, rig.coarse, axis=1)
    push = np.zeros((len(start), steps, rig.naive.nv)) if push is None else push
    first = np.zeros((len(start), mujoco.mj_stateSize(rig.naive, FULL)))
    first[:, 1 : 1 + start.shape[1]] = start
    control = np.concatenate([drive, push], axis=2)
    _, sensed = rollout.rollout(model, mujoco.MjData(rig.naive), first, control, control_spec=int(DRIVEN))
    return (sensed[:, :: rig.coarse, rig.columns] / rig.sd).reshape(len(start), -1)


def tangents(rig: Rig, errors: np.ndarray, windows: Windows, pushed: bool) -> Tangents:
    """Secants about the windows; `pushed` adds the sensitivity to the disturbance."""
    model, nv = models(rig, errors), rig.naive.nv
    base = predict(rig, model, windows.start, windows.ctrl)
    start = [
        (predict(rig, model, windows.start + size * np.eye(2 * nv)[i], windows.ctrl) - base) / size
        for i, size in enumerate([1e-4] * nv + [1e-3] * nv)
    ]
    unknown = [
        (predict(rig, models(rig, errors + size * np.eye(len(errors))[i]), windows.start, windows.ctrl) - base) / size
        for i, size in enumerate([0.01 * u.sd for u in rig.unknowns])
    ]
    push = pulses(rig, model, windows, base) if pushed else None
    return Tangents(
        windows.first == 0, np.stack(start, axis=2), np.stack(unknown, axis=2), _clocks(rig, windows, base), push
    )


def _clocks(rig: Rig, windows: Windows, base: np.ndarray) -> np.ndarray:
    """What a clock that is `CLOCK` late changes, (W, n ny, runs)."""
    rows = base.reshape(len(base), -1, len(rig.channels))
    late = -np.gradient(rows, rig.period, axis=1).reshape(base.shape) * CLOCK
    return late[:, :, None] * (windows.row[:, None, None] == np.unique(windows.row))


def pulses(rig, model, windows, base):
    """Sensitivity to the generalised force, in units of `rig.disturbance`, over each of `PIECES`."""
    count, size, out = windows.ctrl.shape[1] * rig.coarse, 1e-2, []
    length = -(-count // PIECES)
    for dof in range(rig.naive.nv):
        for begin in range(0, count, length):
            push = np.zeros((len(windows.start), count, rig.naive.nv))
            push[:, begin : begin + length, dof] = size * rig.disturbance[dof]
            out.append((predict(rig, model, windows.start, windows.ctrl, push) - base) / size)
    return np.stack(out, axis=2)
