"""How visible an effect is to an oracle: its whitened trace in the training windows, nuisance projected off.

Everything here is computed on coarse copies, whose step is the naive model's.
"""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout

from fimpact.benchmark.drawing.motions import Motion
from fimpact.benchmark.planting.ground_truth import DRIVEN, FULL, new_world
from fimpact.benchmark.rigs.rig import CLOCK, Rig

PIECES = 5  # in which a window's disturbance is described
SPREAD = 1e-6  # smallest information on a start, relative to its largest: keeps unseen directions solvable
White = Callable[[np.ndarray], np.ndarray]  # (W, n ny, k) -> the same in units in which noise is white


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


def coloured(rig: Rig, push: np.ndarray, correlation: float) -> np.ndarray:
    """Response (W, n ny, k) to unit-variance OU disturbance of this correlation time, as independent columns."""
    piece = (rig.window or rig.duration) / PIECES
    lag = np.abs(np.subtract.outer(np.arange(PIECES), np.arange(PIECES))) * piece
    root = np.linalg.cholesky(np.exp(-lag / correlation) + 1e-9 * np.eye(PIECES))
    return push @ np.kron(np.eye(rig.naive.nv), root)


def unlogged(rig: Rig, push: np.ndarray) -> np.ndarray:
    """Response (W, n ny, k) to what motor currents tell wrongly, as independent columns; none where commands are known.

    Of what is white from sample to sample, and of the ripple, which is hardly less so, a piece keeps the mean.
    """
    samples = round((rig.window or rig.duration) / PIECES / rig.period)
    dofs = [rig.naive.joint(name).dofadr[0] for name in rig.driven] if len(rig.current) else []
    told = rig.current * np.sqrt(1.5 / samples)
    parts = [
        push[:, :, PIECES * dof : PIECES * (dof + 1)] * sd / rig.disturbance[dof]
        for dof, sd in zip(dofs, told, strict=True)
    ]
    return np.concatenate([push[:, :, :0], *parts], axis=2)


def noise_of(rig: Rig, push: np.ndarray, disturbance: float, correlation: float) -> np.ndarray:
    """Whitened response (W, n ny, m) to all that moves the robot and is not logged, from that to unit forces `push`."""
    return np.concatenate([disturbance * coloured(rig, push, correlation), unlogged(rig, push)], axis=2)


def loudness(rig: Rig, tangent: Tangents, response: np.ndarray) -> float:
    """By how much unit disturbance raises the mean squared whitened residual after fitting the starts."""
    information = _start_information(rig, tangent, tangent.start)
    left = response - tangent.start @ np.linalg.solve(information, _t(tangent.start) @ response)
    return float(np.sum(left**2) / (response.shape[0] * response.shape[1]))


@dataclass(frozen=True)
class Seen:
    """Gram matrix of projected traces (k, k), and squared lengths before any and after the starts' projection (k,)."""

    gram: np.ndarray
    raw: np.ndarray
    after_start: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """Non-centrality lambda of each trace, (k,)."""
        return np.diag(self.gram)

    @property
    def concealment(self) -> tuple[np.ndarray, np.ndarray]:
        """kappa, and kappa of the unknowns alone with the starts projected off first, (k,) each."""
        tiny = np.finfo(float).tiny
        return 1 - self.size / np.maximum(self.raw, tiny), 1 - self.size / np.maximum(self.after_start, tiny)

    def left(self, one: int, other: int) -> tuple[float, float]:
        """Cosine of two projected traces, and what is left of lambda of `one` when `other` is known too."""
        cosine = self.gram[one, other] / np.sqrt(
            max(self.gram[one, one] * self.gram[other, other], np.finfo(float).tiny)
        )
        return float(cosine), float(self.gram[one, one] * (1 - cosine**2))


def see(rig: Rig, tangent: Tangents, white: White, traces: np.ndarray) -> Seen:
    """What an oracle sees of `traces` (W, n ny, k) among noise that `white`, a `whitener`, makes white.

    The unknowns are projected off within their priors, the starts of the windows as far as they are unknown.
    """
    traces, unknown, start = (white(a) for a in (traces, _unknown(tangent), tangent.start))
    both = np.concatenate([traces, unknown], axis=2)
    cross = _t(start) @ both
    gram = np.sum(_t(both) @ both - _t(cross) @ np.linalg.solve(_start_information(rig, tangent, start), cross), axis=0)
    k = traces.shape[2]
    prior = _prior(rig, tangent)
    absorbed = gram[:k, k:] @ np.linalg.solve(gram[k:, k:] + prior, gram[k:, :k])
    return Seen(gram[:k, :k] - absorbed, np.sum(traces**2, axis=(0, 1)), np.diag(gram)[:k])


