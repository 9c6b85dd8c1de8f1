"""Starts of windows, refined on what each window shows: Gauss-Newton steps with slopes of their own."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from fimpact.deciding import ASTRAY
from fimpact.effects.touching import can_touch
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import DIVERGED, Simulator
from fimpact.simulation.windows import Windows, spread

STEPS = 3  # of Gauss-Newton, at most
SETTLED = 1e-3  # of the cost: less than that is no further step worth
STRAIGHT = 1e-2  # of the cost: a step that ends this near to what its slopes foretold needs no second one
HALVINGS = 2  # of a step that makes things worse
HEAVIEST, PARTS = 20, 30  # decades of the prior's weight in which that is sought, halved so often
ROUND_OFF = 1e-10  # of a slope's own square: what keeps a singular problem solvable
SOON, FORGOTTEN = 8, 1e-3  # part of a window, and of the noise: a start that moves readings less by then has died away
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
class Fit:
    """Windows under a model from starts refined on them. given: prior of the starts, (w, ...). noise: (ny,). change: in
    the tangent space, (w, n). slopes: of left with change, (w, n, T ny). left: measured minus predicted, sd of noise,
    (w, T ny), 0 where nothing is measured. predicted: (w, T, ny)."""

    windows: Windows
    given: Starts
    noise: np.ndarray
    change: np.ndarray
    slopes: np.ndarray
    left: np.ndarray
    predicted: np.ndarray

    @property
    def cost(self) -> np.ndarray:
        """What is minimised in each window, (w,): squares of what is left and of the change, in sd."""
        return _cost(self.left, self.change / self.given.sd)


def window_starts(windows: Windows, starts: Sequence[Starts]) -> Starts:
    """The states at the first sample of each window."""
    rows = list(zip(windows.runs, windows.first, strict=True))
    parts = ("qpos", "qvel", "act", "sd")
    return Starts(*(np.array([getattr(starts[run], part)[first] for run, first in rows]) for part in parts))


def states_of(fit: Fit, simulator: Simulator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The refined states at the start of each window: qpos, qvel and act."""
    given = fit.given
    return _moved(simulator.base, (given.qpos, given.qvel, given.act), fit.change)


@DIVERGED
def fit_windows(
    simulator: Simulator, hypothesis: Hypothesis, windows: Windows, given: Starts, noise: np.ndarray
) -> Fit:
    """Refine the states at the start of each window, `given` with their doubts, on its own measurements.

    Slopes are renewed in those windows only where they did not foretell what a step along them would do.
    """
    size, samples = given.sd.shape[1], windows.measured[0].size
    none = np.zeros((len(given.sd), size, samples))
    fit = Fit(windows, given, noise, np.zeros_like(given.sd), none, none[:, 0], windows.measured)
    fit, open_ = _simulated(fit, simulator, hypothesis, fit.change), np.arange(len(given.sd))
    for _ in range(STEPS):
        part = with_slopes(_part(fit, open_), simulator, hypothesis)
        part, curved = _stepped(part, simulator, hypothesis)
        fit, open_ = _filled(fit, part, open_), open_[curved]
        if not len(open_):
            break
    return fit


@DIVERGED
def refit(fit: Fit, simulator: Simulator, hypothesis: Hypothesis) -> Fit:
    """Refine a fit's starts further in a `simulator` of another time step, along the slopes that it has."""
    fit, open_ = _simulated(fit, simulator, hypothesis, fit.change), np.arange(len(fit.change))
    for _ in range(STEPS - 1):
        part, curved = _stepped(_part(fit, open_), simulator, hypothesis)
        fit, open_ = _filled(fit, part, open_), open_[curved]
        if not len(open_):
            break
    return fit


@DIVERGED
def step_error(fit: Fit, finer: Simulator, hypothesis: Hypothesis, most: int) -> float:
    """Compare predictions of at most `most` windows with those at a `finer` time step: root mean square of what it
    changes, as a part of their error or of the noise, whichever is more."""
    part = _part(fit, spread(len(fit.change), most))
    there = _simulated(part, finer, hypothesis, part.change)
    ended = [np.isfinite(own.left).all(1) for own in (part, there)]
    if (ended[0] != ended[1]).any():
        return np.inf
    moved, missed = there.left[ended[0]] - part.left[ended[0]], there.left[ended[0]]
    seen = np.isfinite(part.windows.measured[ended[0]]).sum()
    return float(np.sqrt((moved**2).sum() / max((missed**2).sum(), seen, 1)))


def _part(fit: Fit, rows: np.ndarray) -> Fit:
    given = Starts(*(getattr(fit.given, name)[rows] for name in ("qpos", "qvel", "act", "sd")))
    own = {name: getattr(fit, name)[rows] for name in ("change", "slopes", "left", "predicted")}
    return replace(fit, windows=fit.windows.part(rows), given=given, **own)


def _filled(fit: Fit, part: Fit, rows: np.ndarray) -> Fit:
    """The fit with its `rows` as in `part`."""
    own = {name: np.array(getattr(fit, name)) for name in ("change", "slopes", "left", "predicted")}
    for name, values in own.items():
        values[rows] = getattr(part, name)
    return replace(fit, windows=fit.windows, given=fit.given, **own)


