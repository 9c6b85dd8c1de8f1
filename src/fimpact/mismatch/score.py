"""The score test: what each candidate would gain, before anything is refitted.

A missing effect is a parameter at zero. Its sensitivity s, with what initial states and fitted parameters imitate
taken out (s_perp), gives the score U = s_perp' r, its information I = ||s_perp||^2, the one-shot strength U / I and the
concealment kappa = 1 - ||s_perp||^2 / ||s||^2. One simulation per candidate, or for force laws one motion
that is linearised for all of them (`tangent`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fimpact.effects.base import Effect, Placed, Scales
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.simulate import Hypothesis
from fimpact.mismatch.steady import steadied
from fimpact.mismatch.tangent import Tangent, has_tangent, tangent
from fimpact.mismatch.touch import can_touch

SMALL = 1e-2  # share of its probe at which a linear effect is tried: in contact no tangent holds for all of it
TOGETHER = 32  # columns that are scored at once
INVISIBLE = 1e-3  # standard deviations: a probe that shows less, all samples together, is not a candidate


@dataclass(frozen=True)
class Candidate:
    """One effect at one site, tried at one probe; `strength` multiplies the probe: the one-shot estimate.

    shares: (w + 1,) contributions of the windows, and of the prior, to the score; information: ||s_perp||^2;
    concealment: all of it, and `hidden` the part that the fitted parameters alone imitate; change: of the whitened
    prediction by the probe, (w, m); column: s_perp, (w, m).
    """

    placed: Placed
    shares: np.ndarray
    information: float
    strength: float
    concealment: float
    hidden: float
    change: np.ndarray
    column: np.ndarray

    @property
    def z(self) -> float:
        """Score in standard deviations of white noise; negative: the data ask for less than nothing of it."""
        return float(self.shares.sum() / np.sqrt(self.information))

    @property
    def gain(self) -> float:
        """Predicted fall of the sum of squares; 0 for a strength that the effect cannot have."""
        return self.z**2 if self.allowed else 0.0

    @property
    def allowed(self) -> bool:
        """Whether the one-shot strength has a sign that the effect's bounds permit."""
        return self.strength > 0 or two_sided(self.placed.effect)

    def start(self) -> Placed:
        """The effect at its one-shot strength, inside its bounds."""
        if not self.placed.effect.linear:
            return self.placed
        values = dict(self.placed.values)
        for c in self.placed.effect.coefficients:
            if not c.shape:
                values[c.name] = float(np.clip(values[c.name] * self.strength, c.low, c.high))
        return replace(self.placed, values=values)


def two_sided(effect: Effect) -> bool:
    """Whether the effect's amplitude may have either sign."""
    return effect.linear and all(c.low < effect.neutral[c.name] for c in effect.coefficients if not c.shape)


def proposals(effects: Sequence[Effect], problem: Problem, scales: Scales) -> list[Placed]:
    """Every effect at every site at every probe."""
    model, channels = problem.simulator.base, problem.simulator.recording.channels
    found = []
    for effect in effects:
        for site in effect.sites(model, channels):
            placed = [Placed(effect, site, values) for values in effect.probes(scales, model, site)]
            sizes = {c.name: max((abs(p.values[c.name]) for p in placed), default=0.0) for c in effect.coefficients}
            ranges = effect.ranges(scales, model, site)
            found += [replace(p, sizes=sizes, ranges=ranges) for p in placed]
    return found


def screen(problem: Problem, fitted: Fit, tried: Sequence[Placed]) -> list[Candidate]:
    """Score of every proposal at the fitted point; those that change nothing there are left out."""
    changes = zip(tried, _Secant(problem, fitted).each(tried), strict=True)
    seen = [(placed, change) for placed, change in changes if np.isfinite(change).all()]
    found = scores(fitted, *zip(*seen, strict=True)) if seen else []
    return [candidate for candidate in found if candidate.information > INVISIBLE**2]


