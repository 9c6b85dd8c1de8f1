"""Proof by forward simulation: errors of what is predicted over horizons from 0.1 s to whole runs.

Every model is treated alike: windows start at a given estimate of the state, which is refined for each window and each
model on the window's own measurements by a few Gauss-Newton steps, within what is known of the start.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.recordings import Recording, Run
from fimpact.simulation.simulator import DIVERGED, Hypothesis, Simulator
from fimpact.simulation.windows import Windows, cut

SHORTEST = 0.1  # s
LADDER = (1.0, 2.0, 5.0)  # of each decade: the horizons asked for
MOST_WINDOWS = 20  # of each horizon, spread over all runs
STEPS = 3  # of Gauss-Newton, at most
SETTLED = 1e-3  # of the cost: less than that is no further step worth
HALVINGS = 2  # of a step that makes things worse
NUDGE = 0.05  # of the sd of a start: the step of differences, within
NUDGES = (1e-7, 1e-3)  # m, rad and their rates


@dataclass(frozen=True)
class Starts:
    """States of one run at every sample, and how well they are known: qpos (T, nq), qvel (T, nv), act (T, na), sd
    (T, 2 nv + na) in the tangent space, inf where nothing is known."""

    qpos: np.ndarray
    qvel: np.ndarray
    act: np.ndarray
    sd: np.ndarray


@dataclass(frozen=True)
class HorizonErrors:
    """Root mean square errors by horizon, (h,) in s, and run: error (h, runs, ny) in the channels' units, normalised
    (h, runs) over channels in sd of noise. Infinite where a simulation diverged, NaN where a run has no window."""

    horizons: np.ndarray
    error: np.ndarray
    normalised: np.ndarray


def ladder(duration: float) -> list[float]:
    """Horizons, s, from `SHORTEST` in steps of about two up to `duration`, which is the last of them."""
    steps = [SHORTEST * size * 10**decade for decade in range(6) for size in LADDER]
    return [step for step in steps if step < 0.8 * duration] + [duration]


def errors(
    simulator: Simulator,
    hypothesis: Hypothesis,
    recording: Recording,
    runs: Sequence[Run],
    starts: Sequence[Starts],
    noise: np.ndarray,
    horizons: Sequence[float] = (),
) -> HorizonErrors:
    """Predict windows of `runs` for each of the horizons, s, at most `MOST_WINDOWS` of each.

    Args:
        starts: of each run. noise: sd of each channel, (ny,). horizons: default: `ladder` to the longest run.
    """
    longest = max(len(run.measured) for run in runs)
    horizons = horizons or ladder(longest * recording.period)
    lengths = [min(max(round(h / recording.period), 2), longest) for h in horizons]
    found = [_by_run(simulator, hypothesis, cut(runs, n, MOST_WINDOWS), starts, noise) for n in lengths]
    error, normalised = (np.array(part) for part in zip(*found, strict=True))
    return HorizonErrors(np.array(lengths) * recording.period, error, normalised)


def window_starts(windows: Windows, starts: Sequence[Starts]) -> Starts:
    """The states at the first sample of each window."""
    rows = list(zip(windows.runs, windows.first, strict=True))
    parts = ("qpos", "qvel", "act", "sd")
    return Starts(*(np.array([getattr(starts[run], part)[first] for run, first in rows]) for part in parts))


def predict_windows(
    simulator: Simulator, hypothesis: Hypothesis, windows: Windows, starts: Sequence[Starts], noise: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Predict `windows`, (w, T, ny), from starts that are refined on them; also those: qpos, qvel and act."""
    given = window_starts(windows, starts)
    fitted = fit_starts(simulator, hypothesis, windows, given.qpos, given.qvel, given.act, given.sd, noise)
    return simulator.predict(hypothesis, windows, *fitted), fitted


