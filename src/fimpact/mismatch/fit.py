"""Fit: maximum likelihood of a hypothesis over all training windows, initial states free.

Levenberg-Marquardt on the problem that is left once initial states are projected off (variable projection). The
refits of many candidates share the sensitivities of what they have in common.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from fimpact.mismatch.bounded import bounded
from fimpact.mismatch.coordinates import Coordinates
from fimpact.mismatch.leap import leaped
from fimpact.mismatch.problem import Linear, Point, Problem
from fimpact.mismatch.settle import DAMPING, FAILED, FIRST, better, moved, restarted, settled
from fimpact.mismatch.touch import can_touch

SETTLED, RELATIVE = 0.05, 2e-6  # log-likelihood, or share of the cost: less predicted gain changes no conclusion
ROUGH = 2e-4  # the same as a share of what is beyond noise, which other things than parameters make
UNSEEN = 1e-6  # squared sensitivity to a coordinate's whole scale below which it is left where it is
SHRINK = 5.0  # by which a positive parameter may shrink in one step
LOST = 10.0  # times the noise: mean square residual from which long steps are tried
PATIENCE = 2  # steps that one linearisation is kept for
WORTH = 0.99  # of the cost: what a long step must reach for a fit to go on from there
OPEN = 1e-14  # of the largest information on a direction of scaled coordinates: rounding
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
        """Of the coordinates, (k, k)."""
        return inverse(self.precision, self.scale)


def fit(
    problem: Problem,
    coordinates: Coordinates,
    start: Point,
    iterations: int = 12,
    linear: Linear | None = None,
    refresh: bool = True,
    far: Collection[int] | None = None,
    worst: float = np.inf,
) -> Fit:
    """Minimise from `start`; where things touch and that ends far from the noise, in an optimum of its own or not,
    once more from where windows that are stuck begin anew, and from where long steps lead.

    Args:
        linear: sensitivities to begin with; they are kept for `PATIENCE` iterations and refreshed after.
        refresh: whether those that are returned must be of the optimum itself, and not of a point near it.
        far: coordinates in which long steps are tried; None: in all.
        worst: cost; what would stay above it if all further steps gained as much as the next, and is near the noise,
            is not followed to its end, nor are sensitivities refreshed there.
    """
    found = _descended(problem, coordinates, start, iterations, linear, refresh, worst)
    if not (refresh and lost(found.point) and can_touch(problem.simulator.base)):
        return found
    begun = restarted(problem, coordinates, found.point)
    if begun.cost < WORTH * found.point.cost:
        found = _descended(problem, coordinates, begun, iterations, None, refresh)
    if not lost(found.point):
        return found
    there = leaped(problem, coordinates, found.point, far)
    if there.cost > WORTH * found.point.cost:
        return found
    return _descended(problem, coordinates, there, iterations, None, refresh)


def _descended(problem, coordinates, start, iterations, linear, refresh, worst=np.inf) -> Fit:
    point, damping, converged = start if linear else settled(problem, coordinates, start), FIRST, False
    linear, age = linear or problem.linearise(point, coordinates), 0
    for left in range(iterations, 0, -1):
        z_step, x_step, gain = _step(point, linear, coordinates, damping)
        if gain < 0.0:  # a bound cut the step short
            damping = max(30 * damping, FAILED)
            continue
        if point.cost - left * gain > worst and not lost(point):
            return _made(point, linear, coordinates, False)
        little = negligible(point)
        if gain < little:
            if age == 0 or not refresh:
                converged = damping <= FULL  # a step that is kept short promises little wherever it is
                break
            linear, age = problem.linearise(point, coordinates), 0
            continue
        trial = moved(problem, point, coordinates, z_step, x_step)
        if not len(z_step):  # windows that share nothing each keep the better of two starts
            trial = better(trial, point)
        elif not trial.cost < point.cost:
            # In windows where the mechanism sticks or strikes, the tangent's start may be worse than the old one.
            trial = better(trial, moved(problem, point, coordinates, z_step, 0.0 * x_step))
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


def inverse(precision: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Covariance, (k, k), of coordinates of such a `scale`, (k,): a direction that the data leave open has a huge
    variance, not none."""
    values, vectors = np.linalg.eigh(precision * np.outer(scale, scale))
    floored = (vectors / np.maximum(values, max(values.max(initial=0.0) * OPEN, np.finfo(float).tiny))) @ vectors.T
    return floored * np.outer(scale, scale)


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
