"""Naming: what was found missing, and the answer: a name, a set of them, "none" or "unnamed", and how sure."""

from dataclasses import dataclass

import numpy as np

from fimpact.effects.base import Placed
from fimpact.mismatch.disturbance import FEW
from fimpact.mismatch.explain import Explanation
from fimpact.mismatch.nameless import Stranger
from fimpact.mismatch.pulses import Pulses
from fimpact.mismatch.step import ALARM, FURTHER, Step
from fimpact.mismatch.tame import WILD
from fimpact.mismatch.weigh import members

UNNAMED = 0.15  # share of the explainable mismatch that a named answer may leave
FAR = 100.0  # squares of what is left, in those of the noise, that are not passed over whatever may have made them
CERTAIN = 0.005  # family-wise p at which what has no name is there, whatever is named
SEEMING = 0.05  # the same at which a named answer says that it need not be all
# Share of the explainable mismatch above which it says so, sure or not: a relative may stand in for it; and the same
# where it is no more likely chance than not.
LEFT, HINT, EVEN = 0.25, 0.1, 0.5
LARGEST = 3  # effects that are added, at most
# Share of right answers in 189 opened cases of the concealed benchmark, a power of the weight of the best among its
# rivals: relatives differ in second order, and between them a weight short of certain decides little. And what that is
# multiplied by where something beside it may be missing.
RIGHT, SHARP, DOUBTED = (0.56, 0.42), 8, 0.82
# Members from which an answer is less than even, and the factor: 3 of 13 opened ones were right.
CROWD, CROWDED = 6, 0.5


@dataclass(frozen=True)
class Naming:
    """The naive explanation, the steps, and the answer: `best` and the rivals that cannot be told from it.

    left: what the `stranger`, the strongest of what has no name, explains beside `best`, as a share of that and of
    what `best` explains. dispersion: of the windows' squares under `best`, 1: noise among disturbances; misfit: their
    mean, 1: noise. covariance: of the coordinates of `best`, disturbances counted. pulses: those in the training
    windows.
    """

    naive: Explanation
    steps: list[Step]
    best: Explanation
    members: list[Explanation]
    left: float
    stranger: Stranger
    dispersion: float
    misfit: float
    covariance: np.ndarray
    pulses: Pulses

    @property
    def found(self) -> list[Placed]:
        """The effects of the best explanation, in the order of the rounds that they led in first: each round asks what
        explains most of what is left. Which was fitted last is a matter of what was asked for anew."""
        leading = [{p.name for p in s.rivals[0].placed} if s.rivals else set() for s in self.steps]
        first = {
            p.name: next((i for i, names in enumerate(leading) if p.name in names), len(leading))
            for p in self.best.placed
        }
        return sorted(self.best.placed, key=lambda p: first[p.name])

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
        """The best name, "none", or "unnamed" where the best leaves too much that is neither noise nor disturbance, or
        what calls for a name has none that keeps its word."""
        forced = self.certain and self.left > UNNAMED
        wild = not self.few and (self.dispersion > WILD or self.p <= ALARM)
        called = wild or self.misfit > FAR
        return "unnamed" if forced or (called and not self.best.placed) else self.best.name

    @property
    def suspected(self) -> bool:
        """Whether names were asked for that alone could be chance, because something is there for certain."""
        return self.p > ALARM and bool(self.steps[0].rivals)

    @property
    def refused(self) -> list[Explanation]:
        """What was asked for where nothing kept its word: in the recordings that were learned from, these names cannot
        be told from one another."""
        rivals = [] if self.best.placed else self.steps[0].rivals
        return members(rivals[0], rivals[1:]) if rivals else []

    @property
    def few(self) -> bool:
        """Whether the training windows are too few to know what a disturbance does."""
        return len(self.pulses.time) < FEW

    @property
    def certain(self) -> bool:
        """Whether what has no name is there beside the best answer; a few windows cannot tell it from a disturbance."""
        return self.stranger.p <= CERTAIN and not self.few

    @property
    def beside(self) -> bool:
        """Whether something without a name may be there beside the best answer, or in its place: it seems so, much is
        left, the name was only suspected, or as many effects were added as may be, and none was asked for after
        them."""
        much = self.left > (HINT if self.stranger.p <= EVEN else LEFT)
        return self.seeming or self.suspected or much or len(self.best.placed) == LARGEST

    @property
    def seeming(self) -> bool:
        """Whether something without a name seems to be there beside the best answer: a force, or what calls for one of
        the catalogue though none of it was worth while."""
        refused = len(self.best.placed) < LARGEST and self.steps[-1].least <= FURTHER
        return refused or self.stranger.p <= SEEMING

    @property
    def answer_set(self) -> list[str]:
        """The answer, the names that the recordings cannot tell from it, and "unnamed" where not all has a name."""
        names = [m.name for m in self.members]
        if self.answer == "unnamed":
            return ["unnamed", *names, *(r.name for r in self.refused)]
        return [*names, "unnamed"] if names and self.beside else names or [self.answer]

    @property
    def contenders(self) -> list[Explanation]:
        """The members that an experiment may tell apart: none where as many effects as may be added leave what has no
        name. They stand in for that, and which of them does it best is no question worth a run."""
        standing_in = self.answer == "unnamed" and len(self.best.placed) == LARGEST
        return [] if standing_in else self.members

    @property
    def confidence(self) -> dict[str, float]:
        """Belief in each member of the set: the best's as often as one of its weight proved right, the others' no more
        than is left; the sum is below 1 by what has another name, or none."""
        if not self.members:
            return {self.answer: 1.0 - ALARM - CERTAIN}
        best, *others = self.members
        stated = (RIGHT[0] + RIGHT[1] * best.weight**SHARP) * (DOUBTED if self.beside else 1.0)
        stated *= CROWDED if len(self.members) >= CROWD else 1.0
        share = min(1.0, (1 - stated) / max(1 - best.weight, 1e-9))
        return {best.name: stated} | {m.name: m.weight * share for m in others}