@DIVERGED
def fit_starts(
    simulator: Simulator, hypothesis: Hypothesis, windows: Windows, qpos, qvel, act, sd, noise
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Refine the states at the start of each window on its own measurements: (w, nq), (w, nv), (w, na).

    Args:
        qpos, qvel, act, sd: prior mean, (w, nq), (w, nv), (w, na), and standard deviation, (w, 2 nv + na).
    """
    mean, size = (qpos, qvel, act), sd.shape[1]
    nudge = np.clip(NUDGE * sd, *NUDGES)

    def residual(change: np.ndarray, part: Windows, rows: np.ndarray) -> np.ndarray:
        states = _moved(simulator.base, [own[rows] for own in mean], change)
        left = (part.measured - simulator.predict(hypothesis, part, *states)) / noise
        left = np.where(np.isfinite(part.measured), left, 0.0).reshape(len(rows), -1)
        return np.concatenate([left, -change / sd[rows]], 1)

    every, change = np.arange(len(qpos)), np.zeros_like(sd)
    left = residual(change, windows, every)
    for _ in range(STEPS):
        rows = np.repeat(every, size)
        moves = np.eye(size)[None] * nudge[:, None]
        near = residual((change[:, None] + moves).reshape(-1, size), windows.part(rows), rows)
        slopes = (near.reshape(len(every), size, -1) - left[:, None]) / nudge[:, :, None]
        step = _gauss_newton(slopes, left)
        before = _cost(left)
        change, left = _descended(lambda c: residual(c, windows, every), change, left, step)
        if np.all((_cost(left) >= before * (1 - SETTLED)) | np.isinf(before)):
            break
    return tuple(_moved(simulator.base, mean, change))


def _gauss_newton(slopes: np.ndarray, left: np.ndarray) -> np.ndarray:
    """The step, (w, n), of each window; none where one of its simulations diverged."""
    usable = np.isfinite(slopes).all((1, 2)) & np.isfinite(left).all(1)
    slopes, left = np.where(usable[:, None, None], slopes, 0.0), np.where(usable[:, None], left, 0.0)
    scale = np.maximum(np.linalg.norm(slopes, axis=2, keepdims=True), 1e-300)
    slopes = slopes / scale
    normal, gradient = slopes @ slopes.swapaxes(1, 2), slopes @ left[..., None]
    return -(np.linalg.pinv(normal, rcond=1e-10, hermitian=True) @ gradient / scale)[..., 0]


def _descended(residual, change: np.ndarray, left: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Go `step`, halved in those windows that it makes worse, and not at all where no half of it helps."""
    cost = _cost(left)
    for half in range(HALVINGS + 1):
        tried = change + step * 0.5**half
        found = residual(tried)
        better = _cost(found) <= cost
        change, left = np.where(better[:, None], tried, change), np.where(better[:, None], found, left)
        step = np.where(better[:, None], 0.0, step)
        if better.all():
            break
    return change, left


def _cost(left: np.ndarray) -> np.ndarray:
    return np.nan_to_num((left**2).sum(1), nan=np.inf, posinf=np.inf)


def _moved(model: mujoco.MjModel, states: Sequence[np.ndarray], change: np.ndarray) -> list[np.ndarray]:
    """qpos, qvel and act moved by a `change` in the tangent space, (w, 2 nv + na)."""
    qpos, qvel, act = states
    position, speed, own = np.split(change, [model.nv, 2 * model.nv], 1)
    if model.nq == model.nv:
        return [qpos + position, qvel + speed, act + own]
    qpos = np.array(qpos)
    for row, step in zip(qpos, position, strict=True):
        mujoco.mj_integratePos(model, row, step, 1.0)
    return [qpos, qvel + speed, act + own]


@DIVERGED
def _by_run(simulator, hypothesis, windows: Windows, starts, noise) -> tuple[np.ndarray, np.ndarray]:
    """Root mean square errors of each run by channel, (runs, ny), and over all of them in sd of noise, (runs,)."""
    predicted = predict_windows(simulator, hypothesis, windows, starts, noise)[0]
    squares = (windows.measured - predicted) ** 2
    seen = np.isfinite(windows.measured)
    squares = np.where(seen, np.nan_to_num(squares, nan=np.inf), 0.0)
    each = [windows.runs == run for run in range(len(windows.names))]
    count = np.array([seen[rows].sum((0, 1)) for rows in each], float)
    total = np.array([squares[rows].sum((0, 1)) for rows in each])
    with np.errstate(divide="ignore"):
        return np.sqrt(total / count), np.sqrt((total / noise**2).sum(1) / count.sum(1))
