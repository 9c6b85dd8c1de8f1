"""Generalised: the least-squares optimum where disturbances are part of the noise, one linear step from a fit."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fimpact.mismatch.bounded import bounded
from fimpact.mismatch.colour import CLOCK, Colour
from fimpact.mismatch.fit import Fit, inverse

REWEIGHTED = 4  # passes; the first counts all windows alike
TRUST = 0.5  # of a coordinate's size: how far one linear step may go


@dataclass(frozen=True)
class Generalised:
    """The generalised least-squares optimum one linear step away: squares and samples of each window, (w,) for each set
    of windows, the step and the information on the coordinates, clocks not known, (k,) and (k, k), their scale, and how
    far it bends what was known of coordinates and clocks before, in squares."""

    squares: list[np.ndarray]
    samples: list[np.ndarray]
    step: np.ndarray
    information: np.ndarray
    scale: np.ndarray
    bent: float

    @property
    def covariance(self) -> np.ndarray:
        """Of the coordinates, (k, k)."""
        return inverse(self.information, self.scale)

    @property
    def total(self) -> float:
        """All deviances, and the prior's."""
        return float(sum(part.sum() for part in self.deviances)) + self.bent

    @property
    def deviances(self) -> list[np.ndarray]:
        """Of each window, (w,) each: `tempered` squares."""
        return [tempered(own, n) for own, n in zip(self.squares, self.samples, strict=True)]


def tempered(squares: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Squares up to the number of samples n, and n (1 + log(squares / n)) beyond, (w,): what fits worse than noise has
    noise of its own."""
    return np.minimum(squares, samples) + samples * np.log(np.maximum(squares / samples, 1.0))


def generalised(fits: Sequence[Fit], shades: Sequence[Colour]) -> Generalised:
    """The optimum near `fits`, which are of the same coordinates in several sets of windows; loud windows count less
    (iteratively reweighted)."""
    free, k = fits[0].coordinates, len(fits[0].coordinates.mean)
    linears = [shade.apply(fit.linear) for fit, shade in zip(fits, shades, strict=True)]
    ends = np.cumsum([k, *(linear.raw.shape[2] - k for linear in linears)])
    clock = np.ones(ends[-1] - k)
    prior, scale = np.append(free.sd, CLOCK * clock), np.append(free.scale, CLOCK * clock)
    z = np.append(free.read(fits[0].point.hypothesis), 0 * clock)
    far = np.append(TRUST * np.maximum(free.scale, np.abs(z[:k])), np.inf * clock)
    low, high = np.append(free.low, -np.inf * clock), np.append(free.high, np.inf * clock)
    low, high = np.maximum(low - z, -far), np.minimum(high - z, far)
    places = [np.append(np.arange(k), np.arange(*pair)) for pair in pairwise(ends)]
    lefts = [linear.off(fit.point.residual) for fit, linear in zip(fits, linears, strict=True)]
    samples = [fit.point.samples for fit in fits]
    weights = [np.ones(len(left)) for left in lefts]
    for _ in range(REWEIGHTED):
        hessian, slope = np.diag(prior**-2.0), np.append(-fits[0].pull, 0 * clock)
        for linear, left, place, weight in zip(linears, lefts, places, weights, strict=True):
            information, score = _weighted(linear.projected, left, weight)
            hessian[np.ix_(place, place)] += information
            slope[place] += score
        step = bounded(hessian, slope, scale, low, high)
        squares = [
            ((left - linear.projected @ step[place]) ** 2).sum(1)
            for linear, left, place in zip(linears, lefts, places, strict=True)
        ]
        weights = [1 / np.maximum(own / n, 1.0) for own, n in zip(squares, samples, strict=True)]
    aside = hessian[:k, k:] @ np.linalg.solve(hessian[k:, k:], hessian[k:, :k])
    bent = (((z + step - np.append(free.mean, 0 * clock)) / prior) ** 2).sum()
    return Generalised(squares, samples, step[:k], hessian[:k, :k] - aside, free.scale, float(bent))


def _weighted(projected: np.ndarray, left: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information (c, c) and score (c,) of windows that count by `weight`, (w,)."""
    own = projected * weight[:, None, None]
    return np.einsum("wma,wmb->ab", own, projected), np.einsum("wma,wm->a", own, left)
