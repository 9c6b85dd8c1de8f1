"""Settle: the initial states alone, each window's own, while a hypothesis stays as it is."""

from dataclasses import replace

import numpy as np

from fimpact.mismatch.coordinates import Coordinates
from fimpact.mismatch.problem import Linear, Point, Problem, difference, shift
from fimpact.mismatch.simulate import DIVERGED, Hypothesis
from fimpact.mismatch.touch import may_stick

DAMPING, FIRST, FAILED = (1e-9, 1e6), 1e-4, 1e-3  # its range, at the start, and at least after a step that failed
THOUSANDTH = 1e-3
STUCK = 3.0  # times the median of the windows' squares
FAR, SCATTERED = 10.0, 6  # times the noise: what is tried from so many starts about the measured one
WIDE = 4.0  # times the median distance of a start from the measured one: sd of those


def first_point(problem: Problem, coordinates: Coordinates, hypothesis: Hypothesis) -> Point:
    """`hypothesis` with the initial states that the measurements show."""
    return problem.evaluate(hypothesis, *problem.starts, coordinates)


def settled(
    problem: Problem, coordinates: Coordinates, point: Point, iterations: int = 6, known: Linear | None = None
) -> Point:
    """The initial states alone, each window with a damping of its own: a window that meets a contact must not hold
    back those that do not. A window with no more to gain than a thousandth of its cost is done.

    Args:
        known: sensitivities of a point nearby, for the first step.
    """
    going, damping = np.arange(len(point.qpos)), np.full(len(point.qpos), FIRST)
    states = {name: getattr(point, name).copy() for name in ("qpos", "qvel", "residual")}
    for iteration in range(iterations):
        part, own = problem.part(going), replace(point, **{name: rows[going] for name, rows in states.items()})
        slopes = (known.basis, known.triangle) if known and iteration == 0 else part.starts_at(own)
        step, gain = _start_step(own, slopes, damping[going])
        before = own.squares
        moving = gain >= THOUSANDTH * before
        if not moving.any():
            break
        trial = moved(part, own, coordinates, 0.0, step)
        gained = trial.squares < before
        for name, rows in states.items():
            rows[going[gained]] = getattr(trial, name)[gained]
        damping[going] = np.where(gained, damping[going] / 10, np.clip(damping[going] * 30, FAILED, DAMPING[1]))
        going = going[moving]
    return problem.evaluate(point.hypothesis, states["qpos"], states["qvel"], coordinates)


def _start_step(point: Point, slopes: tuple, damping: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Step of each window's initial state, (w, nx), and what it promises, (w,); slopes: `Problem.starts_at`."""
    basis, triangle = slopes
    gram = triangle.transpose(0, 2, 1) @ triangle
    along = np.einsum("wji,wj->wi", triangle, np.einsum("wmx,wm->wx", basis, point.residual))
    loaded = gram + damping[:, None, None] * gram * np.eye(gram.shape[1])
    step = np.linalg.solve(loaded, along[..., None])[..., 0]
    return step, np.einsum("wi,wi->w", step, along)


def restarted(problem: Problem, coordinates: Coordinates, point: Point) -> Point:
    """`point`, with windows that fit far worse than the others tried anew from what the measurements show, and those
    that are far from the noise even then, if things touch or stick, from about there: a start on the wrong side of a
    contact, or of a standstill, does not find its way back."""
    trials = 1 + SCATTERED * may_stick(problem.simulator.base, point.hypothesis)
    finite, rng = point.squares[np.isfinite(point.squares)], np.random.default_rng(0)
    limit = STUCK * np.median(finite) if finite.size else 0.0
    for trial in range(trials):
        loud = ~(point.squares <= np.maximum(limit, FAR * point.samples * (trial > 0)))
        if not loud.any():
            break
        part = problem.part(loud)
        about = _spread(problem, point) * rng.standard_normal((loud.sum(), 2 * problem.simulator.base.nv)) * (trial > 0)
        starts = shift(problem.simulator.base, *part.starts, about)
        anew = settled(part, coordinates, part.evaluate(point.hypothesis, *starts, coordinates))
        states = {name: getattr(point, name).copy() for name in ("qpos", "qvel", "residual")}
        for name, rows in states.items():
            rows[loud] = getattr(anew, name)
        if np.isfinite(point.cost):
            point = better(point, replace(point, **states))
        else:
            point = problem.evaluate(point.hypothesis, states["qpos"], states["qvel"], coordinates)
    return point


def _spread(problem: Problem, point: Point) -> np.ndarray:
    """How far the windows' starts are from what the measurements show, (2 nv,), and some more."""
    off = difference(problem.simulator.base, *problem.starts, point.qpos, point.qvel)
    return WIDE * np.median(np.abs(off), 0)


def moved(problem: Problem, point: Point, coordinates: Coordinates, z_step, x_step) -> Point:
    """`point` with its coordinates moved by z_step, (k,), and its initial states by x_step, (w, nx)."""
    hypothesis = coordinates.write(point.hypothesis, coordinates.read(point.hypothesis) + z_step)
    states = shift(problem.simulator.base, point.qpos, point.qvel, x_step)
    return problem.evaluate(hypothesis, *states, coordinates)


def tried(problem: Problem, coordinates: Coordinates, point: Point, rows: np.ndarray, other: tuple, by: float) -> Point:
    """`point`, and of its windows `rows` those with `other` numerics and starts, (offset, qpos, qvel), which `problem`
    then has, that fit better so by some squares; `point` itself where none does."""
    part = problem.part(rows)
    part.offset, *states = other
    there = settled(part, coordinates, part.evaluate(point.hypothesis, *states, coordinates))
    helps = there.squares < point.squares[rows] - by
    if not helps.any():
        return point
    offset, qpos, qvel = problem.offset.copy(), point.qpos.copy(), point.qvel.copy()
    for whole, new in zip((offset, qpos, qvel), (part.offset, there.qpos, there.qvel), strict=True):
        whole[rows[helps]] = new[helps]
    problem.offset = offset
    return problem.evaluate(point.hypothesis, qpos, qvel, coordinates)


@DIVERGED
def better(one: Point, other: Point) -> Point:
    """Two points of one hypothesis, each window's start from the one that fits it better."""
    squares = [np.nan_to_num(p.squares, nan=np.inf) for p in (one, other)]
    first = (squares[0] <= squares[1])[:, None]
    qpos, qvel, residual = (
        np.where(first, getattr(one, name), getattr(other, name)) for name in ("qpos", "qvel", "residual")
    )
    finite = one if np.isfinite(one.cost) else other
    bent = finite.cost - (finite.residual**2).sum() / 2
    cost = float((residual**2).sum() / 2 + bent)
    return Point(one.hypothesis, qpos, qvel, residual, cost if np.isfinite(cost) else np.inf)
