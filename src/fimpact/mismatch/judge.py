"""The same question put to every explanation: how well does it predict, initial states profiled, training and held out?

Numerics are not physics: the error of the time step is measured by halving it, taken out by Richardson extrapolation,
and what that leaves is counted as noise.
"""

from dataclasses import dataclass

import numpy as np

from fimpact.mismatch.fit import Fit, first_point, fit
from fimpact.mismatch.problem import NOTHING, Coordinates, Linear, Point, Problem
from fimpact.mismatch.simulate import Hypothesis, Simulator, cut
from fimpact.mismatch.starts import noise_level, start_states
from fimpact.recordings import Recording


@dataclass(frozen=True)
class Bench:
    """Training and held-out problems of one recording, with simulators at half and a quarter of the time step."""

    training: Problem
    held_out: Problem
    finer: tuple[Simulator, Simulator]
    noise: np.ndarray


def bench(recording: Recording) -> Bench:
    """Windows, first states and noise level of `recording`."""
    simulator, noise = Simulator(recording), noise_level(recording)
    length = round(recording.window / recording.period)
    problems = []
    for runs, held_out in ((recording.training, False), (recording.held_out, True)):
        windows = cut(runs, length)
        starts = start_states(simulator, windows, noise, held_out)
        problems.append(Problem(simulator, windows, noise, starts, recording.start_sd))
    return Bench(*problems, (Simulator(recording, 2), Simulator(recording, 4)), noise)


def correct(bench: Bench, problem: Problem, point: Point) -> None:
    """Set the problem's numerical offset at `point` to 2 (y_{h/2} - y_h), Richardson's for a first-order integrator,
    and count what the next halving would still change as noise."""
    where = (problem.windows, point.qpos, point.qvel)
    half = bench.finer[0].predict(point.hypothesis, *where)
    offset = 2 * (half - problem.simulator.predict(point.hypothesis, *where))
    problem.offset = np.where(np.isfinite(offset), offset, 0.0)
    if not problem.corrected:  # later, noise stays what it was, or models could not be compared
        quarter = bench.finer[1].predict(point.hypothesis, *where)
        left = 2 * (quarter - half) - problem.offset / 2
        problem.noise = np.sqrt(bench.noise**2 + np.where(np.isfinite(left), left, 0.0) ** 2)
    problem.corrected = True


def settle(problem: Problem, hypothesis: Hypothesis, near: Point | None = None, linear: Linear | None = None) -> Fit:
    """Only the initial states fitted: how `hypothesis` predicts windows that it may not learn from."""
    states = (near.qpos, near.qvel) if near else problem.starts
    start = problem.evaluate(hypothesis, *states, NOTHING)
    return fit(problem, NOTHING, start, 8, linear, 2 if linear else 0)


def base_fit(bench: Bench, coordinates: Coordinates, hypothesis: Hypothesis) -> tuple[Fit, Fit]:
    """The hypothesis fitted to the training windows, and settled on those held out, numerics corrected at both."""
    found = fit(bench.training, coordinates, first_point(bench.training, coordinates, hypothesis))
    found = again(bench, bench.training, found)
    return found, again(bench, bench.held_out, settle(bench.held_out, found.point.hypothesis))


def again(bench: Bench, problem: Problem, found: Fit) -> Fit:
    """Numerics corrected at `found`, and the fit continued from there."""
    point = found.point
    correct(bench, problem, point)
    start = problem.evaluate(point.hypothesis, point.qpos, point.qvel, found.coordinates)
    return fit(problem, found.coordinates, start, linear=found.linear, patience=3)


def squares(found: Fit) -> np.ndarray:
    """Sum of squared whitened residuals of each window, (w,)."""
    return (found.point.residual**2).sum(1)


def freedom(problem: Problem, coordinates: int = 0) -> float:
    """Degrees of freedom of a problem: samples less initial states less coordinates."""
    samples = int(np.isfinite(problem.windows.measured).sum())
    shown = (problem.start_weight <= 1e-6).sum()
    return float(samples - shown - coordinates)
