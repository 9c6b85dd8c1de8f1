"""Tame: an explanation where collisions make the likelihood rugged, and some windows far louder than noise.

By ordinary least squares the loudest windows decide, though what happens between two samples of a collision, which no
model gets right, is the most of them, and the way down ends in the first of many optima.
"""

import numpy as np

from fimpact.mismatch.coordinates import Coordinates
from fimpact.mismatch.explain import Explanation, moved
from fimpact.mismatch.fit import fit
from fimpact.mismatch.generalised import tempered
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.leap import leaped
from fimpact.mismatch.problem import Point, Problem
from fimpact.mismatch.settle import restarted, settled
from fimpact.mismatch.touch import can_touch

WILD = 5.0  # dispersion that no disturbance has which is alike in all windows
PASSES = 2  # of a fit, and how loud each window is under it
WORTH = 0.99  # of the tempered squares: what a pass must reach


def tamed(bench: Bench, explanation: Explanation) -> Explanation:
    """`explanation` as likely as long steps can make it where what fits worse than noise has noise of its own
    (`tempered`); as it is, where nothing touches or all windows are about as loud as noise."""
    if explanation.loudness <= WILD or not can_touch(bench.training.simulator.base):
        return explanation
    fitted = explanation.fitted
    first = point = fitted.point
    for _ in range(PASSES):
        there = _pass(bench.training, fitted.coordinates, point)
        if not _unlikely(there) < WORTH * _unlikely(point):
            break
        point = there
    if point is first:
        return explanation
    before, there = bench.offsets, moved(bench, explanation, point.hypothesis, point, rest=True)
    if _unlikely(there.fitted.point) < _unlikely(first):
        return there
    bench.restore(before)
    return explanation


def _pass(problem: Problem, free: Coordinates, point: Point) -> Point:
    """Each window's noise as it shows at `point`, and the fit under that."""
    quiet = problem.louder(np.sqrt(np.maximum(point.squares / point.samples, 1.0)))
    start = quiet.evaluate(point.hypothesis, point.qpos, point.qvel, free)
    found = fit(quiet, free, leaped(quiet, free, start)).point
    there = problem.evaluate(found.hypothesis, found.qpos, found.qvel, free)
    return restarted(problem, free, settled(problem, free, there))


def _unlikely(point: Point) -> float:
    """Tempered squares of all windows, and the prior's."""
    squares = point.squares
    return float(tempered(squares, point.samples).sum() + 2 * point.cost - squares.sum())
