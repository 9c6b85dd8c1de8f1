"""Runs of a case: their samples, in SI units, on the uniform grid."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fimpact.cases.angles import unwrapped
from fimpact.cases.channels import Channel, Command
from fimpact.cases.errors import CaseError
from fimpact.cases.quaternions import continuous_sign, drop_invalid
from fimpact.cases.raw_runs import Source, find, is_number
from fimpact.cases.readers.columns import Column
from fimpact.cases.resampling import (
    GAP,
    HELD,
    Series,
    checked_time,
    noise_factor,
    on_grid,
    valid_intervals,
    zero_order_hold,
)
from fimpact.cases.row_order import ordered, refreshed
from fimpact.cases.units import factor

FEWEST = 8  # samples of a run
LARGEST = 1e9  # of what is measured or commanded, in SI units
PERIODS = (1e-7, 100.0)  # s between samples


@dataclass(frozen=True)
class ResampledRun:
    """Series of one run: of each command (nu) and of each component of each channel (ny; None where it has none).

    notes: about how it was read. period: of the rows of the quickest channel, s, whether or not they were read anew:
    the commands between them count.
    """

    source: Source
    commands: list[Series]
    measured: list[Series | None]
    notes: tuple[str, ...] = ()
    period: float = 0.0


def resample(
    source: Source, time: dict, nan: str, commands: list[Command], channels: list[Channel], unit: float
) -> ResampledRun:
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
    seen = unwrapped(continuous_sign(drop_invalid(seen, channels, nan, source.where), channels), channels)
    known = [*ctrl, *filter(None, seen)]
    origin = min(one.time[0] for one in known)
    low, high = origin + source.start, origin + source.stop
    cut = [one and _cut(one, low, high, source.where) for one in (*ctrl, *seen)]
    fresh, notes = _refreshed(channels, cut[len(ctrl) :])
    period = min(one.period for one in cut[len(ctrl) :] if one)
    return ResampledRun(source, cut[: len(ctrl)], fresh, notes, period)


def _refreshed(channels: list[Channel], seen: list[Series | None]):
    """The series without rows in which a sensor's value was only written again, and a line about each such sensor."""
    out, notes, at = list(seen), [], 0
    for channel in channels:
        place = slice(at, at + len(channel.columns))
        at = place.stop
        own = [one for one in seen[place] if one]
        if len(own) == len(channel.columns) and len({one.time.tobytes() for one in own}) == 1:
            fresh, often = refreshed(own)
            out[place] = fresh
            if often > 1:
                notes.append(
                    f"each value of '{channel.sensor}' stands for {often} rows; it counts as read "
                    f"every {fresh[0].period:.4g} s, in the first of them"
                )
    return out, tuple(notes)


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
        time, values, rows = time[present], column.values[present], column.numbers[present]
        if self.time.get("sort"):
            time, values, rows = ordered(time, values, rows, here)
        with np.errstate(over="ignore"):
            series = Series(checked_time(time, here, rows), (values + offset) * scale)
        return _not_mostly_gaps(_measurable(series, here), here)

    def _present(self, column: Column, here: str) -> np.ndarray:
        if column.values.dtype.kind not in "f":
            there = column.values[~column.absent].tolist()
            text = next((value for value in there if not is_number(value)), column.values[0])
            raise CaseError(
                f"{here} holds the text '{text}'; allowed: numbers with a decimal point, or an empty cell; correct it"
            )
        bad = np.flatnonzero(~np.isfinite(column.values) & ~column.absent)
        if bad.size and (self.nan == "error" or np.isinf(column.values[bad]).any()):
            row = column.numbers[bad[0]]
            raise CaseError(
                f"{here} is {column.values[bad[0]]} in row {row} ({bad.size} such rows); allowed: finite numbers; "
                "remove the rows, or, if NaN (never inf) stands for a sample that was not taken, write `nan: missing`"
            )
        return np.isfinite(column.values)

    def _times(self, column: Column, own: str | int | None, here: str) -> np.ndarray:
        name = self.time.get("column") if own is None else own
        if name is None:
            return np.arange(len(column.values)) / self.time["rate"]
        times = self._clock(name, column.group, here)
        if times.clock and self.unit != 1.0:
            raise CaseError(f"{here}: its time '{times.name}' holds dates, which count as s; write `unit: s`")
        if own is not None or "fraction" not in self.time:
            return times.values * self.unit
        fraction = self.time["fraction"]
        rest = self._clock(fraction["column"], times.group, here)
        if len(rest.values) != len(times.values):
            raise CaseError(
                f"{here}: `time.fraction` has {len(rest.values)} values, time {len(times.values)}; correct it"
            )
        return times.values * self.unit + rest.values * factor(fraction["unit"], "s", "time.fraction")

    def _clock(self, name: str | int, group: str, here: str) -> Column:
        times = find(self.source.table, name, f"{here}, time", group)
        if times.values.dtype.kind != "f":
            raise CaseError(f"{here}: its time '{times.name}' is text; allowed: numbers or ISO dates; correct `time`")
        return times


