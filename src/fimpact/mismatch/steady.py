"""Steady: a secant without the jumps that a collision makes of it."""

from collections.abc import Callable, Sequence

import numpy as np

OUTWEIGHS, OTHERS, JUMPS = 0.2, (0.2, 5.0), 0.5  # share of the information from which a window is tried at other shares

RIDGE = 1e-12  # of squared columns: what keeps columns that are all but one apart

Projection = Callable[[np.ndarray], np.ndarray]
Slope = Callable[[float, np.ndarray], np.ndarray]


def steadied(off: Projection, change: np.ndarray, again: Slope) -> np.ndarray:
    """`change`, (w, m), less the jumps: a window in which an impact comes a time step earlier may outweigh all others,
    and says nothing. It shows at one length of the secant and hardly at others.

    Args:
        off: takes out what initial states, and whatever else is fitted, imitate.
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


def together(off: Projection, known: np.ndarray, found: list[np.ndarray], slopes: Sequence[Slope]) -> list[np.ndarray]:
    """Changes `found`, (w, m) each, each steadied beside what is `known`, (w, m, k), and the others: the better they
    imitate one another, the less of one a jump has to outweigh.

    Args:
        off: takes out what initial states imitate, as it is of `known`. slopes: `again` of each.
    """
    found, free = list(found), np.concatenate([known, *(off(change)[:, :, None] for change in found)], 2)
    size = np.sqrt((free**2).sum((0, 1)))
    free = (free / np.where(size > 0, size, 1.0)).reshape(-1, len(size))
    gram = free.T @ free + RIDGE * np.eye(len(size))
    for j, slope in enumerate(slopes):
        rest = np.arange(len(size)) != known.shape[2] + j

        def apart(change: np.ndarray, rest: np.ndarray = rest) -> np.ndarray:
            own = off(change)
            along = np.linalg.solve(gram[np.ix_(rest, rest)], (free.T @ own.ravel())[rest])
            return own - (free[:, rest] @ along).reshape(own.shape)

        found[j] = steadied(apart, found[j], slope)
    return found
