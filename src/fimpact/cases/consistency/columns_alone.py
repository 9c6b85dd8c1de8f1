"""What a column tells by itself, for what is sampled is continuous: counters that wrapped, memory never filled, and one
column under two names."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from fimpact.cases.channels import Channel, Command
from fimpact.cases.consistency.ties import BETTER, ODDS
from fimpact.cases.resampling import Series

BITS = (8, 16, 32)


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
