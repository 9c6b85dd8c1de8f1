"""Steady: a secant without the jumps that a collision makes of it."""

from collections.abc import Callable

import numpy as np

OUTWEIGHS, OTHERS, JUMPS = 0.2, (0.2, 5.0), 0.5  # share of the information from which a window is tried at other shares

Projection = Callable[[np.ndarray], np.ndarray]


def steadied(off: Projection, change: np.ndarray, again: Callable[[float, np.ndarray], np.ndarray]) -> np.ndarray:
    """`change`, (w, m), less the jumps: a window in which an impact comes a time step earlier may outweigh all others,
    and says nothing. It shows at one length of the secant and hardly at others.

    Args:
        off: takes out what initial states imitate.
        again: the change per unit in some windows, by a secant of so many times that length.
    """
    size = (off(change) ** 2).sum(1)
    rows = np.flatnonzero(size > OUTWEIGHS * size.sum())
    for share in OTHERS if len(rows) else ():
        other = change.copy()
        other[rows] = again(share, rows)
        calm = np.nan_to_num((off(other) ** 2).sum(1), nan=np.inf) < JUMPS * (off(change) ** 2).sum(1)
        change = np.where(calm[:, None], other, change)
    return change
