"""Name: which effect, where, and which others the recordings cannot tell from it.

Screen every candidate by its score, refit the best few to convergence, compare what they predict, held-out runs
included; add the best, ask again, drop what became superfluous.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fimpact.effects.base import Effect
from fimpact.mismatch.calibrate import adjusted, background
from fimpact.mismatch.colour import FEW, beside, colour, coloured, disturbance, generalised
from fimpact.mismatch.explain import Explanation, explain, numerics, refit, sharpened, without
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench, base_fit
from fimpact.mismatch.nameless import nameless
from fimpact.mismatch.problem import coordinates
from fimpact.mismatch.pulses import Pulses, pulses
from fimpact.mismatch.scales import scales
from fimpact.mismatch.score import Candidate, proposals, rescore, score, screen, two_sided
from fimpact.mismatch.simulate import Hypothesis
from fimpact.mismatch.weigh import both, dispersion, explained, members, predicted, weigh

ALARM = 0.03  # family-wise probability of finding a named effect where nothing is missing; CERTAIN is the rest of 5 %
FURTHER = 0.01  # the same for each further effect
REFITS = 8  # candidates that are truly refitted in each step
EASY, MORE = 20, 24  # windows up to which that costs little, and how many are refitted then
RIVAL = 0.4  # share of the best candidate's predicted gain below which a candidate is not refitted
CLEAR = 10.0  # what comes on top of that for small gains, half of that share at most
TWIN = 0.8  # cosine with the best candidate above which one is refitted whatever it is predicted to gain
SWAPS = 2  # candidates that are refitted in the place of an effect that is there already
TRACE = 0.03  # share of what there was to explain that is not worth a further effect
UNNAMED = 0.15  # share of the explainable mismatch that a named answer may leave
WILD = 5.0  # dispersion that no disturbance has which is alike in all windows
CERTAIN = 0.02  # family-wise p at which a force without a name is there beside the best named answer
SURE, CHANCE = 1e-3, 4.0  # family-wise p that held-out runs need not confirm, if they lose no more than two deviations
EVEN = 0.5  # weight, relative to the likeliest, above which the earlier in the catalogue is named first
LARGEST = 3  # effects that are added, at most


@dataclass(frozen=True)
class Step:
    """One round: what was screened, with family-wise p of each, and what was refitted, best first."""

    screened: list[Candidate]
    p: np.ndarray
    rivals: list[Explanation]

    @property
    def least(self) -> float:
        """Family-wise p of the strongest candidate."""
        return float(min((p for c, p in zip(self.screened, self.p, strict=True) if c.allowed), default=1.0))


@dataclass(frozen=True)
class Naming:
    """The naive explanation, the steps, and the answer: `best` and the rivals that cannot be told from it.

    nameless: family-wise p of forces without a name (`curves`) beside the naive model and beside `best`. left: what the
    strongest of them explains beside `best`, as a share of that and of what `best` explains. dispersion: of the
    windows' squares under `best`, 1: noise among disturbances. covariance: of the coordinates of `best`, disturbances
    counted. pulses: the sensitivities behind `nameless`.
    """

    naive: Explanation
    steps: list[Step]
    best: Explanation
    members: list[Explanation]
    left: float
    nameless: tuple[float, float]
    dispersion: float
    covariance: np.ndarray
    pulses: Pulses

    @property
    def widened(self) -> float:
        """How much wider disturbances make the intervals, the median over the fitted coordinates."""
        ratio = np.diag(self.covariance) / np.diag(self.best.fitted.covariance)
        return float(np.sqrt(np.median(ratio))) if len(ratio) else 1.0

    @property
    def p(self) -> float:
        """Family-wise p of the strongest candidate that the naive model was tested for."""
        return self.steps[0].least

    @property
    def answer(self) -> str:
        """The best name, "none", or "unnamed" where the best leaves too much that is neither noise nor disturbance."""
        forced = self.beside and self.left > UNNAMED
        wild = self.dispersion > WILD and not self.best.placed and len(self.pulses.time) >= FEW
        return "unnamed" if forced or wild else self.best.name

    @property
    def beside(self) -> bool:
        """Whether a force without a name is there beside the best answer."""
        return self.nameless[1] <= CERTAIN

    @property
    def answer_set(self) -> list[str]:
        """The answer, the names that the recordings cannot tell from it, and "unnamed" where not all has a name."""
        names = [m.name for m in self.members]
        if self.answer == "unnamed":
            return ["unnamed", *names]
        return [*names, "unnamed"] if names and self.beside else names or [self.answer]

    @property
    def confidence(self) -> dict[str, float]:
        """Belief in each member of the set, its sum below 1 by what the shortlist lost."""
        return {m.name: m.weight for m in self.members} or {self.answer: 1.0 - ALARM}


@dataclass(frozen=True)
class Search:
    """What every round needs: the problems, the candidates as screened at the naive fit, the sensitivities to forces in
    training and held-out windows, and where progress is told."""

    bench: Bench
    candidates: tuple[Candidate, ...]
    pulses: Pulses
    held_out: Pulses
    progress: Callable[[str], None]

    def ranked(self, rivals: list[Explanation]) -> list[Explanation]:
        """Rivals by weight; of those that the data find about equal, the first of the catalogue leads."""
        weighed = weigh(self.bench, self.pulses, self.held_out, rivals)
        order = [c.placed.effect.name for c in self.candidates]
        even = [r for r in weighed if r.weight >= EVEN * weighed[0].weight]
        first = min(even, key=lambda r: order.index(r.placed[-1].effect.name), default=None)
        return sorted(weighed, key=lambda r: r is not first)


def name(bench: Bench, effects: Sequence[Effect], progress: Callable[[str], None] = print) -> Naming:
    """Find what is missing from the naive model of the recording behind `bench`."""
    simulator = bench.training.simulator
    naive = explain(*base_fit(bench, coordinates(simulator), Hypothesis(simulator.theta)))
    tried = proposals(effects, bench.training, scales(bench.training, naive.fitted.point))
    progress(f"screening {len(tried)} candidates")
    found = pulses(bench.training, naive.fitted), pulses(bench.held_out, naive.judged)
    naive = sharpened(bench, found[0], naive)
    search = Search(bench, tuple(screen(bench.training, naive.fitted, tried)), *found, progress)
    return _answer(search, naive, *build(search, naive))


def build(search: Search, naive: Explanation) -> tuple[list[Step], Explanation, list[Explanation]]:
    """Add the best effect and ask again, for as long as that is worthwhile and new: every round, the explanation they
    end with, and its rivals."""
    best, rivals, steps, known = naive, [], [], set()
    while len(best.placed) < LARGEST:
        steps.append(_step(search, best, TRACE * explained(search.pulses, naive.fitted, best.fitted)))
        if not steps[-1].rivals or not _worthwhile(search, naive, best, steps[-1]):
            break
        ranked = steps[-1].rivals
        if len(ranked[0].placed) > 1:
            ranked = _reconsider(search, ranked)
        if ranked[0].name in known:
            break  # what is left was weighed before: from here on names would take turns for ever
        known |= {r.name for r in ranked}
        further = sharpened(search.bench, search.pulses, numerics(search.bench, ranked[0]))
        if idle(further):
            break
        best, rivals = further, ranked
    return steps, best, rivals[1:]


def idle(explanation: Explanation) -> bool:
    """Whether an effect was added that, once fitted, does nothing: one step promised what its bounds do not allow."""
    return any(
        all(p.values[c.name] == p.effect.neutral[c.name] for c in p.effect.coefficients if not c.shape)
        for p in explanation.placed
    )


def _step(search: Search, current: Explanation, least: float = 0.0, refits: int = REFITS) -> Step:
    """Screen, and refit what is significant and predicted to gain more than `least`, the best `refits` of it."""
    bench, progress = search.bench, search.progress
    known = {p.name for p in current.placed}
    others = [c for c in search.candidates if c.placed.name not in known]
    fitted = coloured(current.fitted, search.pulses)
    screened = sorted(rescore(bench.training, fitted, others), key=lambda c: -c.gain)
    if not screened:
        return Step([], np.zeros(0), [])
    # What one step leaves of a large effect is no disturbance: there the disturbance before it is the better judge.
    judges = (fitted, screened), _beside(search, current.fitted, screened)
    p = np.minimum(*(family_p(search.pulses, *judge) for judge in judges))
    step = Step(screened, p, [])
    if step.least > (FURTHER if current.placed else ALARM) or screened[0].gain < least:
        return step
    rivals = []
    most = refits if len(bench.training.windows.runs) > EASY else MORE
    for candidate in shortlist(screened, most):
        progress(f"refitting with {candidate.placed.name}")
        rivals.append(refit(bench, current, candidate))
    rivals = [r for r in rivals if np.isfinite(r.deviance)]
    return replace(step, rivals=search.ranked(rivals))


def _beside(search: Search, fitted: Fit, screened: list[Candidate]) -> tuple[Fit, list[Candidate]]:
    """`fitted` and the candidates, in the same order, under the disturbance that is left beside the strongest."""
    apart = coloured(fitted, search.pulses, beside(fitted, search.pulses, screened[0].change))
    return apart, [score(search.bench.training, apart, c.placed, c.change) for c in screened]


def shortlist(screened: list[Candidate], most: int = REFITS) -> list[Candidate]:
    """The best probe of each effect and site, in falling order of predicted gain, as far as they are rivals or look
    like the best."""
    best: dict[str, Candidate] = {}
    for candidate in screened:
        best.setdefault(candidate.placed.name, candidate)
    ranked = [c for c in best.values() if c.gain > 0]
    # The larger an effect, the less can be said of it from one step.
    least = RIVAL * ranked[0].gain + min(RIVAL * ranked[0].gain / 2, CLEAR) if ranked else 0.0
    rivals = [c for c in ranked[:most] if c.gain >= least]
    twins = [c for c in ranked if c.gain < least and abs(alike(c, ranked[0])) > TWIN]
    return rivals + twins[: max(most - len(rivals), 1)]


def alike(one: Candidate, other: Candidate) -> float:
    """Cosine of the projected sensitivities."""
    return float((one.column * other.column).sum() / np.sqrt(one.information * other.information))


def _reconsider(search: Search, rivals: list[Explanation]) -> list[Explanation]:
    """Each effect in turn left out and asked for anew: what is superfluous goes, a surrogate gives way."""
    bench = search.bench
    for leaving in rivals[0].placed:
        rest = tuple(p for p in rivals[0].placed if p.name != leaving.name)
        reduced = without(bench, rivals[0], rest)
        if weigh(bench, search.pulses, search.held_out, [reduced, rivals[0]])[0].placed == reduced.placed:
            return [replace(reduced, weight=1.0)]
        found = _step(search, reduced, refits=SWAPS).rivals
        known = {r.name for r in rivals}
        rivals = search.ranked(rivals + [r for r in found if r.name not in known])
    return rivals


def _worthwhile(search: Search, naive: Explanation, current: Explanation, step: Step) -> bool:
    """Whether the best rival predicts held-out windows better, and a further one by more than a trace of what there was
    to explain. What training shows beyond doubt, a few held-out runs may fail to show by chance."""
    pushing = disturbance(step.rivals[0].fitted, search.pulses)
    shades = colour(search.pulses, pushing), colour(search.held_out, pushing)
    before, now, then = (predicted(search.bench, e, shades) for e in (naive, current, step.rivals[0]))
    if current.placed:
        return bool(now - then > max(TRACE * (before - now), 0.0))
    return bool(now - then > (-CHANCE if step.least <= SURE else 0.0))


def _answer(search: Search, naive: Explanation, steps: list[Step], best: Explanation, others) -> Naming:
    bench, found = search.bench, search.pulses
    pushing = disturbance(best.fitted, found)
    shades = colour(found, pushing), colour(search.held_out, pushing)
    spread = dispersion(best, generalised(both(bench, best), shades).deviances)
    (before, _), (after, more) = (nameless(bench, e.fitted, found) for e in (naive, best))
    left = more / max(more + max(explained(found, naive.fitted, best.fitted), 0.0), 1e-9)
    wide = spread * generalised([best.fitted], shades[:1]).covariance
    total = spread * pushing.noise**2
    return Naming(naive, steps, best, members(best, others), left, (before, after), total, wide, found)


def family_p(found: Pulses, fitted: Fit, screened: list[Candidate]) -> np.ndarray:
    """p of each candidate beside `fitted`, adjusted for all of them, (c,)."""
    columns = np.stack([c.column.ravel() for c in screened], 1)
    sides = np.array([two_sided(c.placed.effect) for c in screened])
    return adjusted(np.array([c.z for c in screened]), columns, sides, background(fitted, found))
