"""Step: one round of naming. Screen every candidate beside what is fitted, refit the best few, weigh what they predict.

Which are best is asked three times, because a large effect swells what passes for disturbances until its own name
drowns in them: as screened, as if nothing but the sensors disturbed, and under what the best refitted so far leaves.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fimpact.mismatch.calibrate import adjusted, background, carried
from fimpact.mismatch.colour import beside, coloured
from fimpact.mismatch.disturbance import disturbance
from fimpact.mismatch.explain import Explanation, corrected, refit, shapes_of
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.merge import merged
from fimpact.mismatch.pairs import pairs
from fimpact.mismatch.pulses import Pulses
from fimpact.mismatch.score import Candidate, rescore, scores, two_sided
from fimpact.mismatch.tame import WILD
from fimpact.mismatch.touch import can_touch
from fimpact.mismatch.weigh import dispersion, generalises, leading, led_by, members, weigh

# Family-wise p at which a named effect is found; CERTAIN comes on top. Of 301 opened cases with nothing planted eight
# had p of at most 0.005 and three of at most 0.002.
ALARM = 0.002
SEEN = 4.0  # times its p counts that of a judge who has seen what the strongest candidate leaves
FURTHER = 0.01  # the same for each further effect
REFITS = 8  # candidates that are truly refitted in each step
EASY, MORE = 20, 24  # windows up to which that costs little, and how many are refitted then
LOUD, AGAIN = 4, 2  # the most refitted of each further ranking, and how often the best may be asked what it leaves
PAIRS = 4  # pairs refitted of each ranking, where no single candidate is worth while and little is explained
# Share of the best candidate's predicted gain below which a candidate is not refitted; and the same where nothing is
# near the noise, and what one step promises is no order to rely on.
RIVAL, STRANGE = 0.4, 0.1
CLEAR = 10.0  # what comes on top of that for small gains, half of that share at most
TWIN = 0.8  # cosine with a candidate to be refitted above which one is refitted whatever it is predicted to gain
HOPELESS = 50.0  # log-likelihood by which training windows rule out what is not followed to its optimum
CLOSE = 1e-4  # weight, relative to the likeliest, above which the error of the time step could change the order
VOID = 1e-4  # squares by which a shape's whole scale must change predictions to mean anything


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
class Search:
    """What every round needs: the problems, the candidates as screened at the naive fit, the sensitivities to forces in
    training and held-out windows, and where progress is told."""

    bench: Bench
    candidates: tuple[Candidate, ...]
    pulses: Pulses
    held_out: Pulses
    progress: Callable[[str], None]

    def ranked(self, rivals: list[Explanation]) -> list[Explanation]:
        """Rivals by weight; of those that the data find about equal, the first of the catalogue leads, or a `plainer`
        one."""
        weighed = weigh(self.bench, self.pulses, self.held_out, rivals)
        if not weighed:
            return []
        first = plainer(leading(weighed, [c.placed.effect.name for c in self.candidates]), weighed)
        return led_by(first, weighed)

    def compared(self, rivals: list[Explanation]) -> list[Explanation]:
        """`rivals` that could be simulated, ranked, each that may be the likeliest with numerics of its own."""
        found = self.ranked([r for r in rivals if np.isfinite(r.deviance)])
        while rough := [r for r in found if not r.exact and self._may_lead(r, found)]:
            own = {r.name: r for r in corrected(self.bench, rough)}
            found = self.ranked([own.get(r.name, r) for r in found])
        return found

    def _may_lead(self, rival: Explanation, found: list[Explanation]) -> bool:
        """Whether `rival` comes near the likeliest of those `found`, or things collide and nothing is near the noise:
        there another's numerics may cost it more squares than any two explanations are apart."""
        wild = found[0].loudness > WILD and can_touch(self.bench.training.simulator.base)
        return wild or rival.weight >= CLOSE * max(r.weight for r in found)


def step(search: Search, current: Explanation, least: float = 0.0, refits: int = REFITS, alarm: float = ALARM) -> Step:
    """Screen, and refit what is significant and predicted to gain more than `least`, the best `refits` of it; `alarm`:
    the family-wise p up to which a first effect is significant."""
    bench = search.bench
    known = {p.name for p in current.placed}
    others = [c for c in search.candidates if c.placed.name not in known]
    fitted = coloured(current.fitted, search.pulses)
    screened = _by_gain(fitted, others)
    if not screened:
        return Step([], np.zeros(0), [])
    # What one step leaves of a large effect is no disturbance: there the disturbance before it is the better judge.
    judges = (fitted, screened), _beside(search, current.fitted, screened)
    alone, apart = (family_p(search.pulses, *judge, fitted) for judge in judges)
    p = np.minimum(alone, SEEN * apart)
    found = Step(screened, p, [])
    if found.least > (FURTHER if current.placed else alarm) or screened[0].gain < least:
        return found
    most = refits if len(bench.training.windows.runs) > EASY else MORE
    mixed = merged(fitted, screened)
    return replace(found, rivals=_rivals(search, current, sorted([*screened, *mixed], key=lambda c: -c.gain), most))