def _simulated(fit: Fit, simulator: Simulator, hypothesis: Hypothesis, change: np.ndarray) -> Fit:
    """The fit with another change of its starts."""
    moved = replace(fit, change=change)
    predicted = simulator.predict(hypothesis, fit.windows, *states_of(moved, simulator))
    left = (fit.windows.measured - predicted) / fit.noise
    left = np.where(np.isfinite(fit.windows.measured), left, 0.0).reshape(len(change), -1)
    return replace(moved, left=left, predicted=predicted)


def with_slopes(fit: Fit, simulator: Simulator, hypothesis: Hypothesis) -> Fit:
    """Return the fit with slopes by differences around its change."""
    count, size = fit.change.shape
    nudge, rows = np.clip(NUDGE * fit.given.sd, *NUDGES), np.repeat(np.arange(count), size)
    moves = np.eye(size)[None] * nudge[:, None]
    near, slopes = _part(fit, rows), np.zeros((count, size, fit.left.shape[1]))
    whole = fit.windows.length
    for length in (whole,) if can_touch(simulator.base) or whole < 2 * SOON else (whole // SOON, whole):
        part = replace(near, windows=near.windows.begun(length))
        part = _simulated(part, simulator, hypothesis, (fit.change[:, None] + moves).reshape(-1, size))
        known = part.left.shape[1]
        slopes[:, :, :known] = (part.left.reshape(count, size, -1) - fit.left[:, None, :known]) / nudge[:, :, None]
        last = slopes[:, :, known // 2 : known] * fit.given.sd[:, :, None]
        if (np.abs(last) < FORGOTTEN).all():  # as a servo forgets where it began
            break
    return replace(fit, slopes=slopes)


def _stepped(fit: Fit, simulator: Simulator, hypothesis: Hypothesis) -> tuple[Fit, np.ndarray]:
    """The fit a step further along its slopes, halved in those windows that it makes worse and not at all where no half
    of it helps; and in which windows, a mask, another step is worth it."""
    step, before = _gauss_newton(fit), fit.cost
    ahead = fit.left + (step[:, None] @ fit.slopes)[:, 0]
    foretold = _cost(ahead, (fit.change + step) / fit.given.sd)
    found, open_ = fit, np.flatnonzero(before - foretold > SETTLED * before)
    for half in range(HALVINGS + 1):
        if not len(open_):
            break
        part = _part(fit, open_)
        part = _simulated(part, simulator, hypothesis, part.change + step[open_] * 0.5**half)
        better = part.cost <= before[open_]
        found, open_ = _filled(found, _part(part, better), open_[better]), open_[~better]
    after = found.cost
    return found, (before - after > SETTLED * before) & (after - foretold > STRAIGHT * after)


def _gauss_newton(fit: Fit) -> np.ndarray:
    """The step, (w, n), of each window that ends within `ASTRAY`; none where one of its simulations diverged.

    Where it would end farther away, the prior is given as much more weight as it takes.
    """
    usable = np.isfinite(fit.slopes).all((1, 2)) & np.isfinite(fit.left).all(1)
    slopes, left = np.where(usable[:, None, None], fit.slopes, 0.0), np.where(usable[:, None], fit.left, 0.0)
    known, sure = np.isfinite(fit.given.sd), 1 / fit.given.sd
    scale = np.maximum(np.sqrt((slopes**2).sum(2) + sure**2), 1e-300)
    slopes, sure, own = slopes / scale[:, :, None], sure / scale, fit.change * scale
    normal, gradient = slopes @ slopes.swapaxes(1, 2), (slopes @ left[..., None])[..., 0]
    eye = np.eye(scale.shape[1])

    def step(weight: np.ndarray) -> np.ndarray:
        prior = weight[:, None] * sure**2
        return -np.linalg.solve(normal + (prior + ROUND_OFF)[:, None] * eye, (gradient + prior * own)[..., None])[
            ..., 0
        ]

    def far(weight: np.ndarray) -> np.ndarray:
        return (((own + step(weight)) * sure) ** 2).sum(1) > ASTRAY**2 * known.sum(1)

    low, high = np.zeros(len(own)), np.where(far(np.ones(len(own))), float(HEAVIEST), 0.0)
    for _ in range(PARTS if high.any() else 0):
        middle = (low + high) / 2
        outside = far(10.0**middle)
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    return np.where(usable[:, None], step(10.0**high) / scale, 0.0)


def _cost(left: np.ndarray, change: np.ndarray) -> np.ndarray:
    return np.nan_to_num((left**2).sum(1) + (change**2).sum(1), nan=np.inf, posinf=np.inf)


def _moved(
    model: mujoco.MjModel, states: Sequence[np.ndarray], change: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """qpos, qvel and act moved by a `change` in the tangent space, (w, 2 nv + na)."""
    qpos, qvel, act = states
    position, speed, own = np.split(change, [model.nv, 2 * model.nv], 1)
    if model.nq == model.nv:
        return qpos + position, qvel + speed, act + own
    qpos = np.array(qpos)
    for row, step in zip(qpos, position, strict=True):
        mujoco.mj_integratePos(model, row, step, 1.0)
    return qpos, qvel + speed, act + own