def left_over(rig: Rig, tangent: Tangents, white: White, traces: np.ndarray) -> np.ndarray:
    """Squares of each window, (W,), that are left of the first of `traces` (W, n ny, k) when the others, of any size,
    unknowns and starts have imitated it as far as they can; without what the priors of these cost, hence a little less
    in all than is left in `see`."""
    others = traces.shape[2] - 1
    both, start = (white(a) for a in (np.concatenate([traces, _unknown(tangent)], 2), tangent.start))
    both -= start @ np.linalg.solve(_start_information(rig, tangent, start), _t(start) @ both)
    own, rest = both[:, :, :1], both[:, :, 1:]
    gram, along = ((_t(rest) @ part).sum(0) for part in (rest, own))
    gram[others:, others:] += _prior(rig, tangent)
    return ((own - rest @ np.linalg.solve(gram, along)) ** 2).sum((1, 2))


def absorb(rig: Rig, tangent: Tangents, white: White, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the unknowns, (p,), and of the starts, (W, 2 nv), that imitate the trace `change` (W, n ny, 1) best."""
    change, unknown, start = (white(a) for a in (change, _unknown(tangent), tangent.start))
    information = _start_information(rig, tangent, start)
    cross, along = _t(start) @ unknown, _t(start) @ change
    gram = np.sum(_t(unknown) @ unknown - _t(cross) @ np.linalg.solve(information, cross), axis=0)
    seen = np.sum(_t(unknown) @ change - _t(cross) @ np.linalg.solve(information, along), axis=0)
    errors = np.linalg.solve(gram + _prior(rig, tangent), seen)[:, 0]
    moved = np.linalg.solve(information, along - (cross @ errors)[:, :, None])[:, :, 0]
    return errors[: len(rig.unknowns)], moved


def oracle_sd(rig: Rig, tangent: Tangents, white: White, traces: np.ndarray) -> np.ndarray:
    """Standard deviations, (p,), in the units of `Unknown`, with which an oracle knows the unknowns in the end when the
    sizes of `traces` (W, n ny, k), starts and clocks are to be fitted too."""
    both, start = (white(a) for a in (np.concatenate([traces, _unknown(tangent)], 2), tangent.start))
    cross, k = _t(start) @ both, traces.shape[2]
    gram = np.sum(_t(both) @ both - _t(cross) @ np.linalg.solve(_start_information(rig, tangent, start), cross), axis=0)
    gram[k:, k:] += _prior(rig, tangent)
    scale = 1 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    spread = scale * np.sqrt(np.diag(np.linalg.pinv(scale[:, None] * gram * scale)))
    return spread[k : k + len(rig.unknowns)]


def equivalent_force(rig: Rig, push: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Root mean square of the generalised force on each degree of freedom, (nv,), N or N m, that would change what is
    read by `change` (W, n ny, 1) from the same starts. push: whitened response (W, n ny, k) to unit forces."""
    size = np.sqrt(np.sum(push**2, axis=1, keepdims=True)) + np.finfo(float).tiny
    unit = push / size
    pieces = np.linalg.solve(_t(unit) @ unit + SPREAD * np.eye(push.shape[2]), _t(unit) @ change)[:, :, 0] / size[:, 0]
    return np.sqrt(np.mean(pieces.reshape(len(pieces), -1, PIECES) ** 2, axis=(0, 2))) * rig.disturbance


def _unknown(tangent: Tangents) -> np.ndarray:
    return np.concatenate([tangent.unknown, tangent.clock], axis=2)


def _prior(rig: Rig, tangent: Tangents) -> np.ndarray:
    return np.diag([*(u.sd**-2.0 for u in rig.unknowns), *np.ones(tangent.clock.shape[2])])


def _t(array):
    return array.transpose(0, 2, 1)


def _start_information(rig, tangent, start):
    gram = _t(start) @ start
    ridge = SPREAD * gram.max(axis=(1, 2))[:, None, None] * np.eye(start.shape[2]) * 1e-4
    return gram + ridge + tangent.opens[:, None, None] * np.diag(rig.start_sd**-2.0)


def whitener(noise: np.ndarray) -> White:
    """Inverse root of 1 + noise noise^T, window by window: makes white what disturbance `noise` (W, n ny, m) and white
    noise add to measurements."""
    q, s, _ = np.linalg.svd(noise, full_matrices=False)
    shrink = 1 - 1 / np.sqrt(1 + s**2)
    return lambda a: a - q @ (shrink[:, :, None] * (_t(q) @ a))
