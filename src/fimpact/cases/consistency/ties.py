"""The consistency test: channels that a law ties together, read as declared and in every other way that is usual.

A *tie* predicts some columns from others by a law that no robot breaks: kinematics (a gyro reads how the measured
orientation turns), or rigid-body dynamics (commands, weight and inertia balance). A *reading* is another way to read
the columns: in degrees, with another sign, order, frame or clock. As declared, the columns are forgiven every honest
error (scale, offset, misalignment, delay, masses, friction), within bounds, and so they are under every other reading;
what is left over decides. Another reading is believed in a run only if

- under the other reading, little is left: less by half than as declared if that is more than the law may be wrong by
  (kinematics: nothing, dynamics: a quarter), else less by ten times, for then the law is not what is wrong, and
- the likelihood ratio, with errors of unknown size and as many samples as are independent, outweighs the odds against.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from fimpact.cases.row_order import FEWEST

GOOD = 0.25  # share of what was measured that a reading which is right may leave unexplained
BETTER = 0.4  # ratio of what the two readings leave, where as declared more is left than the law may be wrong by
CLEAR = 0.1  # the same, where less is: so good a law under the other reading shows that the law is not what is wrong
LEAST = 0.01  # share that no wrong convention is as small as: a tenth of a radian of misalignment
ODDS = np.log(1000.0)  # against one certain reading being the right one, before the data: few logs are wrong in one way
SWEEPS = 30  # through all coefficients, at most
MODEL_ERROR = 0.25  # share of the motion that a naive model may leave unexplained, being what is looked for
Column = tuple[np.ndarray, float, float]  # a term of the law (n,) and the bounds of its honest coefficient
Rows = tuple[np.ndarray, list[Column]]  # what was measured (n,), and the terms that should make it up


@dataclass(frozen=True)
class Reading:
    """Another way to read columns. cause: in words, after "if". doubt: its kind. remedy: what to write in the case."""

    cause: str
    doubt: str
    remedy: str = "correct the case"


DECLARED = Reading("as declared", "")
PUNCTUAL = Reading("without any delay", "")


@dataclass(frozen=True)
class Left:
    """What a reading leaves: its share, the residual (n,) in units of what was measured, and the delay in s."""

    share: float
    residual: np.ndarray
    delay: float = 0.0

    @property
    def independent(self) -> int:
        """As many samples as are independent: by Rice, a signal of bandwidth B changes sign some 2 B times a second."""
        return 1 + int(np.count_nonzero(np.diff(np.sign(self.residual[self.residual != 0]))))


NOTHING = Left(1.0, np.zeros(0))  # where nothing can be compared


@dataclass(frozen=True)
class Tie:
    """Columns tied by a law. what: the two sides, in words. runs: names. left: of a reading in a run, by its index.

    slack: share that the law may be wrong by itself. prompt: whether `left` knows the reading `PUNCTUAL`.
    """

    what: str
    runs: tuple[str, ...]
    readings: tuple[Reading, ...]
    left: Callable[[Reading, int], Left]
    slack: float = 0.0
    prompt: bool = False


def unexplained(rows: Sequence[Rows], delay: float = 0.0) -> Left:
    """What is left of several rows of one unit, with the best honest coefficients of each."""
    power = sum(float(y @ y) for y, _ in rows)
    if not rows or len(rows[0][0]) < FEWEST or power <= 0:
        return NOTHING
    residual = np.concatenate([rest(y, columns) for y, columns in rows])
    return Left(min(1.0, float(residual @ residual) / power), residual / np.sqrt(power), delay)


def rest(target: np.ndarray, columns: Sequence[Column]) -> np.ndarray:
    """What of `target` (n,) the columns cannot make up within their bounds, (n,)."""
    matrix = np.column_stack([x for x, _, _ in columns])
    lows, highs = (np.array([one[i] for one in columns])[None] for i in (1, 2))
    found = bounded((matrix.T @ matrix)[None], (matrix.T @ target)[None], lows, highs)
    return target - matrix @ found[0]


def bounded(gram: np.ndarray, cross: np.ndarray, lows: np.ndarray, highs: np.ndarray) -> np.ndarray:
    """Coefficients (B, k), each within its bounds, of B least-squares problems: of the columns' products with one
    another (B, k, k) and with what they should make up (B, k)."""
    scale = np.sqrt(np.maximum(np.einsum("bkk->bk", gram), 1e-300))
    unit, aim = gram / (scale[:, :, None] * scale[:, None, :]), cross / scale
    lows, highs = lows * scale, highs * scale
    size = unit.shape[1]
    free = np.linalg.solve(unit + 1e-9 * np.eye(size), aim[..., None])[..., 0]
    found = np.clip(free, lows, highs)
    for _ in range(SWEEPS):
        before = found.copy()
        for k in range(size):  # each in turn, with the others as they are
            others = np.einsum("bj,bj->b", unit[:, k], found) - unit[:, k, k] * found[:, k]
            best = (aim[:, k] - others) / np.maximum(unit[:, k, k], 1e-12)
            found[:, k] = np.minimum(np.maximum(best, lows[:, k]), highs[:, k])
        if np.max(np.abs(found - before), initial=0.0) < 1e-4:
            break
    return found / scale


def least(several: Iterable[Left]) -> Left:
    """The one that leaves least."""
    return min(several, key=lambda one: (one.share, not len(one.residual)), default=NOTHING)


def doubt(tie: Tie) -> tuple[Reading, str] | None:
    """The reading that is believed instead of the declared one, in all runs or in some, and one line about it."""
    left = cache(tie.left)
    every = range(len(tie.runs))
    suspect = [run for run in every if left(DECLARED, run).share > LEAST and len(left(DECLARED, run).residual)]
    against = [(reading, [r for r in suspect if _believed(tie, left, reading, [r])]) for reading in tie.readings]
    pooled = [(reading, suspect) for reading in tie.readings if suspect and _believed(tie, left, reading, suspect)]
    found = [(reading, runs) for reading, runs in [*pooled, *against] if runs]
    if not found:
        return None
    score = {i: _gain(left, reading, runs) for i, (reading, runs) in enumerate(found)}
    reading, runs = found[max(score, key=score.__getitem__)]
    return reading, _line(tie, left, reading, runs)


def _believed(tie: Tie, left, reading: Reading, runs: list[int]) -> bool:
    before, after = _shares(left, DECLARED, runs), _shares(left, reading, runs)
    if not far_better(before, after, tie.slack):
        return False
    several = 1 if len(runs) == len(tie.runs) else len(tie.runs)
    return _gain(left, reading, runs) > ODDS + np.log(len(tie.readings) * several)


def note(tie: Tie) -> str | None:
    """A line about a delay that both sides of a tie show clearly, as an honest sensor may have one."""
    left = cache(tie.left)
    known = [run for run in range(len(tie.runs)) if tie.prompt and len(left(DECLARED, run).residual)]
    delays = [left(DECLARED, run).delay for run in known]
    if not delays or min(delays) * max(delays) <= 0:
        return None
    gain = sum(
        0.5 * left(PUNCTUAL, r).independent * np.log(left(PUNCTUAL, r).share / max(left(DECLARED, r).share, 1e-12))
        for r in known
    )
    if gain < ODDS or _shares(left, DECLARED, known) > BETTER * _shares(left, PUNCTUAL, known):
        return None
    return f"{tie.what}: {_late(float(np.median(delays)))}"


def _late(delay: float) -> str:
    return f"the first comes {abs(delay):.3g} s {'later' if delay > 0 else 'earlier'} than the second"


def far_better(before: float, after: float, slack: float) -> bool:
    """Whether the second of two shares that are left is so much less that the law cannot be what is wrong."""
    return before > LEAST and after < min(GOOD, before * (BETTER if before > slack else CLEAR))


def _shares(left, reading: Reading, runs: list[int]) -> float:
    return float(np.mean([left(reading, run).share for run in runs]))


def _gain(left, reading: Reading, runs: list[int]) -> float:
    """Logarithm of the likelihood ratio of a reading to the declared one: Gaussian errors of unknown size."""
    return sum(
        0.5 * left(DECLARED, r).independent * np.log(left(DECLARED, r).share / max(left(reading, r).share, 1e-12))
        for r in runs
    )


def _line(tie: Tie, left, reading: Reading, runs: list[int]) -> str:
    alike = [
        other
        for other in tie.readings
        if other.doubt and _shares(left, other, runs) < _shares(left, reading, runs) + 0.02
    ]
    causes = list(dict.fromkeys([reading.cause, *(other.cause for other in alike)]))[:3]
    if reading.doubt == "clock":
        causes = [f"{reading.cause}: {_late(left(reading, runs[0]).delay)}"]
    other = [run for run in range(len(tie.runs)) if run not in runs and _against(tie, left, reading, run)]
    where = f" in {_named([tie.runs[run] for run in runs])} only" if other else ""
    return (
        f"{tie.what} do not agree{where}: {_shares(left, DECLARED, runs):.0%} is left unexplained as declared, "
        f"{_shares(left, reading, runs):.1%} if {' or '.join(causes)}; {reading.remedy}"
    )


def _against(tie: Tie, left, reading: Reading, run: int) -> bool:
    """Whether a run speaks for the declared reading; some say nothing."""
    before, after = left(DECLARED, run), left(reading, run)
    return len(before.residual) > 0 and (before.share < after.share or before.share <= LEAST)


def _named(runs: list[str]) -> str:
    listing = ", ".join(f"'{run}'" for run in runs[:3]) + (f" and {len(runs) - 3} more" if len(runs) > 3 else "")
    return f"run{'s' if len(runs) > 1 else ''} {listing}"
