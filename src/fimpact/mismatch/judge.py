"""The same question put to every explanation: how well does it predict, initial states profiled, training and held out?

Numerics are not physics: the error of the time step is measured by halving it twice, taken out by Richardson's
extrapolation, and what is uncertain about that is counted as noise.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from fimpact.mismatch.coordinates import NOTHING, Coordinates
from fimpact.mismatch.fit import Fit, fit, relinearised
from fimpact.mismatch.problem import Linear, Point, Problem
from fimpact.mismatch.settle import first_point, restarted, settled, tried
from fimpact.mismatch.simulate import Hypothesis, Simulator
from fimpact.mismatch.starts import noise_level, start_spread, start_states
from fimpact.mismatch.turned import measured_turns
from fimpact.mismatch.windows import cut
from fimpact.recordings import Recording

ROUNDS = 4  # of numerics and fit in turn, at most
STILL = 3.0  # standard deviations squared, all samples together: no conclusion hangs on less
FAINT = 1e-4  # nor on less than this share of the squares that are left
RESTLESS = 9.0  # squares by which what is extrapolated of a window may move with the start that is fitted beside it
# Of a change with the step: how far from half of it the next one may be, where it is not extrapolated yet, and is.
HALVES = (0.25, 0.5)


@dataclass(frozen=True)
class Bench:
    """Training and held-out problems of one recording, with simulators at half and a quarter of the time step."""

    training: Problem
    held_out: Problem
    finer: tuple[Simulator, Simulator]
    noise: np.ndarray

    @property
    def offsets(self) -> tuple[np.ndarray, np.ndarray]:
        """What is taken for the time step's error in training and held-out windows: state, to be put back where an
        explanation was only tried."""
        return self.training.offset, self.held_out.offset

    def restore(self, offsets: tuple[np.ndarray, np.ndarray]) -> None:
        """Put `offsets` back."""
        self.training.offset, self.held_out.offset = offsets


def bench(recording: Recording) -> Bench:
    """Windows, first states and noise level of `recording`."""
    simulator, noise = Simulator(recording), noise_level(recording)
    length = round(recording.window / recording.period)
    problems = []
    for runs, held_out in ((recording.training, False), (recording.held_out, True)):
        windows = cut(runs, length, 0 if held_out else recording.windows)
        windows = replace(windows, turned=measured_turns(simulator.base, recording, runs, windows, noise))
        starts = start_states(simulator, windows, noise, held_out)
        problems.append(Problem(simulator, windows, noise, starts, start_spread(recording, windows, held_out)))
    return Bench(*problems, (Simulator(recording, 2), Simulator(recording, 4)), noise)


def correct(bench: Bench, problem: Problem, point: Point) -> np.ndarray:
    """Set the problem's numerical offset at `point` to what Richardson's extrapolation of y_h, y_{h/2} and y_{h/4}
    adds to y_h, for a first-order integrator, and count half its last step, `bend`, as noise; it is taken once.

    Returns:
        How far the offset of each window moved, (w,): the sum of squares, in standard deviations of the noise.
    """
    where = (problem.windows, point.qpos, point.qvel)
    whole, half, quarter = (s.predict(point.hypothesis, *where) for s in (problem.simulator, *bench.finer))
    bend = np.nan_to_num(4 * (2 * quarter - 3 * half + whole) / 3, posinf=0.0, neginf=0.0)
    if problem.bend is None:  # later, noise stays what it was, or models could not be compared
        problem.bend = bend
        problem.noise = np.sqrt(bench.noise**2 + (bend / 2) ** 2)
    offset = np.nan_to_num(2 * (half - whole), posinf=0.0, neginf=0.0) + bend
    offset *= converging(problem, half - whole, quarter - half)
    moved = problem.whiten(offset - problem.offset)
    problem.offset = offset
    return (moved**2).sum(1)


def converging(problem: Problem, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Windows, (w, 1, 1), in which a step halved twice changes predictions as a first-order error does, by `first` and
    then `second`, half as much and alike: what a collision does between two steps comes and goes with their length, and
    is not extrapolated. Where it was so far, that takes more: of two alike explanations, neither shall be the better
    for a window that the other is judged in otherwise."""
    before, after = (problem.whiten(np.nan_to_num(change)) for change in (first, second))
    off, most = ((after - before / 2) ** 2).sum(1), np.where(problem.offset.any((1, 2)), *HALVES[::-1])
    return (off <= most**2 * (before**2).sum(1))[:, None, None]


