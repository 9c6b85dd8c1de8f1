"""Runs of a case: their files, rows and columns, and their samples on the uniform grid."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from fimpact.cases.channels import Channel, Command
from fimpact.cases.errors import CaseError, listed
from fimpact.cases.quaternions import one_sign
from fimpact.cases.readers import Column, Table, read_table
from fimpact.cases.timebase import GAP, Series, checked_time, held, noise_factor, on_grid, stretches

FEWEST = 8  # samples of a run


@dataclass(frozen=True)
class Source:
    """Columns of one run before any conversion. origin: files and selection, for messages and comparison."""

    name: str
    table: Table
    held_out: bool
    origin: tuple
    start: float
    stop: float
    state: dict

    @property
    def where(self) -> str:
        """How messages name it."""
        return f"run '{self.name}' ({', '.join(Path(file).name for file in self.origin[0])})"


@dataclass(frozen=True)
class Sampled:
    """Series of one run: of each command (nu) and of each component of each channel (ny; None where it has none)."""

    source: Source
    commands: list[Series]
    measured: list[Series | None]


def sources(case: dict, root: Path) -> list[Source]:
    """Every run of a case; globs of arrays and `split` give several for one entry.

    Raises:
        CaseError: a file that cannot be read, a selection without rows, or two runs of one name.
    """
    files: dict[Path, Table] = {}
    out = [run for entry in case["runs"] for run in _entry_sources(entry, root, files)]
    names = [run.name for run in out]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise CaseError(f"two runs are named '{twice[0]}'; give each entry of `runs` a `name` of its own")
    return out


def file_paths(entry: dict, root: Path) -> list[Path]:
    """Data files of an entry of `runs`."""
    return [root / file for file in ([entry["file"]] if isinstance(entry["file"], str) else entry["file"])]


def _entry_sources(entry: dict, root: Path, files: dict[Path, Table]) -> Iterator[Source]:
    paths = file_paths(entry, root)
    for path in paths:
        if path not in files:
            files[path] = read_table(path)
    table, name = [column for path in paths for column in files[path]], entry.get("name", paths[0].stem)
    for label, part in _parts(entry, table, f"run '{name}' ({paths[0].name})"):
        full = label if entry.get("array") and "name" not in entry else " ".join(filter(None, (name, label)))
        origin = (tuple(map(str, paths)), label, repr(entry.get("select")), repr(entry.get("columns")))
        span = float(entry.get("start", 0.0)), float(entry.get("stop", np.inf))
        part = _renamed(part, entry.get("columns", {}), f"run '{full}'")
        yield Source(full, part, entry.get("held_out", False), origin, *span, entry.get("state", {}))


def _parts(entry: dict, table: Table, where: str) -> Iterator[tuple[str, Table]]:
    if "array" in entry:
        yield from _arrays(entry["array"], table, where)
        return
    for key, wanted in entry.get("select", {}).items():
        table = _rows(table, key, wanted if isinstance(wanted, list) else [wanted], where)
    if "split" not in entry:
        yield "", table
        return
    by = find(table, entry["split"], where)
    for value in dict.fromkeys(by.values.tolist()):
        label = f"{value:g}" if isinstance(value, float) else str(value)
        yield label, _rows(table, entry["split"], [value], where)


def _arrays(pattern: str, table: Table, where: str) -> Iterator[tuple[str, Table]]:
    parts: dict[str, Table] = {}
    for column in table:
        parts.setdefault(column.name.partition("[")[0], []).append(column)
    matching = {name: part for name, part in parts.items() if fnmatchcase(name, pattern)}
    if not matching:
        raise CaseError(f"{where}: no array is named like '{pattern}'; {listed(parts, pattern)}; correct `array`")
    for name, part in matching.items():
        yield name, [replace(column, name=column.name[len(name) :], group=name) for column in part]


def _rows(table: Table, key: str, wanted: list, where: str) -> Table:
    by = find(table, key, where)
    rows = np.isin(by.values.astype(str), [str(value) for value in wanted])
    if by.values.dtype.kind == "f":
        rows = np.isin(by.values, [float(value) for value in wanted if _number(value)])
    if not rows.any():
        values = list(dict.fromkeys(by.values.tolist()))
        raise CaseError(f"{where}: no row has {key} = {wanted[0]!r}; {listed(values, wanted[0])}; correct `select`")
    return [
        column.take(rows) if column.group == by.group and len(column.values) == len(rows) else column
        for column in table
    ]


def _number(value: object) -> bool:
    try:
        return bool(np.isfinite(float(value)))
    except (TypeError, ValueError):
        return False


def _renamed(table: Table, names: dict, where: str) -> Table:
    return table + [replace(find(table, column, where), name=name) for name, column in names.items()]


def find(table: Table, name: str | int, where: str, group: str | None = None) -> Column:
    """The column of a name (an index: of the only array), of one group where it has a column of that name.

    Raises:
        CaseError: there is none, or more than one.
    """
    name = f"[{name}]" if isinstance(name, int) else name
    found = [column for column in table if name in (column.name, f"{column.group}:{column.name}")]
    found = [column for column in found if column.group == group] or found
    if not found:
        names = [column.name for column in table]
        raise CaseError(f"{where}: there is no column '{name}'; {listed(dict.fromkeys(names), name)}; correct it")
    if len(found) > 1:
        names = [f"{column.group}:{column.name}" for column in found]
        raise CaseError(f"{where}: column '{name}' is there {len(found)} times; write one of {', '.join(names[:6])}")
    return found[0]


def sample(
    source: Source, time: dict, nan: str, commands: list[Command], channels: list[Channel], unit: float
) -> Sampled:
    """The series of a run in SI units, cut to its start and stop.

    Args:
        time: the table `time` of the case. nan: what a NaN in a file is, "error" or "missing".
        unit: seconds in the unit of time.

    Raises:
        CaseError: columns, times or numbers that are not right.
    """
    read = _Reader(source, time, nan, unit)
    ctrl = [read.series(c.column, c.time, c.factor, c.offset, c.actuator) for c in commands]
    lacking = [c.actuator for c, one in zip(commands, ctrl, strict=True) if one is None]
    if lacking:
        raise CaseError(f"{source.where}: the command of '{lacking[0]}' has no values; a simulation needs it; add them")
    seen = [read.series(column, c.time, c.factor, c.offset, c.sensor) for c in channels for column in c.columns]
    if not any(seen):
        raise CaseError(f"{source.where} holds no measured value at all; correct the columns or remove the run")
    seen = one_sign(seen, channels)
    known = [*ctrl, *filter(None, seen)]
    origin = min(one.time[0] for one in known)
    low, high = origin + source.start, origin + source.stop
    cut = [one and _cut(one, low, high, source.where) for one in (*ctrl, *seen)]
    return Sampled(source, cut[: len(ctrl)], cut[len(ctrl) :])


def _cut(series: Series, low: float, high: float, where: str) -> Series:
    inside = (series.time >= low) & (series.time <= high)
    if inside.sum() < FEWEST:
        raise CaseError(
            f"{where} has {inside.sum()} samples in a column; allowed: {FEWEST} or more; "
            "remove the run, or correct its start, stop or selection"
        )
    return Series(series.time[inside], series.value[inside])


@dataclass(frozen=True)
class _Reader:
    source: Source
    time: dict
    nan: str
    unit: float

    def series(self, name: str | int, own_time: str | int | None, scale: float, offset: float, what: str):
        """Samples of a column in SI units; None where it has no value in this run."""
        column = find(self.source.table, name, f"{self.source.where}, '{what}'")
        here = f"{self.source.where}, column '{column.name}'"
        present = self._present(column, here)
        if not present.any():
            return None
        time = self._times(column, own_time, here)
        if len(time) != len(column.values):
            raise CaseError(
                f"{here} has {len(column.values)} values but {len(time)} times; they must be as many; "
                "name its own `time`"
            )
        if present.sum() < FEWEST:
            raise CaseError(f"{here} has {present.sum()} samples; allowed: {FEWEST} or more; remove the run")
        series = Series(checked_time(time[present], here), (column.values[present] + offset) * scale)
        return _not_mostly_gaps(series, here)

    def _present(self, column: Column, here: str) -> np.ndarray:
        if column.values.dtype.kind not in "f":
            text = next((value for value in column.values.tolist() if not _number(value)), column.values[0])
            raise CaseError(
                f"{here} holds the text '{text}'; allowed: numbers with a decimal point, or an empty cell; correct it"
            )
        bad = np.flatnonzero(~np.isfinite(column.values) & ~column.absent)
        if bad.size and (self.nan == "error" or np.isinf(column.values[bad]).any()):
            raise CaseError(
                f"{here} is {column.values[bad[0]]} in row {bad[0]} ({bad.size} such rows); allowed: finite numbers; "
                "remove the rows, or, if NaN (never inf) stands for a sample that was not taken, write `nan: missing`"
            )
        return np.isfinite(column.values)

    def _times(self, column: Column, own: str | int | None, here: str) -> np.ndarray:
        name = self.time.get("column") if own is None else own
        if name is None:
            return np.arange(len(column.values)) / self.time["rate"]
        times = find(self.source.table, name, f"{here}, time", column.group)
        if times.values.dtype.kind != "f":
            raise CaseError(f"{here}: its time '{times.name}' is text; allowed: numbers or ISO dates; correct `time`")
        return times.values * self.unit


def _not_mostly_gaps(series: Series, here: str) -> Series:
    steps = np.diff(series.time)
    gaps = steps[steps > GAP * series.period].sum()
    if gaps > 0.5 * steps.sum():
        raise CaseError(
            f"{here} is missing for {gaps:.3g} s of {steps.sum():.3g} s; allowed: at most half; "
            "cut the run with `start` and `stop`, or split it"
        )
    return series


def pieces(run: Sampled, period: float) -> Iterator[tuple[str, float, int, np.ndarray]]:
    """Name, start in s, length T and measurements (T, ny) of the parts of a run in which every command is known."""
    bounds = run.commands or [one for one in run.measured if one]
    start = (max if run.commands else min)(one.time[0] for one in bounds)
    stop = (min if run.commands else max)(one.time[-1] for one in bounds)
    parts = stretches(run.commands, start, stop)
    for index, (low, high) in enumerate(parts):
        count = int((high - low) / period + 1e-6) + 1
        if len(parts) > 1 and count < FEWEST:
            continue
        columns = [on_grid(one, low, period, count) if one else np.full(count, np.nan) for one in run.measured]
        name = run.source.name + (f" part {index + 1}" if len(parts) > 1 else "")
        yield name, low, count, np.column_stack(columns)


def held_commands(run: Sampled, commands: list[Command], low: float, period: float, count: int) -> np.ndarray:
    """Commands (T, nu) from the time `low` on."""
    both = zip(run.commands, commands, strict=True)
    columns = [held(one, low, period, count, command.steps) for one, command in both]
    return np.column_stack(columns) if columns else np.zeros((count, 0))


def filtered_noise(sampled: list[Sampled], column: int, noise: float, period: float) -> float:
    """The noise of a component after the anti-alias filter."""
    periods = [run.measured[column].period for run in sampled if run.measured[column]]
    return noise * noise_factor(period, float(np.median(periods))) if periods else noise
