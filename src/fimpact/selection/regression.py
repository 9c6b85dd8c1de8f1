"""Blocked regression of a smoothed recording on its columns: everything that selection asks is algebra of small Grams.

Independent is a stretch, not a sample: each is predicted from the others, and where what is left is no white noise,
not from its neighbours either (Burman, Chow, Nolan, Biometrika 81(2), 1994); covariances are cluster-robust over them
(Liang and Zeger, Biometrika 73(1), 1986).
"""

import copy
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import stats

from fimpact.deciding import CONFIDENCE
from fimpact.smoothing.columns import Columns
from fimpact.smoothing.parameters import is_shape
from fimpact.smoothing.smoother import Smoothed
from fimpact.smoothing.step import occam
from fimpact.smoothing.stretches import spread_of_scores, stretches

ROUND_OFF = 1e-12  # of a column's information: what may tell it in one stretch alone is nothing elsewhere


@dataclass(frozen=True)
class Estimate:
    """Values (k,) of the columns `kept`, and loss of the fit."""

    kept: tuple[int, ...]
    values: np.ndarray
    loss: float


class Regression:
    """The data of a smoothed recording as a regression on `columns`; column numbers count from the first parameter."""

    def __init__(self, smoothed: Smoothed, columns: Columns):
        self.smoothed, self.columns = smoothed, columns
        self.p = len(smoothed.numbers)
        self.stretch = stretches(smoothed.track, smoothed.tau)
        self.count = int(self.stretch.max()) + 1
        rows = columns.innovations
        flat = rows.reshape(-1, rows.shape[2])
        owner = np.repeat(self.stretch, rows.shape[1])
        grams = np.empty((self.count, flat.shape[1], flat.shape[1]))
        for b, gram in enumerate(grams):
            own = flat[owner == b]
            np.matmul(own.T, own, out=gram)
        self.gram, self.right, self.square = grams[:, 1:, 1:], grams[:, 1:, 0], grams[:, 0, 0]
        self.weight, self.pull = self._priors()
        self.positive = np.zeros(self.gram.shape[1], bool)
        for i, (number, amplitude) in enumerate(columns.owners):
            candidate = columns.candidates[number]
            self.positive[self.p + i] = candidate.positive[amplitude]

    def _priors(self) -> tuple[np.ndarray, np.ndarray]:
        weight, pull = np.ones(self.gram.shape[1]), np.zeros(self.gram.shape[1])
        for i, n in enumerate(self.smoothed.numbers):
            weight[i], pull[i] = n.spread**-2, n.away / n.spread
        return weight, pull

    @cached_property
    def whole(self) -> np.ndarray:
        """What all stretches together tell of the columns, (columns, columns)."""
        return self.gram.sum(0)

    @cached_property
    def dispersion(self) -> float:
        """By how much scores vary more from stretch to stretch than white noise would have it, at least 1."""
        return self.spread(self.solve(range(self.p), 1.0))

    @property
    def white(self) -> bool:
        """Whether scores vary no more from stretch to stretch than white noise has it: then chance can be trusted, in
        however few stretches something shows."""
        return self.dispersion == 1

    def looks_white(self, spread: float) -> bool:
        """Whether scores of white noise may vary so much from stretch to stretch."""
        free = max(self.count - 1, 1)
        return spread * free <= float(stats.chi2.ppf(CONFIDENCE, free))

    def spread(self, found: Estimate) -> float:
        """The same of scores beside `found`."""
        left = self.right - self.gram[:, :, list(found.kept)] @ found.values
        return spread_of_scores(left, np.einsum("bii->i", self.gram))

    @cached_property
    def near(self) -> np.ndarray:
        """Which stretches, (stretches, stretches), are not independent of each: itself, and of what is no white noise
        those before and after it in its run."""
        runs = [part.start for part in self.smoothed.track.slices()]
        run = np.searchsorted(runs, np.flatnonzero(np.diff(self.stretch, prepend=-1)), "right")
        apart = np.abs(np.subtract.outer(np.arange(self.count), np.arange(self.count)))
        return ((apart <= (not self.white)) & (run[:, None] == run)).astype(float)

    def solve(self, kept: Sequence[int], weight: float | None = None) -> Estimate:
        """Ridge estimate of the columns `kept`; data count 1 / `weight`, None: as many as stretches are independent."""
        kept, weight = tuple(kept), self.dispersion if weight is None else weight
        if not kept:
            return Estimate((), np.zeros(0), float(self.square.sum()) / weight)
        whole, all_right = self.whole[np.ix_(kept, kept)] / weight, self.right.sum(0)[list(kept)] / weight
        prior, pull = np.diag(self.weight[list(kept)]), self.pull[list(kept)]
        values = _ridge(whole + prior, all_right + pull)
        # What a prior shifts is not seen by the data: the penalty is that of the values from its mean.
        loss = self.square.sum() / weight - 2 * values @ all_right + values @ whole @ values
        loss += values @ prior @ values - 2 * pull @ values
        return Estimate(kept, values, float(loss))

    def tension(self, found: Estimate) -> float:
        """Squared distance of the values of `found` from their priors, in sd, but for a constant; in the units of
        `errors`."""
        kept, values = list(found.kept), found.values
        return float(self.dispersion * (values**2 @ self.weight[kept] - 2 * self.pull[kept] @ values))

    def evidence(self, found: Estimate) -> float:
        """Logarithm of the marginal likelihood of `found`, but for a constant, of as much data as are independent."""
        kept = list(found.kept)
        information = self.whole[np.ix_(kept, kept)] / self.dispersion + np.diag(self.weight[kept])
        numbers = [self.smoothed.numbers[i] for i in kept if i < self.p]  # candidates are in units of their prior
        away = sum(n.away**2 for n in numbers)
        prior = occam(numbers, information[: len(numbers), : len(numbers)], self.smoothed.count)
        return -0.5 * float(found.loss + away + prior + np.linalg.slogdet(information)[1])

    def without(self, places: Collection[int]) -> "Regression":
        """The same data where the effects number `places` have been taken away; `smoothed` is still with them."""
        step = np.zeros(self.gram.shape[1])
        for i, n in enumerate(self.smoothed.numbers):
            if n.place in places and not is_shape(self.smoothed.placed[n.place], n.name):
                step[i] = -1.0 if n.log else -n.value
        other = copy.copy(self)
        other.right = self.right - self.gram @ step
        other.square = self.square - 2 * self.right @ step + np.einsum("i,bij,j->b", step, self.gram, step)
        return other

    def proper(self, kept: Sequence[int]) -> Estimate:
        """`solve` without the columns whose estimate has a sign that physics forbids."""
        kept = list(kept)
        while True:
            found = self.solve(kept)
            wrong = {c for c, v in zip(found.kept, found.values, strict=True) if self.positive[c] and v < 0}
            if not wrong:
                return found
            kept = [c for c in kept if c not in wrong]

    def elsewhere(self, found: Estimate) -> np.ndarray:
        """What the values of `found` would be without each stretch and those near it, (stretches, k)."""
        kept = list(found.kept)
        gram, right = self._grams(kept) / self.dispersion, self.right[:, kept] / self.dispersion
        whole = gram.sum(0) + np.diag(self.weight[kept])
        scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
        others = (whole - np.tensordot(self.near, gram, 1)) / np.outer(scale, scale) + ROUND_OFF * np.eye(len(kept))
        aim = (right.sum(0) - self.near @ right + self.pull[kept]) / scale
        return np.linalg.solve(others, aim[:, :, None])[:, :, 0] / scale

    def _grams(self, kept: list[int]) -> np.ndarray:
        """What each stretch tells of the columns `kept`, (stretches, k, k)."""
        return self.gram[:, np.array(kept, int)[:, None], kept]

    def errors(self, found: Estimate) -> np.ndarray:
        """Squared innovations, (stretches,), of each stretch as predicted from those elsewhere."""
        kept, values = list(found.kept), self.elsewhere(found)
        gram, right = self._grams(kept), self.right[:, kept]
        return self.square - 2 * (values * right).sum(1) + np.einsum("bi,bij,bj->b", values, gram, values)

    def forces_left(self, found: Estimate, trusted: bool) -> np.ndarray:
        """Squared missing force, (contact modes, nv), left where each stretch is predicted from those elsewhere; where
        chance is `trusted` from all of them: of what shows in one stretch alone, no other tells how much it is."""
        rows = self.columns.forces
        kept = [1 + c for c in found.kept]
        values = np.broadcast_to(found.values, (len(rows), len(kept)))
        values = values if trusted else self.elsewhere(found)[self.stretch]
        left = rows[:, :, 0] - np.einsum("kjc,kc->kj", rows[:, :, kept], values)
        return self.smoothed.levels.summed(left**2)

    def force_of(self, before: Estimate, after: Estimate) -> np.ndarray | None:
        """Squared force, (contact modes, nv), that would do what `after` does beside `before`; None where the smoother
        sees it."""
        whole = self.columns.whole
        if whole is None:
            return None
        step = np.zeros(whole.shape[2])
        step[list(after.kept)] += after.values
        step[list(before.kept)] -= before.values
        return self.smoothed.levels.summed((whole @ step) ** 2)

    def scores(self, found: Estimate) -> np.ndarray:
        """Score of each stretch for the kept columns, (stretches, k)."""
        kept = list(found.kept)
        return self.right[:, kept] - self._grams(kept) @ found.values

    def covariance(self, found: Estimate, clusters: np.ndarray | None = None) -> np.ndarray:
        """Cluster-robust covariance, (k, k), at least that of white noise in every direction of a column.

        Args:
            clusters: cluster of each stretch, (stretches,); None: each its own.
        """
        kept = list(found.kept)
        whole, prior = self.whole[np.ix_(kept, kept)], np.diag(self.weight[kept])
        white = inverse(whole + prior)
        bread, scores = inverse(whole / self.dispersion + prior), self.scores(found) / self.dispersion
        if clusters is not None:
            scores = np.array([scores[clusters == c].sum(0) for c in np.unique(clusters)])
        meat = scores.T @ scores * len(scores) / max(len(scores) - 1, 1)
        robust = bread @ meat @ bread
        wider = np.sqrt(np.maximum(np.diag(white) / np.maximum(np.diag(robust), 1e-300), 1.0))
        return robust * np.outer(wider, wider)

    def gain(self, before: Estimate, after: Estimate) -> tuple[float, float]:
        """By how much `after` fits better than `before`, whose columns it holds, and the dispersion of that.

        The first over the second is chi-squared with as many degrees as columns were added.
        """
        step = np.zeros(self.gram.shape[1])
        step[list(after.kept)] += after.values
        step[list(before.kept)] -= before.values
        along = self.scores(after) @ step[list(after.kept)]
        gain = self.dispersion * (before.loss - after.loss)
        return gain, max(1.0, float((along**2).sum() / gain)) if gain > 0 else 1.0


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric matrix whose columns may differ in size by orders of magnitude."""
    scale = np.sqrt(np.where(np.diag(matrix) > 0, np.diag(matrix), 1.0))
    return np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)


def _ridge(gram: np.ndarray, right: np.ndarray) -> np.ndarray:
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    return np.linalg.lstsq(gram / np.outer(scale, scale), right / scale, rcond=1e-12)[0] / scale
