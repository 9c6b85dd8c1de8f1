"""Explain: effects added to the model, everything refitted, and what that predicts of held-out windows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fimpact.effects.base import Placed
from fimpact.mismatch.colour import colour
from fimpact.mismatch.coordinates import Coordinates, coordinates
from fimpact.mismatch.disturbance import disturbance
from fimpact.mismatch.fit import Fit, fit, relinearised
from fimpact.mismatch.generalised import generalised
from fimpact.mismatch.judge import Bench, again, base_fit, correct, settle
from fimpact.mismatch.offer import offered
from fimpact.mismatch.price import price
from fimpact.mismatch.problem import Linear, Point, Problem
from fimpact.mismatch.pulses import Pulses
from fimpact.mismatch.score import Candidate, two_sided
from fimpact.mismatch.simulate import Hypothesis

WORSE = 1.5  # times the plain cost: a generalised step that raises it further is not taken
HALVINGS = 12  # of a strength at which the motion diverges
SHARPER = 2  # generalised steps from a fit by ordinary least squares


@dataclass(frozen=True)
class Explanation:
    """The effects added, the fit, and the held-out windows under it; deviance: `explain`, or `weigh` where rivals were
    weighed; shaped: what its shapes cost of that; weight: its share of belief among its rivals; dispersion: what their
    deviances were divided by; noise: what is white under the likeliest of them, in units of the sensors'; offsets:
    the time step's error in training and held-out windows, where it was measured here and not where a rival is;
    exposed: `judged` with the sensitivities
    to the coordinates of `fitted`, where rivals were weighed."""

    placed: tuple[Placed, ...]
    fitted: Fit
    judged: Fit
    deviance: float
    shaped: float = 0.0
    weight: float = 0.0
    dispersion: float = 1.0
    noise: float = 1.0
    offsets: tuple[np.ndarray, np.ndarray] | None = None
    exposed: Fit | None = None

    @property
    def name(self) -> str:
        """Names joined by +, in alphabetical order; "none" for the naive model."""
        return "+".join(sorted(p.name for p in self.placed)) or "none"

    @property
    def exact(self) -> bool:
        """Whether its numerics are its own."""
        return self.offsets is not None

    @property
    def loudness(self) -> float:
        """Of the windows' squares among disturbances, 1: noise of the sensors."""
        return self.dispersion * self.noise**2

    @property
    def weighed(self) -> dict[str, float]:
        """What is known since it was weighed among its rivals."""
        return {"weight": self.weight, "dispersion": self.dispersion, "noise": self.noise}

    @property
    def parts(self) -> tuple[Fit, Fit]:
        """Training and held-out windows."""
        return self.fitted, self.judged


def explain(fitted: Fit, judged: Fit) -> Explanation:
    """An explanation with its deviance: squares of training and held-out windows, the prior's, and its price."""
    found, free = Explanation(fitted.point.hypothesis.placed, fitted, judged, 0.0), fitted.coordinates
    bent = (((free.read(fitted.point.hypothesis) - free.mean) / free.sd) ** 2).sum()
    return replace(
        found, deviance=float(fitted.point.squares.sum() + judged.point.squares.sum() + bent + sum(price(found.parts)))
    )


def naive_fit(bench: Bench) -> Explanation:
    """The model as it is, from its own values."""
    simulator = bench.training.simulator
    return explain(*base_fit(bench, coordinates(simulator), Hypothesis(simulator.theta)))


def refit(bench: Bench, current: Explanation, *candidates: Candidate, worst: float = np.inf) -> Explanation:
    """All coordinates together, to convergence; what is shared with the current fit is not linearised anew, and its
    numerics are taken over (`corrected`). What ends as large as it may be is tried from the other side too: the tangent
    at zero does not tell which way something far away is.

    Args:
        worst: as of `fit`.
    """
    found = _refit(bench, current, *candidates, worst=worst)
    if len(candidates) > 1 or not found.placed[-1].at_limit or not two_sided(candidates[0].placed.effect):
        return found
    other = _refit(bench, current, replace(candidates[0], strength=-candidates[0].strength), worst=worst)
    return min(found, other, key=lambda e: np.nan_to_num(e.deviance, nan=np.inf))


def _refit(bench: Bench, current: Explanation, *candidates: Candidate, worst: float) -> Explanation:
    problem = bench.training
    sizes = tuple(sizes_of(p) for p in (*current.placed, *(c.placed for c in candidates)))
    start, free = _begun(problem, current, candidates, sizes)
    if not np.isfinite(start.cost):
        return replace(current, placed=start.hypothesis.placed, deviance=np.inf)
    new = range(len(current.fitted.coordinates.scale), len(free.scale))
    fitted = fit(problem, free, start, 12, beside(problem, current.fitted, start, free), far=new, worst=worst)
    judged = settle(bench.held_out, fitted.point.hypothesis, current.judged.point, current.judged.linear)
    return explain(fitted, judged)


def _begun(problem: Problem, current: Explanation, candidates: Sequence[Candidate], sizes) -> tuple[Point, Coordinates]:
    """`current` with the candidates at their one-shot strengths, which no tangent vouches for where they are large:
    half of them, and so on, where the motion diverges; its cost is infinite where it always does."""
    point = current.fitted.point
    for share in 0.5 ** np.arange(HALVINGS):
        added = (replace(c, strength=share * c.strength).start() for c in candidates)
        placed = (*current.placed, *added)
        free = coordinates(problem.simulator, placed, sizes)
        start = problem.evaluate(Hypothesis(point.hypothesis.theta, placed), point.qpos, point.qvel, free)
        if np.isfinite(start.cost):
            break
    return start, free


