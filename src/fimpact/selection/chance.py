"""What chance may do: gains where nothing is missing, and sums over other stretches than those that were recorded."""

from functools import lru_cache

import numpy as np
from scipy import stats

from fimpact.deciding import BELIEF

DRAWS = 4000  # of stretches
RARE = float(stats.norm.sf(BELIEF))


def chance(gain: float, dispersion: float, added: int) -> float:
    """Chance of such a gain by as many columns where nothing is missing."""
    return float(stats.chi2.sf(max(gain, 0.0) / dispersion, max(added, 1)))


def least(better: np.ndarray) -> float:
    """Bound the sum of `better`, (stretches,), from below, whichever stretches were recorded.

    By the bootstrap of stretches (Efron, Annals of Statistics 7(1), 1979), as unlikely as `BELIEF` standard deviations:
    few stretches may gain much, and a standard error would take that for doubt.
    """
    return float(np.quantile(_resampled(len(better)) @ better, RARE))


@lru_cache
def _resampled(count: int) -> np.ndarray:
    """How often each of `count` stretches is drawn, (draws, count)."""
    return np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), DRAWS).astype(float)
