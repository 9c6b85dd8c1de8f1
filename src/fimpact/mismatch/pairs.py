"""Pairs: two effects that hide each other, of which neither is worth while alone.

Dry friction and drag that grows with speed both slow a pendulum, and one viscous coefficient between them takes up the
mean of the two: what each would add to it has the wrong sign at one end, and only both together fit.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fimpact.mismatch.score import Candidate, two_sided

APART = 0.98  # cosine of two sensitivities up to which their strengths can be told apart
HUGE = 1e3  # times its probe: a strength that no tangent vouches for
Pair = tuple[Candidate, Candidate]


def pairs(candidates: Sequence[Candidate], most: int) -> list[Pair]:
    """The best pairs by predicted gain, no two of the same names, each candidate at its strength beside the other."""
    gain, strength = gains(candidates)
    best: dict[frozenset[str], Pair] = {}
    for flat in np.argsort(-gain, axis=None):
        i, j = np.unravel_index(flat, gain.shape)
        if len(best) == most or gain[i, j] <= 0:
            break
        both = (replace(candidates[i], strength=strength[i, j]), replace(candidates[j], strength=strength[j, i]))
        best.setdefault(frozenset(c.placed.name for c in both), both)
    return list(best.values())


def gains(candidates: Sequence[Candidate]) -> tuple[np.ndarray, np.ndarray]:
    """Fall of the sum of squares, (c, c), that each pair predicts, 0 for what is no pair or cannot have its strengths;
    and the strength of the first of each, (c, c)."""
    columns = np.stack([c.column.ravel() for c in candidates], 1)
    # The prior's share of the information counts: parameters that it holds cannot take up all that one column is.
    size, score = np.sqrt([c.information for c in candidates]), np.array([c.shares.sum() for c in candidates])
    cosine = columns.T @ columns / np.outer(size, size)
    z = score / size
    with np.errstate(divide="ignore", invalid="ignore"):
        beside = (z[:, None] - cosine * z) / (1 - cosine**2)  # in units of its own standard deviation alone
    free = np.array([two_sided(c.placed.effect) for c in candidates])
    names = np.array([c.placed.name for c in candidates])
    possible = (np.abs(cosine) < APART) & (names[:, None] != names) & ((beside > 0) | free[:, None])
    possible &= np.abs(beside / size[:, None]) < HUGE
    gain = z[:, None] * beside + z * beside.T
    return np.where(np.triu(possible & possible.T, 1), gain, 0.0), beside / size[:, None]