def _measurable(series: Series, here: str) -> Series:
    largest = np.abs(series.value).max()
    if not largest <= LARGEST:
        raise CaseError(
            f"{here} goes up to {largest:.4g} in SI units, which nothing measures; allowed: up to {LARGEST:g}; "
            "correct the column, its unit or its scale"
        )
    low, high = PERIODS
    if not low <= series.period <= high:
        raise CaseError(
            f"{here} has a sample every {series.period:.4g} s; allowed: every {low:g} to {high:g} s; correct time.unit"
        )
    return series


def _not_mostly_gaps(series: Series, here: str) -> Series:
    steps = np.diff(series.time)
    gaps = steps[steps > GAP * series.period].sum()
    if gaps > 0.5 * steps.sum():
        raise CaseError(
            f"{here} is missing for {gaps:.3g} s of {steps.sum():.3g} s; allowed: at most half; "
            "cut the run with `start` and `stop`, or split it"
        )
    return series


def contiguous_segments(run: ResampledRun, period: float, least: int) -> Iterator[tuple[str, bool, float, np.ndarray]]:
    """Name, whether it opens the run, start in s, and measurements (T, ny) of the parts of a run in which every command
    is known; parts of fewer than `least` samples are left out.

    Raises:
        CaseError: measurements of another time than the commands, or no part that is long enough.
    """
    bounds = run.commands or [one for one in run.measured if one]
    start = (max if run.commands else min)(one.time[0] for one in bounds)
    stop = (min if run.commands else max)(one.time[-1] for one in bounds)
    for one in filter(None, run.measured if run.commands else []):
        if start >= stop or one.time[-1] < start or one.time[0] > stop:
            raise CaseError(
                f"{run.source.where}: every command is known from {start:.9g} to {stop:.9g} s only, but a measurement "
                f"goes from {one.time[0]:.9g} to {one.time[-1]:.9g} s; all times must be of one clock; correct `time`"
            )
    parts = [(_at_sample(run, low, period), high) for low, high in valid_intervals(run.commands, start, stop)]
    counts = [max(0, int((high - low) / period + 1e-6) + 1) for low, high in parts]
    if len(parts) > 1 and max(counts) < least:
        raise CaseError(
            f"{run.source.where}: its commands have {len(parts) - 1} gaps of more than {HELD:g} periods, and the "
            f"longest part between them has {max(counts)} samples of {period:.6g} s; allowed: {least} or more; "
            "make the window shorter, complete the commands, or remove the run"
        )
    for index, ((low, _), count) in enumerate(zip(parts, counts, strict=True)):
        if len(parts) > 1 and count < least:
            continue
        columns = [on_grid(one, low, period, count) if one else np.full(count, np.nan) for one in run.measured]
        name = run.source.name + (f" part {index + 1}" if len(parts) > 1 else "")
        yield name, index == 0, low, np.column_stack(columns)


def _at_sample(run: ResampledRun, low: float, period: float) -> float:
    """The first sample of the quickest channel from `low` on, if there is one soon: commands are averaged over any
    period, but what is measured between samples has to be interpolated."""
    quickest = min(filter(None, run.measured), key=lambda one: one.period)
    later = quickest.time[quickest.time >= low - 1e-6 * period]
    return float(later[0]) if len(later) and later[0] < low + quickest.period else low


def held_commands(run: ResampledRun, commands: list[Command], low: float, period: float, count: int) -> np.ndarray:
    """Commands (T, nu) from the time `low` on."""
    both = zip(run.commands, commands, strict=True)
    columns = [zero_order_hold(one, low, period, count, command.steps) for one, command in both]
    return np.column_stack(columns) if columns else np.zeros((count, 0))


def filtered_noise(sampled: list[ResampledRun], column: int, noise: float, period: float) -> float:
    """The noise of a component after the anti-alias filter."""
    periods = [own.period for run in sampled if (own := run.measured[column])]
    return noise * noise_factor(period, float(np.median(periods))) if periods else noise
