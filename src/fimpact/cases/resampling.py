"""Samples at the times at which they were taken, put on one uniform grid.

A grid point holds a measurement only where a sample was really taken beside it; elsewhere it is NaN.
So gaps and slower sensors need no rule of their own, and nothing is invented in between.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from fimpact.cases.errors import CaseError

GAP = 2.5  # periods between samples of one channel from which on they are separate pieces
HELD = 10.5  # periods for which a command is believed to be held where the log has no line
CLOSE = 1e-6  # of a period, which is rounding: a stamp that far off a point of the grid is meant to be there
NEARBY = 20  # rows: so far at most a row of a bag stands from its place; further off, a recording begins anew
TAPS = 10  # half-length of the anti-alias filter in periods of the new grid


@dataclass(frozen=True)
class Series:
    """Samples (n,) and their times (n,) in s, increasing."""

    time: np.ndarray
    value: np.ndarray

    @property
    def period(self) -> float:
        """Time between samples that come evenly but for jitter, rounding and some that are missing, s."""
        steps = np.diff(self.time)
        usual = np.median(steps)
        steps = steps[steps <= GAP * usual]
        return float(steps.sum() / np.round(steps / usual).sum())


def checked_time(time: np.ndarray, where: str, rows: np.ndarray) -> np.ndarray:
    """`time` (n,), if it is finite and increases.

    Args:
        rows: of each of them in the file, (n,).

    Raises:
        CaseError: a time that is missing, repeated or goes back; the line gives its row.
    """
    if not np.isfinite(time).all():
        row = rows[np.flatnonzero(~np.isfinite(time))[0]]
        raise CaseError(f"{where}: time is missing in row {row}; every sample needs a time; remove the row")
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        at = int(late[0])
        kind = "repeated" if time[at] == time[at + 1] else "backward"
        near = np.max(np.abs(np.argsort(time, kind="stable") - np.arange(len(time)))) <= NEARBY
        whole = kind == "repeated" and np.array_equal(time, np.round(time))
        raise CaseError(
            f"{where}: time is {kind}: {time[at]:.15g} s is followed by {time[at + 1]:.15g} s in row {rows[at + 1]} "
            f"({late.size} such rows); it must increase; "
            + ("name the column with the fraction of a second as `time.fraction`, or " if whole else "")
            + ("write `sort: true` under `time`, which sorts rows and drops doubled ones, or " if near else "")
            + "remove these rows, or `split` the file into runs"
        )
    return time


def on_grid(series: Series, start: float, period: float, count: int) -> np.ndarray:
    """A measurement at ``start + k period``, (count,), NaN where none was taken.

    Samples that come at least 1.5 times as often as the grid are low-passed before: linear phase, -6 dB at the new
    Nyquist frequency, where its zero crossings leave white noise white.
    """
    factor = round(period / series.period)
    series = _relative(series, start, period / max(1, factor))
    if factor < 2:
        # At about the grid's rate, jitter may open an interval of 1.5 periods; slower samples count once.
        reach = 0.76 if series.period < 1.5 * period else 0.51
        return _sampled(series, period * np.arange(count), period, reach)
    fine = period / factor
    dense = _sampled(series, fine * np.arange(count * factor), fine, reach=GAP / 2)
    return _low_passed(dense, factor)[::factor]


def _relative(series: Series, start: float, period: float) -> Series:
    """The series with times from `start` on, free of the rounding of stamps, so that logs of any format are one."""
    time = series.time - start
    points = period * np.round(time / period)
    return Series(np.where(np.abs(time - points) < CLOSE * period, points, time), series.value)


def noise_factor(period: float, samples: float) -> float:
    """By what the anti-alias filter multiplies the noise of samples that come every `samples` s."""
    factor = round(period / samples)
    return float(np.sqrt(np.sum(_taps(factor) ** 2))) if factor > 1 else 1.0


def _sampled(series: Series, grid: np.ndarray, period: float, reach: float) -> np.ndarray:
    if len(series.time) < 2:
        return np.full(len(grid), np.nan)
    after = np.clip(np.searchsorted(series.time, grid), 1, len(series.time) - 1)
    distance = np.minimum(np.abs(grid - series.time[after - 1]), np.abs(series.time[after] - grid))
    # Within rounding of the ends, the ends: extrapolation would amplify their noise.
    inside = np.clip(grid, series.time[0], series.time[-1])
    # Cubics through the samples, with slopes of parabolas through each three: linear in the noise and blind to what is
    # further away, such as an impact. A shape-preserving spline would cut off every turning point.
    value = CubicHermiteSpline(series.time, series.value, np.gradient(series.value, series.time))(inside)
    return np.where(distance <= reach * period, value, np.nan)


def _taps(factor: int) -> np.ndarray:
    from scipy.signal import firwin  # it takes half a second to import, and few logs are decimated

    return firwin(2 * TAPS * factor + 1, 1 / factor)


def _low_passed(values: np.ndarray, factor: int) -> np.ndarray:
    out, taps = np.full_like(values, np.nan), _taps(factor)
    known = np.flatnonzero(~np.isnan(values))
    for piece in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
        half = min(len(taps) // 2, len(piece) - 1)
        if half < len(taps) // 2:  # too short to filter: as it is
            out[piece] = values[piece]
            continue
        x = values[piece]
        # Odd extension, so that neither level nor slope jumps at the ends.
        padded = np.concatenate([2 * x[0] - x[half:0:-1], x, 2 * x[-1] - x[-2 : -half - 2 : -1]])
        out[piece] = np.convolve(padded, taps, "valid")
    return out


def zero_order_hold(series: Series, start: float, period: float, count: int, steps: bool) -> np.ndarray:
    """A command as its mean over each period, (count,), so that no impulse is lost or added.

    steps: it was held between samples (a controller's output); False: it varies linearly (a measured torque).
    """
    series = _relative(series, start, period / max(1, round(period / series.period)))
    edges = period * np.arange(count + 1)
    steps_of = np.diff(series.time)
    value = series.value
    area = (value[:-1] if steps else (value[:-1] + value[1:]) / 2) * steps_of
    total = np.concatenate([[0.0], np.cumsum(area)])
    return np.diff(_integral(series, total, edges, steps)) / period


def _integral(series: Series, total: np.ndarray, at: np.ndarray, steps: bool) -> np.ndarray:
    index = np.clip(np.searchsorted(series.time, at, side="right") - 1, 0, len(series.time) - 1)
    past, value = at - series.time[index], series.value[index]
    following = np.minimum(index + 1, len(series.time) - 1)
    span = np.maximum(series.time[following] - series.time[index], 1e-300)
    slope = np.where((following > index) & (not steps), (series.value[following] - value) / span, 0.0)
    return total[index] + past * value + past**2 * slope / 2


def valid_intervals(series: list[Series], start: float, stop: float) -> list[tuple[float, float]]:
    """Parts of start..stop in s in which every command is known; all of it where there are no commands."""
    parts = [(start, stop)]
    for one in series:
        gaps = np.flatnonzero(np.diff(one.time) > HELD * one.period)
        for gap in gaps:
            parts = [piece for part in parts for piece in _without(part, one.time[gap], one.time[gap + 1])]
    return parts


def _without(part: tuple[float, float], low: float, high: float) -> list[tuple[float, float]]:
    start, stop = part
    if high <= start or low >= stop:
        return [part]
    return [piece for piece in ((start, low), (high, stop)) if piece[1] > piece[0]]
