"""Rows of a column by time: rows out of order or doubled, and values that stand for several rows."""

import numpy as np

from fimpact.cases.errors import CaseError
from fimpact.cases.resampling import Series

FEWEST = 20  # samples that can decide anything
COARSE = 3.0  # resolutions: a step from which on the next row cannot show none, were it read anew
MOSTLY = 0.8  # of the values that stand for several rows, where a sensor is slower than the log


def ordered(time: np.ndarray, value: np.ndarray, rows: np.ndarray, where: str) -> tuple[np.ndarray, ...]:
    """Times, values and numbers of rows (n,), by time; of rows that are there twice, one.

    Raises:
        CaseError: two rows of one time differ.
    """
    by = np.argsort(time, kind="stable")
    time, value, rows = time[by], value[by], rows[by]
    twice = np.concatenate([[False], time[1:] == time[:-1]])
    unlike = np.flatnonzero(twice & np.concatenate([[False], value[1:] != value[:-1]]))
    if unlike.size:
        at = unlike[0]
        raise CaseError(
            f"{where}: rows {rows[at - 1]} and {rows[at]} are both of {time[at]:.15g} s and hold {value[at - 1]:.6g} "
            f"and {value[at]:.6g}; allowed with `sort`: rows that are the same; remove one of them"
        )
    return time[~twice], value[~twice], rows[~twice]


def refreshed(own: list[Series]) -> tuple[list[Series], int]:
    """The components of a sensor without the rows in which a value was written again, and for how many rows it stands.

    A value that does not change between two steps of several times its resolution, in one direction, was not read anew.
    """
    values = np.column_stack([one.value for one in own])
    steps = np.diff(values, axis=0)
    starts = np.concatenate([[0], np.flatnonzero(steps.any(axis=1)) + 1])
    stands = np.diff(starts)[1:]  # rows of each value between two steps
    large = np.zeros(len(stands), bool)
    for column in steps.T:
        sizes = column[starts[1:] - 1]
        smallest = np.min(np.abs(sizes[sizes != 0]), initial=np.inf)
        before, after = sizes[:-1] / smallest, sizes[1:] / smallest
        large |= (np.minimum(np.abs(before), np.abs(after)) >= COARSE) & (before * after > 0)
    if large.sum() < FEWEST or (stands[large] > 1).mean() < MOSTLY:
        return own, 1
    often = int(np.median(stands[large]))
    ends = [*starts[1:], len(values)]
    kept = np.concatenate([np.arange(low, high, often) for low, high in zip(starts, ends, strict=True)])
    return [Series(one.time[kept], one.value[kept]) for one in own], often
