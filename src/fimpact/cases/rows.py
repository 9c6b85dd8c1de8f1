"""What the rows of a column tell by themselves, for what is sampled is continuous: rows out of order or doubled, values
that stand for several rows, counters that wrapped, memory that was never filled, one column under two names."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from fimpact.cases.channels import Channel, Command
from fimpact.cases.errors import CaseError
from fimpact.cases.ties import BETTER, FEWEST, ODDS
from fimpact.cases.timebase import Series

BITS = (8, 16, 32)
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


def doubts(
    name: str, commands: list[Command], told: list[Series], channels: list[Channel], seen: list[Series | None]
) -> Iterator[tuple[str, str]]:
    """Kind and line of each doubt about the columns of the run `name`."""
    columns: list[tuple[str, Command | Channel, Series]]
    columns = [(f"the command of '{one.actuator}'", one, series) for one, series in zip(commands, told, strict=True)]
    components = [channel for channel in channels for _ in channel.columns]
    columns += [(f"'{one.sensor}'", one, series) for one, series in zip(components, seen, strict=True) if series]
    for what, entry, series in columns:
        raw = series.value / entry.factor - entry.offset
        yield from (("wrapped", f"run '{name}': {what} {line}") for line in _wrapped(raw))
        size = np.abs(series.value[series.value != 0])
        if size.size and np.max(size) < np.finfo(float).tiny:
            line = f"holds numbers such as {size[0]:.3g}: memory that was never filled, no readings; correct its column"
            yield "silent", f"run '{name}': {what} {line}"
    for (one, first, series), (other, second, same) in combinations(columns, 2):
        if one != other and len(series.value) == len(same.value) and _alike(series.value, same.value):
            line = (
                f"run '{name}': {one} and {other} hold the same numbers: column {_columns_of(first, second)} was taken"
            )
            yield "same", f"{line} for both; correct one of them"


def _columns_of(*entries: Command | Channel) -> str:
    names = [name for one in entries for name in (one.columns if isinstance(one, Channel) else (one.column,))]
    return " and ".join(f"'{name}'" for name in dict.fromkeys(names))


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    return np.ptp(one) > 0 and np.allclose(one[:8], other[:8], rtol=1e-9) and np.allclose(one, other, rtol=1e-9)


def _wrapped(raw: np.ndarray) -> Iterator[str]:
    """Whether whole numbers, were they signed, would go on where they jump."""
    whole = np.round(raw)
    if np.abs(raw - whole).max() > 1e-6 * max(1.0, np.abs(raw).max()) or whole.min() < 0:
        return
    for bits in BITS:
        size = 2.0**bits
        if not size / 2 <= whole.max() < size:
            continue
        signed = np.where(whole >= size / 2, whole - size, whole)
        jumps = int(np.sum(np.abs(np.diff(whole)) > size / 2))
        before, after = float(np.sum(np.diff(whole) ** 2)), float(np.sum(np.diff(signed) ** 2))
        if after < BETTER * before and 0.5 * jumps * np.log(before / max(after, 1.0)) > ODDS:
            yield (
                f"jumps by {size:.0f} between neighbouring rows, {jumps} times: a signed {bits}-bit number was read as "
                f"unsigned, and {size - 1:.0f} stands for -1; subtract {size:.0f} from what is above {size / 2 - 1:.0f}"
            )