def settle(problem: Problem, hypothesis: Hypothesis, near: Point | None = None, linear: Linear | None = None) -> Fit:
    """Only the initial states fitted: how `hypothesis` predicts windows that it may not learn from."""
    states = (near.qpos, near.qvel) if near else problem.starts
    start = problem.evaluate(hypothesis, *states, NOTHING)
    linear = linear.alone() if linear else None
    return fit(problem, NOTHING, start, 8, linear, refresh=False)


def base_fit(
    bench: Bench, coordinates: Coordinates, hypothesis: Hypothesis, far: Collection[int] | None = None
) -> tuple[Fit, Fit]:
    """The hypothesis fitted to the training windows, and settled on those held out, numerics corrected at both; `far`
    as of `fit`."""
    found = fit(bench.training, coordinates, first_point(bench.training, coordinates, hypothesis), far=far)
    found = relinearised(bench.training, again(bench, bench.training, found))
    return found, again(bench, bench.held_out, settle(bench.held_out, found.point.hypothesis))


def again(bench: Bench, problem: Problem, found: Fit) -> Fit:
    """Numerics corrected at `found` and the fit continued from there, until the one no longer moves the other; `calmed`
    where that has no end."""
    for _ in range(ROUNDS):
        moved = correct(bench, problem, found.point).sum()
        found = _continued(problem, found)
        if moved < max(STILL, FAINT * found.point.squares.sum()):
            return found
    return calmed(bench, problem, found)


def _continued(problem: Problem, found: Fit) -> Fit:
    point = found.point
    start = problem.evaluate(point.hypothesis, point.qpos, point.qvel, found.coordinates)
    start = settled(problem, found.coordinates, restarted(problem, found.coordinates, start), known=found.linear)
    return fit(problem, found.coordinates, start, 12, found.linear, refresh=False)


def calmed(bench: Bench, problem: Problem, found: Fit) -> Fit:
    """`found`, without extrapolation of the windows where it would be another at every start that is fitted beside it,
    if they fit better so: what a collision does between two steps is no error of a step."""
    before, point = problem.offset, found.point
    restless = (correct(bench, problem, point) > RESTLESS) & before.any((1, 2))
    problem.offset = before
    rows = np.flatnonzero(restless)
    if not len(rows):
        return found
    plain = np.zeros_like(before[rows]), point.qpos[rows], point.qvel[rows]
    start = tried(problem, found.coordinates, point, rows, plain, 0.0)
    return found if start is point else _continued(problem, replace(found, point=start))


def exposed(problem: Problem, judged: Fit, fitted: Fit) -> Fit:
    """`judged`, settled under the hypothesis of `fitted`, with its sensitivities to the coordinates of that fit."""
    free, linear = fitted.coordinates, judged.linear.alone()
    base = problem.predict(judged.point.hypothesis, judged.point.qpos, judged.point.qvel)
    linear = linear.and_of(problem.columns(judged.point, free, range(len(free.scale)), base, linear))
    return replace(judged, linear=linear, coordinates=free, scale=fitted.scale, pull=fitted.pull)


def freedom(problem: Problem) -> float:
    """Degrees of freedom of a problem: samples less initial states."""
    samples = int(np.isfinite(problem.windows.measured).sum())
    shown = (problem.start_weight <= 1e-6).sum()
    return float(samples - shown)
