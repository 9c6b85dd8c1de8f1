"""Fit: maximum likelihood of a hypothesis over all training windows, initial states free.

Levenberg-Marquardt on the problem that is left once initial states are projected off (variable projection). The
refits of many candidates share the sensitivities of what they have in common.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from fimpact.mismatch.bounded import bounded
from fimpact.mismatch.problem import Coordinates, Linear, Point, Problem, shift
from fimpact.mismatch.simulate import Hypothesis, can_touch

SETTLED, RELATIVE = 0.05, 2e-6  # log-likelihood, or share of the cost: less predicted gain changes no conclusion
ROUGH = 2e-4  # the same as a share of what is beyond noise, which other things than parameters make
THOUSANDTH = 1e-3
UNSEEN = 1e-6  # squared sensitivity to a coordinate's whole scale below which it is left where it is
DAMPING, FIRST, FAILED = (1e-9, 1e6), 1e-4, 1e-3  # its range, at the start, and at least after a step that failed
SHRINK = 5.0  # by which a positive parameter may shrink in one step
STUCK = 3.0  # times the median of the windows' squares
STRIDES = (-0.7, 2.0)  # of a coordinate or its scale: the longest steps, tried first
FAR, LEAPS = 0.3, 12  # the same: the first long step after those; how many are tried
LOST = 10.0  # times the noise: mean square residual from which long steps are tried
ON, BACK = 2.0, -0.5  # what a long step that paid is multiplied by, and one that did not
PATIENCE = 2  # steps that one linearisation is kept for
BRIEFLY = 4  # iterations on initial states after a long step
WORTH = 0.99  # of the cost: what a long step must reach for a fit to go on from there
FULL = 1e-3  # damping up to which a step is as long as it wants to be


@dataclass(frozen=True)
class Fit:
    """A converged point, the problem linearised there, the posterior precision of the coordinates (k, k), their scale
    and the prior's pull on them, (k,) each, and whether the predicted gain of another step is negligible."""

    point: Point
    linear: Linear
    coordinates: Coordinates
    precision: np.ndarray
    scale: np.ndarray
    pull: np.ndarray
    converged: bool

    @property
    def covariance(self) -> np.ndarray:
        """Of the coordinates, (k, k); a direction that the data leave open has a huge variance, not an error."""
        scale = self.scale
        scaled = self.precision * np.outer(scale, scale)
        values, vectors = np.linalg.eigh(scaled)
        inverse = (vectors / np.maximum(values, values.max(initial=0.0) * 1e-14)) @ vectors.T
        return inverse * np.outer(scale, scale)


def fit(
    problem: Problem,
    coordinates: Coordinates,
    start: Point,
    iterations: int = 12,
    linear: Linear | None = None,
    refresh: bool = True,
    far: Collection[int] | None = None,
) -> Fit:
    """Minimise from `start`; where things touch and that ends far from the noise, in an optimum of its own or not,
    once more from where long steps lead.

    Args:
        linear: sensitivities to begin with; they are kept for `PATIENCE` iterations and refreshed after.
        refresh: whether those that are returned must be of the optimum itself, and not of a point near it.
        far: coordinates in which long steps are tried; None: in all.
    """
    found = _descended(problem, coordinates, start, iterations, linear, refresh)
    if not (refresh and lost(found.point) and can_touch(problem.simulator.base)):
        return found
    there = leaped(problem, coordinates, found.point, far)
    if there.cost > WORTH * found.point.cost:
        return found
    return _descended(problem, coordinates, there, iterations, None, refresh)


