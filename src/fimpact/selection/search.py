"""One round of forward selection, and what each number of a fit is worth.

An option qualifies where its gain is more than chance over all that was tried, where it predicts stretches better that
were not fitted, and where it takes away a share of the missing force at some place. The best wins; of what is as good,
the earlier in the engineer's order; all that data cannot tell from it is its set.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fimpact.deciding import P_ALARM, TIED, UNLIKELY
from fimpact.selection.options import Option
from fimpact.selection.regression import Estimate, Regression, chance


@dataclass(frozen=True)
class Trial:
    """One option tried beside what is in.

    p: chance of its gain over all that was tried. gain, error: predicted on stretches that were not fitted, in squared
    innovations, and its standard error. share, place: largest share of the missing force that it takes away, and the
    degree of freedom where. errors: (stretches,) squared innovations left.
    """

    option: Option
    estimate: Estimate
    p: float
    gain: float
    error: float
    share: float
    place: int
    errors: np.ndarray


@dataclass(frozen=True)
class Round:
    """What one round chose (None: nothing qualified), its rivals with their relative likelihoods, and all that was
    tried, best first."""

    chosen: Trial | None
    rivals: tuple[tuple[Trial, float], ...]
    tried: tuple[Trial, ...]


def search(regression: Regression, offered: Sequence[Option], missing: np.ndarray, floor: float) -> Round:
    """Try every option beside what is in.

    Args:
        missing: squared force, (nv,), of which an option must take the share `floor` somewhere.
    """
    now = regression.proper(range(regression.p))
    errors, forces = regression.errors(now), regression.forces_left(now)
    tried = [attempt(regression, now, errors, forces, missing, option) for option in offered]
    tried = sorted((t for t in tried if t), key=lambda t: -t.gain)
    good = [t for t in tried if t.p < P_ALARM and t.gain > 0 and t.share > floor]
    if not good:
        return Round(None, (), tuple(tried))
    best = good[0]
    behind = [(t, lag(regression, best, t)) for t in good]
    tied = [t for t, own in behind if own < TIED or t.option.compound]
    chosen = min(tied, key=lambda t: (t.option.order, -t.gain))
    weights = [(t, float(np.exp(-own / 2))) for t, own in behind if t is not chosen]
    rivals = sorted((pair for pair in weights if pair[1] > UNLIKELY), key=lambda pair: -pair[1])
    return Round(chosen, tuple(rivals), tuple(tried))


def attempt(regression: Regression, now: Estimate, errors, forces, missing, option: Option) -> Trial | None:
    """One option beside what is in; None where nothing of it is left."""
    owners = regression.columns.owners
    own = [regression.p + i for i, (owner, _) in enumerate(owners) if owner in option.members]
    found = regression.proper([*now.kept, *own]) if own else now
    added = len(set(found.kept) - set(now.kept))
    if not added:
        return None
    gain, dispersion = regression.gain(now, found)
    p = min(1.0, chance(gain, dispersion, added) * regression.independent)
    left = regression.errors(found)
    taken = (forces - regression.forces_left(found)).sum(0) / np.maximum(missing, 1e-300)
    place, better = int(np.argmax(taken)), errors - left
    error = float(better.std() * np.sqrt(len(better)))
    return Trial(option, found, p, float(better.sum()), error, float(taken[place]), place, left)


def lag(regression: Regression, best: Trial, other: Trial) -> float:
    """How far `other` is behind, in twice log likelihoods, as far as stretches are independent."""
    step = np.zeros(regression.gram.shape[1])
    step[list(best.estimate.kept)] += best.estimate.values
    step[list(other.estimate.kept)] -= other.estimate.values
    apart = step @ regression.gram.sum(0) @ step
    behind = other.errors - best.errors
    spread = behind.var() * len(behind)
    return float(behind.sum() / max(1.0, spread / max(4 * apart, 1e-300)))


@dataclass(frozen=True)
class Worth:
    """What one number of a fit is worth: chance of so much of it where there is none, and the largest share of the
    missing force that returns without it."""

    p: float
    share: float


def worth(regression: Regression, column: int, step: float, missing: np.ndarray) -> Worth:
    """What the number in `column` is worth; `step` of its coordinate takes it away."""
    kept = tuple(range(regression.p))
    whole = regression.gram[:, :, : len(kept)][:, : len(kept)].sum(0) / regression.dispersion
    whole = whole + np.diag(regression.weight[: len(kept)])
    rest = [c for c in kept if c != column]
    change = np.zeros(len(kept))
    change[column] = step
    if rest:
        change[rest] = -np.linalg.lstsq(whole[np.ix_(rest, rest)], whole[rest, column], rcond=1e-12)[0] * step
    estimate = Estimate(kept, np.zeros(len(kept)), 0.0, np.zeros((0, len(kept))))
    variance = regression.covariance(estimate)[column, column]
    p = chance(step**2 / max(variance, 1e-300), 1.0, 1)
    rows = regression.columns.forces
    base, returned = rows[:, :, 0], rows[:, :, 0] - rows[:, :, 1 : 1 + len(kept)] @ change
    gone = (returned**2).sum(0) - (base**2).sum(0)
    return Worth(p, float((gone / np.maximum(missing, 1e-300)).max()))
