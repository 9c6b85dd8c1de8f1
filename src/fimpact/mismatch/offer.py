"""Offer: what numerics and start one explanation found for a window, to the others that fit it worse.

Where a collision falls between two time steps, several of them are at peace with themselves, ten squares and more
apart. Which one an explanation came to rest at is chance, and must not decide between rivals.
"""

from collections.abc import Sequence

import numpy as np

from fimpact.mismatch.fit import Fit, fit
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.settle import tried

# Squares of a window by which another must fit it better to be asked how, and by which that must help.
STRAY, SLIGHT = 9.0, 3.0


def offered(problem: Problem, fits: Sequence[Fit], offsets: Sequence[np.ndarray]) -> list[tuple[Fit, np.ndarray]]:
    """`fits` of one problem, each with numerics and start of the best of them in windows that these fit better, and
    with all its numerics, (w, T, ny).

    Args:
        offsets: numerics of each, (w, T, ny); those of `problem` are left as any of them.
    """
    squares = np.nan_to_num([f.point.squares for f in fits], nan=np.inf)
    best = squares.argmin(0)
    return [
        (_taken(problem, own, offset, fits, offsets, {w: best[w] for w in np.flatnonzero(lost)}), problem.offset)
        for own, offset, lost in zip(fits, offsets, squares > squares.min(0) + STRAY, strict=True)
    ]


def _taken(problem: Problem, own: Fit, offset: np.ndarray, fits, offsets, givers: dict[int, int]) -> Fit:
    """`own` fitted with what the `givers` of some windows offer, where that helps."""
    problem.offset = offset
    if not givers:
        return own
    rows = np.array(list(givers))
    states = (np.stack([getattr(fits[i].point, name)[w] for w, i in givers.items()]) for name in ("qpos", "qvel"))
    other = np.stack([offsets[i][w] for w, i in givers.items()]), *states
    start = tried(problem, own.coordinates, own.point, rows, other, SLIGHT)
    return own if start is own.point else fit(problem, own.coordinates, start, 12, own.linear, refresh=False)
