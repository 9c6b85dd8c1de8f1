"""Lines of a claim: a number with its 95 % interval, what was demanded of it, and whether that was reached."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import binomtest

RESAMPLES = 4000
HEAD = "| what | bar | aim | measured (95 % interval) | cases | reached |\n|---|---|---|---|---|---|"


@dataclass(frozen=True)
class ClaimLine:
    """One line: value with interval over n cases; low, high: NaN where none is stated; bar, aim: limits to judge by.

    sign: 1 if more is better, -1 if less is, 0 if nothing is demanded. form: how the value is written.
    """

    what: str
    value: float
    low: float
    high: float
    n: int
    sign: int = 0
    bar: float = np.nan
    aim: float = np.nan
    form: Callable[[float], str] = str

    @property
    def verdict(self) -> str:
        """aim, bar, missed, or a dash where nothing is demanded or no case speaks."""
        if not self.sign or not self.n or not np.isfinite(self.value):
            return "–"
        reached = [word for word, limit in (("aim", self.aim), ("bar", self.bar)) if self._reaches(limit)]
        return reached[0] if reached else "missed"

    def _reaches(self, limit: float) -> bool:
        return self.sign * self.value >= self.sign * limit - 1e-12


class Coverage(ClaimLine):
    """Between 88 and 99 %, better between 93 and 97 %."""

    def _reaches(self, limit: float) -> bool:
        return limit <= self.value <= {0.88: 0.99, 0.93: 0.97}[limit]


def percent(value: float) -> str:
    """A share in percent."""
    return f"{100 * value:.1f} %".replace("-", "−")


def number(unit: str = "", digits: int = 2) -> Callable[[float], str]:
    """A way to write numbers of this unit."""
    return lambda value: f"{value:,.{digits}f}{unit}".replace("-", "−")


def share(what: str, good: pd.Series, sign: int = 0, bar: float = np.nan, aim: float = np.nan) -> ClaimLine:
    """A proportion of cases with its Wilson interval; `good` holds True and False, missing values are no cases."""
    good = good.dropna().astype(bool)
    if good.empty:
        return ClaimLine(what, np.nan, np.nan, np.nan, 0, sign, bar, aim, percent)
    interval = binomtest(int(good.sum()), len(good)).proportion_ci(method="wilson")
    return ClaimLine(what, float(good.mean()), interval.low, interval.high, len(good), sign, bar, aim, percent)


def with_interval(what: str, values: pd.Series, statistic, form, sign: int = 0, bar=np.nan, aim=np.nan) -> ClaimLine:
    """A statistic of cases with its bootstrap interval."""
    known = values.dropna().to_numpy(float)
    if not len(known):
        return ClaimLine(what, np.nan, np.nan, np.nan, 0, sign, bar, aim, form)
    drawn = np.random.default_rng(0).integers(len(known), size=(RESAMPLES, len(known)))
    low, high = np.percentile(statistic(known[drawn], axis=1), [2.5, 97.5])
    return ClaimLine(what, float(statistic(known)), float(low), float(high), len(known), sign, bar, aim, form)


def coverage(what: str, held: pd.Series, total: pd.Series) -> ClaimLine:
    """The share of all intervals that hold the truth, `held` of `total` in each case; its own interval resamples cases:
    intervals of one case share its data."""
    # Too wide is as wrong as too narrow: what is judged is the distance to 95 %.
    if not len(held):
        return ClaimLine(what, np.nan, np.nan, np.nan, 0, 1, 0.88, 0.93, percent)
    drawn = np.random.default_rng(0).integers(len(held), size=(RESAMPLES, len(held)))
    shares = held.to_numpy(float)[drawn].sum(1) / total.to_numpy(float)[drawn].sum(1)
    low, high = np.percentile(shares, [2.5, 97.5])
    return Coverage(
        what, float(held.sum() / total.sum()), float(low), float(high), int(total.sum()), 1, 0.88, 0.93, percent
    )


def as_markdown(lines: Sequence[ClaimLine]) -> str:
    """The lines as a table."""
    return "\n".join([HEAD, *(f"| {' | '.join(_cells(m))} |" for m in lines)])


def _cells(m: ClaimLine) -> tuple[str, ...]:
    sign = {1: "≥ ", -1: "≤ ", 0: ""}[m.sign]
    bar, aim = (sign + m.form(limit) if m.sign and np.isfinite(limit) else "–" for limit in (m.bar, m.aim))
    if isinstance(m, Coverage):
        bar, aim = "88 to 99 %", "93 to 97 %"
    interval = f" ({m.form(m.low)} to {m.form(m.high)})" if np.isfinite(m.low) else ""
    measured = m.form(m.value) + interval if m.n and np.isfinite(m.value) else "no such case"
    return m.what, bar, aim, measured, str(m.n), m.verdict