def _descended(problem, coordinates, start, iterations, linear, refresh) -> Fit:
    point, damping, converged = start if linear else settled(problem, coordinates, start), FIRST, False
    linear, age = linear or problem.linearise(point, coordinates), 0
    for _ in range(iterations):
        z_step, x_step, gain = _step(point, linear, coordinates, damping)
        if gain < 0.0:  # a bound cut the step short
            damping = max(30 * damping, FAILED)
            continue
        little = negligible(point)
        if gain < little:
            if age == 0 or not refresh:
                converged = damping <= FULL  # a step that is kept short promises little wherever it is
                break
            linear, age = problem.linearise(point, coordinates), 0
            continue
        trial = _moved(problem, point, coordinates, z_step, x_step)
        if not len(z_step):  # windows that share nothing each keep the better of two starts
            trial = _better(trial, point)
        elif not trial.cost < point.cost:
            # In windows where the mechanism sticks or strikes, the tangent's start may be worse than the old one.
            trial = _better(trial, _moved(problem, point, coordinates, z_step, 0.0 * x_step))
        # A full step that changes nothing: what a secant promises beyond that is its own error.
        converged = age == 0 and damping <= FULL and abs(point.cost - trial.cost) < little
        stalled = age == 0 and 0.0 < point.cost - trial.cost < little
        if trial.cost < point.cost:
            enough = point.cost - trial.cost > 0.5 * gain
            point, damping = trial, max(damping / 10, DAMPING[0])
            age += 1
            if age > PATIENCE or not enough:
                linear, age = problem.linearise(point, coordinates), 0
        elif age > 0:
            linear, age = problem.linearise(point, coordinates), 0
        else:
            damping = max(30 * damping, FAILED)
        if converged or stalled or damping > DAMPING[1]:
            break
    if age > 0 and refresh:
        linear = problem.linearise(point, coordinates)
    return _made(point, linear, coordinates, converged)


def lost(point: Point) -> bool:
    """Whether what is left is many times the noise."""
    return 2 * point.cost > LOST * np.count_nonzero(point.residual)


def negligible(point: Point) -> float:
    """Gain in log-likelihood that changes no conclusion: the further a model is from the noise, the larger."""
    misfit = point.cost - np.count_nonzero(point.residual) / 2
    return max(SETTLED, RELATIVE * point.cost, ROUGH * misfit)


def relinearised(problem: Problem, found: Fit) -> Fit:
    """`found` with the sensitivities of its own point: what is tested next may be all but one of them."""
    linear = problem.linearise(found.point, found.coordinates)
    return _made(found.point, linear, found.coordinates, found.converged)


def _made(point: Point, linear: Linear, coordinates: Coordinates, converged: bool) -> Fit:
    pull = (coordinates.read(point.hypothesis) - coordinates.mean) / coordinates.sd**2
    return Fit(point, linear, coordinates, precision_of(linear, coordinates), coordinates.scale, pull, converged)


def settled(problem: Problem, coordinates: Coordinates, point: Point, iterations: int = 6) -> Point:
    """The initial states alone, each window with a damping of its own: a window that meets a contact must not hold
    back those that do not. A window with no more to gain than a thousandth of its cost is done."""
    going, damping = np.arange(len(point.qpos)), np.full(len(point.qpos), FIRST)
    states = {name: getattr(point, name).copy() for name in ("qpos", "qvel", "residual")}
    for _ in range(iterations):
        part, own = problem.part(going), replace(point, **{name: rows[going] for name, rows in states.items()})
        step, gain = _start_step(part, own, damping[going])
        before = (own.residual**2).sum(1)
        moving = gain >= THOUSANDTH * before
        if not moving.any():
            break
        trial = _moved(part, own, coordinates, 0.0, step)
        better = (trial.residual**2).sum(1) < before
        for name, rows in states.items():
            rows[going[better]] = getattr(trial, name)[better]
        damping[going] = np.where(better, damping[going] / 10, np.clip(damping[going] * 30, FAILED, DAMPING[1]))
        going = going[moving]
    return problem.evaluate(point.hypothesis, states["qpos"], states["qvel"], coordinates)