def _rivals(search: Search, current: Explanation, screened: list[Candidate], most: int) -> list[Explanation]:
    """The best of each ranking, refitted, by weight."""
    loud = shortlist(_by_gain(current.fitted, screened), min(most, LOUD))
    rivals = _refitted(search, current, [], [*shortlist(screened, most), *loud])
    if rivals and rivals[0].loudness > WILD:
        rivals = _refitted(search, current, rivals, shortlist(screened, most, STRANGE))
    for _ in range(AGAIN):
        if not rivals:
            break
        left = coloured(current.fitted, search.pulses, disturbance(rivals[0].fitted, search.pulses))
        found = _refitted(search, current, rivals, shortlist(_by_gain(left, screened), min(most, LOUD)))
        if len(found) == len(rivals):
            break
        rivals = found
    return rivals


def plainer(first: Explanation, rivals: list[Explanation]) -> Explanation:
    """`first`, or the best of the `rivals` that says the same without the shape that means nothing where `first` has
    come to rest: it leads, and `first`, which the data cannot refute, stays beside it."""
    if not _void(first):
        return first
    kin = (r for r in members(first, rivals) if len(r.placed) == len(first.placed) and generalises(first, r))
    return next((r for r in kin if not _void(r)), first)


def _void(rival: Explanation) -> bool:
    """Whether all of a shape's scale would change predictions by next to nothing."""
    fitted, shapes = rival.fitted, shapes_of(rival.placed)
    rows = [fitted.coordinates.unknowns + fitted.coordinates.values.index(shape) for shape in shapes]
    return any(fitted.precision[row, row] * fitted.scale[row] ** 2 < VOID for row in rows)


def together(search: Search, current: Explanation, alone: Step) -> Step:
    """The step with pairs of effects as rivals, the best as screened and as if only the sensors disturbed."""
    louder = _by_gain(current.fitted, alone.screened)
    tried = {frozenset(c.placed.name for c in pair): pair for s in (louder, alone.screened) for pair in pairs(s, PAIRS)}
    rivals = []
    for pair in tried.values():
        search.progress(f"refitting with {' and '.join(c.placed.name for c in pair)}")
        rivals.append(refit(search.bench, current, *pair))
    return replace(alone, rivals=search.compared(rivals))


def _by_gain(fitted: Fit, candidates: list[Candidate]) -> list[Candidate]:
    return sorted(rescore(fitted, candidates), key=lambda c: -c.gain)


def _refitted(
    search: Search, current: Explanation, rivals: list[Explanation], wanted: list[Candidate]
) -> list[Explanation]:
    """`rivals` and those `wanted` that are not among them, ranked."""
    known, new = {r.placed[-1].name for r in rivals}, {}
    for candidate in wanted:
        new.setdefault(candidate.placed.name, candidate)
    for candidate in (c for n, c in new.items() if n not in known):
        search.progress(f"refitting with {candidate.placed.name}")
        rivals = [*rivals, refit(search.bench, current, candidate, worst=_worst(rivals))]
    return search.compared(rivals)


def _worst(rivals: list[Explanation]) -> float:
    """Cost from which another is `HOPELESS` beside the best of the `rivals`, where windows are dispersed as they are;
    inf where nothing is near the noise, and what one step promises is no order to rely on."""
    fits = [rival.fitted for rival in rivals if np.isfinite(rival.deviance)]
    best = min(fits, key=lambda fitted: fitted.point.cost, default=None)
    spread = dispersion([best], [best.point.squares], 1.0) if best else np.inf
    return best.point.cost + HOPELESS * spread if spread <= WILD else np.inf


def _beside(search: Search, fitted: Fit, screened: list[Candidate]) -> tuple[Fit, list[Candidate]]:
    """`fitted` and the candidates, in the same order, under the disturbance that is left beside the strongest."""
    apart = coloured(fitted, search.pulses, beside(fitted, search.pulses, screened[0].change))
    return apart, scores(apart, [c.placed for c in screened], [c.change for c in screened])


def shortlist(screened: list[Candidate], most: int = REFITS, share: float = RIVAL) -> list[Candidate]:
    """The best probe of each effect and site, in falling order of predicted gain, as far as they are rivals, which gain
    that `share` of what the best does, or look like one."""
    best: dict[str, Candidate] = {}
    for candidate in screened:
        best.setdefault(candidate.placed.name, candidate)
    ranked = [c for c in best.values() if c.gain > 0]
    # The larger an effect, the less can be said of it from one step.
    least = share * ranked[0].gain + min(share * ranked[0].gain / 2, CLEAR) if ranked else 0.0
    rivals = [c for c in ranked[:most] if c.gain >= least]
    twins = [c for c in ranked[len(rivals) :] if any(abs(alike(c, r)) > TWIN for r in rivals)]
    return rivals + twins[: max(most - len(rivals), 1)]


def alike(one: Candidate, other: Candidate) -> float:
    """Cosine of the projected sensitivities."""
    return float((one.column * other.column).sum() / np.sqrt(one.information * other.information))


def family_p(found: Pulses, fitted: Fit, screened: list[Candidate], before: Fit) -> np.ndarray:
    """p of each candidate beside `fitted`, adjusted for all of them, (c,); `before`: the fit under the disturbance that
    is left where nothing has been taken for an effect."""
    columns = np.stack([c.column.ravel() for c in screened], 1)
    sides = np.array([two_sided(c.placed.effect) for c in screened])
    lasting = carried(fitted, found, columns, before)
    return adjusted(np.array([c.z for c in screened]), columns, sides, background(fitted, found), lasting)