def beside(problem: Problem, known: Fit, start: Point, free: Coordinates) -> Linear:
    """Sensitivities at `start`: those to what a `known` fit has as well are taken over from it."""
    shared, base = known.linear, problem.predict(start.hypothesis, start.qpos, start.qvel)
    return shared.and_of(problem.columns(start, free, range(shared.raw.shape[2], len(free.scale)), base, shared))


def corrected(bench: Bench, rivals: Sequence[Explanation]) -> list[Explanation]:
    """`rivals`, each with numerics of its own, sought from those of the one before it: they are alike. Where a window
    fits one of them far better, its numerics and start there are offered to the others: a collision between two steps
    has several that are at peace with themselves, and which of them a rival found must not decide. Numerics of the
    problems are left as they are for the others."""
    before, found = bench.offsets, [numerics(bench, rival) for rival in rivals]
    parts = [
        offered(problem, [r.parts[side] for r in found], [r.offsets[side] for r in found])
        for side, problem in enumerate((bench.training, bench.held_out))
    ]
    bench.restore(before)
    pairs = [zip(*pair, strict=True) for pair in zip(*parts, strict=True)]
    return [replace(explain(*fits), **r.weighed, offsets=own) for r, (fits, own) in zip(found, pairs, strict=True)]


def without(bench: Bench, current: Explanation, rest: tuple[Placed, ...]) -> Explanation:
    """The explanation refitted with the effects `rest` only."""
    problem, point = bench.training, current.fitted.point
    free = coordinates(problem.simulator, rest, tuple(sizes_of(p) for p in rest))
    start = problem.evaluate(Hypothesis(point.hypothesis.theta, rest), point.qpos, point.qvel, free)
    fitted = fit(problem, free, start)
    return explain(fitted, settle(bench.held_out, fitted.point.hypothesis, current.judged.point))


def sizes_of(placed: Placed) -> dict[str, float]:
    """A typical size of each value of a placed effect: the largest of its unit, in its probes or now, or what happens
    to be zero, as an axis that a probe did not turn about, could never be moved."""
    unit, largest = {c.name: c.unit for c in placed.effect.coefficients}, {}
    for name, value in placed.values.items():
        size = max(abs(value), placed.sizes.get(name, 0.0))
        largest[unit[name]] = max(size, largest.get(unit[name], 0.0))
    return {name: largest[unit[name]] or 1e-6 for name in placed.values}


def shapes_of(placed: Sequence[Placed]) -> list[tuple[int, str]]:
    """Values without a meaning where the amplitude is zero, and fitted: (index of the placed effect, name) each."""
    shapes = [(i, c.name) for i, p in enumerate(placed) for c in p.effect.coefficients if c.shape]
    return [(i, name) for i, name in shapes if name not in placed[i].held]


def numerics(bench: Bench, best: Explanation) -> Explanation:
    """The explanation with the time step's error measured where it now is, refitted."""
    fitted = again(bench, bench.training, best.fitted)
    judged = settle(bench.held_out, fitted.point.hypothesis, best.judged.point, best.judged.linear)
    judged = again(bench, bench.held_out, judged)
    return replace(explain(fitted, judged), **best.weighed, offsets=bench.offsets)


def sharpened(bench: Bench, found: Pulses, explanation: Explanation) -> Explanation:
    """The same explanation at its generalised optimum, disturbances in the training windows weighed as such."""
    for _ in range(SHARPER):
        fitted, before = explanation.fitted, bench.offsets
        shade = colour(found, disturbance(fitted, found))
        z = fitted.coordinates.read(fitted.point.hypothesis) + generalised([fitted], [shade]).step
        there = moved(bench, explanation, fitted.coordinates.write(fitted.point.hypothesis, z), fitted.point)
        if not there.fitted.point.cost < WORSE * fitted.point.cost:  # the step left the range where its tangent holds
            bench.restore(before)
            break
        explanation = there
    return explanation


def moved(
    bench: Bench, explanation: Explanation, hypothesis: Hypothesis, near: Point, rest: bool = False
) -> Explanation:
    """`explanation` at another hypothesis, its training windows begun as those of `near`, with numerics of its own,
    taken once, or sought until they `rest`."""
    fitted, parts = explanation.fitted, []
    begun = (near, fitted.linear), (explanation.judged.point, explanation.judged.linear)
    for problem, (point, linear) in zip((bench.training, bench.held_out), begun, strict=True):
        found = settle(problem, hypothesis, point, linear)
        if rest:
            parts.append(again(bench, problem, found))
            continue
        correct(bench, problem, found.point)
        parts.append(settle(problem, hypothesis, found.point, found.linear))
    where = parts[0].point.qpos, parts[0].point.qvel
    point = bench.training.evaluate(hypothesis, *where, fitted.coordinates)
    if not np.isfinite(point.cost):
        return replace(explanation, fitted=replace(fitted, point=point), deviance=np.inf)
    fitted = relinearised(bench.training, replace(fitted, point=point))
    return replace(explain(fitted, parts[1]), **explanation.weighed)