def _start_step(problem: Problem, point: Point, damping: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Step of each window's initial state, (w, nx), and what it promises, (w,)."""
    basis, triangle = problem.starts_at(point)
    gram = triangle.transpose(0, 2, 1) @ triangle
    along = np.einsum("wji,wj->wi", triangle, np.einsum("wmx,wm->wx", basis, point.residual))
    loaded = gram + damping[:, None, None] * gram * np.eye(gram.shape[1])
    step = np.linalg.solve(loaded, along[..., None])[..., 0]
    return step, np.einsum("wi,wi->w", step, along)


def leaped(problem: Problem, coordinates: Coordinates, point: Point, along: Collection[int] | None = None) -> Point:
    """Long steps along one coordinate after the other, longer while that pays: a tangent through a contact holds for
    less than a step that would be worth while, and around an optimum of its own nothing shows what lies further off."""
    for i in range(len(coordinates.scale)) if along is None else along:
        z = coordinates.read(point.hypothesis)
        size = max(coordinates.scale[i], abs(z[i]))
        strides = [_leap(problem, coordinates, point, i, stride * size) for stride in STRIDES]
        point = min([point, *strides], key=lambda p: p.cost)
        step = FAR * max(coordinates.scale[i], abs(coordinates.read(point.hypothesis)[i]))
        for _ in range(LEAPS):
            trial = _leap(problem, coordinates, point, i, step)
            better = trial.cost < point.cost
            point = trial if better else point
            step *= ON if better else BACK
    return point


def _leap(problem: Problem, coordinates: Coordinates, point: Point, i: int, step: float) -> Point:
    """`point` with coordinate `i` moved by `step`, each window begun where it was or as measured, whichever is better
    there, and settled."""
    z = coordinates.read(point.hypothesis)
    there = coordinates.write(point.hypothesis, z + step * (np.arange(len(z)) == i))
    starts = (point.qpos, point.qvel), problem.starts
    begun = _better(*(problem.evaluate(there, *states, coordinates) for states in starts))
    return settled(problem, coordinates, begun, BRIEFLY)


def restarted(problem: Problem, coordinates: Coordinates, point: Point) -> Point:
    """`point`, with windows that fit far worse than the others tried anew from what the measurements show: a start on
    the wrong side of a contact does not find its way back."""
    squares = (point.residual**2).sum(1)
    loud = squares > STUCK * np.median(squares)
    if not loud.any():
        return point
    part = problem.part(loud)
    anew = settled(part, coordinates, part.evaluate(point.hypothesis, *part.starts, coordinates))
    states = {name: getattr(point, name).copy() for name in ("qpos", "qvel", "residual")}
    for name, rows in states.items():
        rows[loud] = getattr(anew, name)
    return _better(point, replace(point, **states))


def precision_of(linear: Linear, coordinates: Coordinates) -> np.ndarray:
    """Information of the projected problem and the prior, (k, k)."""
    return np.einsum("wma,wmb->ab", linear.projected, linear.projected) + np.diag(coordinates.sd**-2.0)


def _step(point: Point, linear: Linear, coordinates: Coordinates, damping: float) -> tuple:
    z = coordinates.read(point.hypothesis)
    left = linear.off(point.residual)
    slope = np.einsum("wma,wm->a", linear.projected, left) - (z - coordinates.mean) / coordinates.sd**2
    hessian, scale = precision_of(linear, coordinates), coordinates.scale
    # What the data do not show stays where it is.
    scale = scale * (np.diag(hessian) * scale**2 > UNSEEN)
    # A mass that the tangent takes below zero is small, and how small the next tangent knows better.
    low = np.where(coordinates.low > 0, np.maximum(coordinates.low, z / SHRINK), coordinates.low)
    loaded = hessian + damping * np.diag(np.diag(hessian))
    inside = bounded(loaded, slope, scale, low - z, coordinates.high - z)
    target = np.einsum("wmx,wm->wx", linear.basis, point.residual - linear.raw @ inside)
    x_step = np.linalg.solve(linear.triangle, target[..., None])[..., 0]
    ahead = np.einsum("wmx,wm->wx", linear.basis, point.residual)
    gain = slope @ inside - inside @ hessian @ inside / 2 + (ahead**2).sum() / 2
    return inside, x_step, gain


def _moved(problem: Problem, point: Point, coordinates: Coordinates, z_step, x_step) -> Point:
    hypothesis = coordinates.write(point.hypothesis, coordinates.read(point.hypothesis) + z_step)
    states = shift(problem.simulator.base, point.qpos, point.qvel, x_step)
    return problem.evaluate(hypothesis, *states, coordinates)


def _better(one: Point, other: Point) -> Point:
    """Two points of one hypothesis, each window's start from the one that fits it better."""
    squares = [np.nan_to_num((p.residual**2).sum(1), nan=np.inf) for p in (one, other)]
    first = (squares[0] <= squares[1])[:, None]
    qpos, qvel, residual = (
        np.where(first, getattr(one, name), getattr(other, name)) for name in ("qpos", "qvel", "residual")
    )
    finite = one if np.isfinite(one.cost) else other
    bent = finite.cost - (finite.residual**2).sum() / 2
    cost = float((residual**2).sum() / 2 + bent)
    return Point(one.hypothesis, qpos, qvel, residual, cost if np.isfinite(cost) else np.inf)


def first_point(problem: Problem, coordinates: Coordinates, hypothesis: Hypothesis) -> Point:
    """`hypothesis` with the initial states that the measurements show."""
    return problem.evaluate(hypothesis, *problem.starts, coordinates)