class _Secant:
    """What a probe changes in the whitened prediction, (w, m): a linear effect's from a small share of it."""

    def __init__(self, problem: Problem, fitted: Fit):
        self.problem, self.point, self.fitted = problem, fitted.point, fitted
        self.base = problem.predict(self.point.hypothesis, self.point.qpos, self.point.qvel)
        self.touching = can_touch(problem.simulator.base)
        self.bare = has_tangent(problem.simulator, self.point)

    def each(self, tried: Sequence[Placed]) -> Iterator[np.ndarray]:
        """The change of each, one after the other."""
        laws = [p for p in tried if self._is_slope(p)]
        slopes = (change for some in in_turn(laws) for change in self._along(some))
        return (next(slopes) if self._is_slope(placed) else self._secant(placed) for placed in tried)

    def _is_slope(self, placed: Placed) -> bool:
        return self.bare and placed.effect.linear and placed.effect.enters == "force"

    def _secant(self, placed: Placed) -> np.ndarray:
        everywhere = np.arange(len(self.base))
        if not placed.effect.linear:
            return self._at(placed, 1.0, everywhere)
        change = self._at(placed, SMALL, everywhere)
        if not (self.touching and np.isfinite(change).all()):
            return change

        def column(own: np.ndarray) -> np.ndarray:
            # The better an effect is concealed, the less of it a jump has to outweigh.
            return score(self.fitted, placed, own).column

        return steadied(column, change, lambda share, rows: self._at(placed, share * SMALL, rows))

    def _at(self, placed: Placed, share: float, rows: np.ndarray) -> np.ndarray:
        problem, point = self.problem.part(rows), self.point
        added = Hypothesis(point.hypothesis.theta, (*point.hypothesis.placed, _times(placed, share)))
        change = (problem.predict(added, point.qpos[rows], point.qvel[rows]) - self.base[rows]) / share
        return problem.extend(change[..., None])[..., 0]

    def _along(self, laws: Sequence[Placed]) -> list[np.ndarray]:
        """What the force of each law on the way without it does: its own feedback is of second order."""
        change = self._tangent.response(np.stack([self._tangent.force(law) for law in laws], 3))
        shown = np.stack([self.problem.whiten(own) for own in np.moveaxis(change, 3, 0)], 2)
        return list(np.moveaxis(self.problem.extend(shown), 2, 0))

    @cached_property
    def _tangent(self) -> Tangent:
        return tangent(self.problem, self.point)


def _times(placed: Placed, share: float) -> Placed:
    """The effect with its amplitudes multiplied."""
    shapes = {c.name for c in placed.effect.coefficients if c.shape}
    values = {k: v if k in shapes else v * share for k, v in placed.values.items()}
    return replace(placed, values=values)


def rescore(fitted: Fit, candidates: Sequence[Candidate]) -> list[Candidate]:
    """The same probes beside another fit, their sensitivities taken as they were."""
    again = scores(fitted, [c.placed for c in candidates], [c.change for c in candidates])
    return [c for c in again if c.information > INVISIBLE**2]


def score(fitted: Fit, placed: Placed, change: np.ndarray) -> Candidate:
    """Score of one column, (w, m): the change that the probe makes."""
    return scores(fitted, [placed], [change])[0]


def scores(fitted: Fit, placed: Sequence[Placed], changes: Sequence[np.ndarray]) -> list[Candidate]:
    """Score of each of some columns, (w, m) each: the changes that the probes of what is `placed` make."""
    left, inverse = fitted.linear.off(fitted.point.residual), fitted.covariance
    tried = list(zip(placed, changes, strict=True))
    return [c for some in in_turn(tried) for c in _scores(fitted, left, inverse, *zip(*some, strict=True))]


def in_turn(tried: Sequence) -> Iterator[Sequence]:
    """Few enough at once."""
    return (tried[first : first + TOGETHER] for first in range(0, len(tried), TOGETHER))


def _scores(fitted: Fit, left: np.ndarray, inverse: np.ndarray, placed, changes) -> list[Candidate]:
    linear, change = fitted.linear, np.stack(changes, 2)
    free = linear.off(change)
    along = np.einsum("wma,wmc->ac", linear.projected, free, optimize=True)
    absorbed = inverse @ along
    columns = free - linear.projected @ absorbed
    # The prior is an observation of the parameters: a fit that had to bend them votes for what they absorbed.
    shares = np.vstack([(left[:, None] @ columns)[:, 0], absorbed.T @ fitted.pull])
    whole = linear.colour.white(change) if linear.colour else change
    all_, before = (np.einsum("wmc,wmc->c", own, own) for own in (whole, free))
    told = shares.T, before - (along * absorbed).sum(0), all_, before, np.moveaxis(columns, 2, 0).copy()
    return [_candidate(*own) for own in zip(placed, changes, *told, strict=True)]


def _candidate(placed: Placed, change, shares, left, all_, before, column) -> Candidate:
    """What is `left` of the squares of a column beside fitted parameters and initial states: of `all_` of them, or of
    those that were there `before` parameters took theirs."""
    return Candidate(
        placed,
        shares,
        float(max(left, 0.0)),
        float(shares.sum() / left) if left > 0 else 0.0,
        float(1 - left / all_) if all_ > 0 else 1.0,
        float(1 - left / before) if before > 0 else 1.0,
        change,
        column,
    )
