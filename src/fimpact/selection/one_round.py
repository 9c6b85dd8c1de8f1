"""One round of forward selection, and what each number of a fit is worth.

An option qualifies where its gain is more than chance over all that was tried, where it predicts stretches better that
were not fitted, and where it takes away a share of the missing force at some place. The best wins; of what is as good,
the earlier in the engineer's order; all that data cannot tell from it is its set.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod

import numpy as np
from scipy import stats

from fimpact.deciding import P_ALARM, REFINES, TIED, UNLIKELY
from fimpact.effects.sites import measured_by
from fimpact.selection.chance import RARE, chance, least
from fimpact.selection.options import Option
from fimpact.selection.regression import Estimate, Regression, inverse
from fimpact.smoothing.dynamics.linear import inverse_of_push


@dataclass(frozen=True)
class Trial:
    """One option tried beside what is in.

    p: chance of its gain over all that was tried. gain, error, sure: predicted on stretches that were not fitted, in
    squared innovations, with what is nearer to the priors, its standard error, and what it is at the least, whichever
    stretches were recorded; 0 of what may be chance. share, place: largest share of the missing force that it takes
    away (1 of what is no force), and its contact mode and degree of freedom. errors: (stretches,) squared innovations
    left. places: ``effect@site`` of what is kept. hidden: no force shows it, since unknowns have gone beyond their
    priors for it. trusted: chance is to be trusted, whatever stretches that were not fitted say.
    """

    option: Option
    estimate: Estimate
    p: float
    gain: float
    error: float
    sure: float
    share: float
    place: tuple[int, int]
    errors: np.ndarray
    places: tuple[str, ...] = ()
    hidden: bool = False
    trusted: bool = False


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
        missing: squared force, (contact modes, nv), of which an option must take the share `floor` somewhere.
    """
    now = regression.proper(range(regression.p))
    errors, forces = regression.errors(now), regression.forces_left(now, regression.white)
    found = [attempt(regression, now, errors, forces, missing, option, len(offered)) for option in offered]
    tried = sorted((t for t in found if t), key=lambda t: -t.gain)
    likely = [t for t in tried if t.p < P_ALARM and (t.gain > 0 or t.trusted) and t.share > floor]
    good = [t for t in likely if t.sure > 0 or t.trusted]
    # What pulls unknowns from their priors is what fits best, not whatever brings them back.
    best = next((t for t in tried if t.p < P_ALARM and (t.sure > 0 or t.trusted)), None)
    good = [t for t in good if best is None or not t.hidden or lag(regression, best, t) < TIED]
    if not good:
        return Round(None, (), tuple(tried))
    behind = [(t, lag(regression, good[0], t)) for t in good]
    allowed = {True: -2 * np.log(UNLIKELY), False: TIED}
    tied = [t for t, own in behind if own < allowed[t.option.compound]]
    chosen = min(tied, key=lambda t: (t.option.order, len(t.estimate.kept), -t.gain))
    chosen = replace(chosen, estimate=backward(regression, now, chosen.estimate))
    return Round(
        chosen,
        rivals_of(
            regression, chosen, [*likely, *blends(regression, now, errors, forces, missing, likely, len(offered))]
        ),
        tuple(tried),
    )


def rivals_of(regression: Regression, chosen: Trial, others: Sequence[Trial]) -> tuple[tuple[Trial, float], ...]:
    """What may be as likely as `chosen`, with its marginal likelihood beside its 1, likeliest first: a rival need not
    be as sure as what is chosen, and a class of which one member is left is that member. What holds all that is chosen
    and more is no rival: more is asked for in the next round."""
    own = regression.evidence(chosen.estimate)
    weights = [(trial, float(np.exp(min(regression.evidence(trial.estimate) - own, 700.0)))) for trial in others]
    # Along its tangent an effect is not known to better than a tenth: what is no further behind is for a refit to say.
    worth = own - regression.evidence(regression.proper(range(regression.p)))
    bar = UNLIKELY * np.exp(-REFINES * max(worth, 0.0)) * max((weight for _, weight in weights), default=1.0)
    first = places_of(regression, chosen.estimate)
    seen, found = {first}, []
    for trial, weight in sorted(weights, key=lambda pair: -pair[1]):
        places = places_of(regression, trial.estimate)
        if places not in seen and not set(first) < set(places) and weight > bar:
            seen.add(places)
            found.append((trial, weight))
    return tuple(found)


def blends(
    regression: Regression, now: Estimate, errors, forces, missing, tried: Sequence[Trial], count: int
) -> list[Trial]:
    """The linear effects among `tried` with all choices of their shapes at once: a shape between two choices is nearly
    a mixture of both, and no effect is to lose to another because its true shape was not among the choices."""
    columns, found = regression.columns, []
    for name, order in {t.places[0]: t.option.order for t in tried if len(t.places) == 1}.items():
        members = tuple(i for i, c in enumerate(columns.candidates) if c.name == name and c.effect.linear)
        if len(members) > 1:
            option = Option(name, order, members)
            found.append(attempt(regression, now, errors, forces, missing, option, count))
    return [trial for trial in found if trial and trial.p < P_ALARM and trial.gain > 0]


def places_of(regression: Regression, estimate: Estimate) -> tuple[str, ...]:
    """``effect@site`` of what an estimate holds beside the numbers that are in."""
    owners, tried = regression.columns.owners, regression.columns.candidates
    names = [tried[owners[c - regression.p][0]].name for c in estimate.kept if c >= regression.p]
    return tuple(dict.fromkeys(names))


def attempt(regression: Regression, now: Estimate, errors, forces, missing, option: Option, count: int) -> Trial | None:
    """One of `count` options beside what is in; None where nothing of it is left."""
    owners = regression.columns.owners
    own = [regression.p + i for i, (owner, _) in enumerate(owners) if owner in option.members]
    found = regression.proper([*now.kept, *own]) if own else now
    added = len(set(found.kept) - set(now.kept))
    if not added:
        return None
    gain, dispersion = regression.gain(now, found)
    looked_at = prod(float(regression.columns.candidates[i].among) for i in option.members)
    p = min(1.0, chance(gain, dispersion, added) * count * looked_at)  # Bonferroni
    places = places_of(regression, found)
    if p >= P_ALARM and not option.compound:
        return Trial(option, found, p, 0.0, 0.0, 0.0, 0.0, (0, 0), errors, places)
    left = regression.errors(found)
    # An unknown that had to go beyond its prior hides an effect: what is taken from there is no force.
    relief, better = regression.tension(now) - regression.tension(found), errors - left
    error, sure = float(better.std() * np.sqrt(len(better))), least(better) + relief
    trusted = regression.white or (sure <= 0 and p < P_ALARM and _shows_in_few(regression, found))
    whole = regression.force_of(now, found)
    taken = forces - regression.forces_left(found, trusted) if whole is None else whole
    if trusted and whole is None:
        # As much less as it would be of stretches that are predicted (Stone, J. R. Stat. Soc. B 39(1), 1977).
        taken = taken * max(0.0, 1 - 2 * added * dispersion / max(gain, 1e-300))
    taken = taken / np.maximum(missing, 1e-300)
    mode, dof = np.unravel_index(np.argmax(taken), taken.shape)
    place = int(mode), int(dof)
    # Where the smoother leaves next to no force, what shows in the readings is all of it, and not many times it.
    hidden = bool(relief > better.sum() and relief > 0)
    shown_only = all(_is_no_force(regression, i) for i in option.members)
    share = 1.0 if hidden or shown_only else min(float(taken[place]), 1.0)
    gained = float(better.sum()) + relief
    return Trial(option, found, p, gained, error, sure, share, place, left, places, hidden, trusted)


def _shows_in_few(regression: Regression, found: Estimate) -> bool:
    """Whether what is added acts in so few stretches that a bootstrap may draw none of them, and what is left beside it
    is white noise: no other stretch can bear it out."""
    added = [(c, v) for c, v in zip(found.kept, found.values, strict=True) if c >= regression.p]
    told = np.sum([value**2 * regression.gram[:, column, column] for column, value in added], axis=0)
    few = told.sum() ** 2 < -np.log(RARE) * np.square(told).sum()
    return bool(few) and regression.looks_white(regression.spread(found))


def _is_no_force(regression: Regression, member: int) -> bool:
    """Whether a candidate is an error of sensors of force or acceleration: the trajectory does not follow those."""
    candidate, track = regression.columns.candidates[member], regression.smoothed.track
    if candidate.effect.enters != "measurement":
        return False
    return bool(track.late[measured_by(track.recording.channels, candidate.site)].all())


def backward(regression: Regression, before: Estimate, found: Estimate) -> Estimate:
    """Drop columns that were added, one after the other, whose absence costs no more than chance."""
    while True:
        added = [c for c in found.kept if c not in before.kept]
        tried = [(regression.proper([k for k in found.kept if k != c]), c) for c in added]
        odds = [(chance(*regression.gain(without, found), 1), without) for without, _ in tried]
        worst = max(odds, key=lambda pair: pair[0], default=(0.0, found))
        if worst[0] * len(added) <= P_ALARM or len(added) < 2:
            return found
        found = worst[1]


def lag(regression: Regression, best: Trial, other: Trial) -> float:
    """How far `other` is behind, in twice log likelihoods, as far as stretches are independent."""
    step = np.zeros(regression.gram.shape[1])
    step[list(best.estimate.kept)] += best.estimate.values
    step[list(other.estimate.kept)] -= other.estimate.values
    apart = step @ regression.gram.sum(0) @ step
    behind = other.errors - best.errors
    spread = behind.var() * len(behind)
    return float(behind.sum() / max(1.0, spread / max(4 * apart, 1e-300)))


def chance_of(regression: Regression, steps: Mapping[int, float]) -> float:
    """Chance of so much of some numbers of a fit where there is nothing of any: Hotelling's test.

    Args:
        steps: of the coordinate in each of their columns, which takes it away.
    """
    kept, columns, step = tuple(range(regression.p)), list(steps), np.array(list(steps.values()))
    covariance = regression.covariance(Estimate(kept, np.zeros(len(kept)), 0.0))[np.ix_(columns, columns)]
    far, free = float(step @ inverse(covariance) @ step), max(regression.count - len(step), 1)
    return float(stats.f.sf(far * free / max(regression.count - 1, 1) / len(step), len(step), free))


def share_of(regression: Regression, column: int, step: float, missing: np.ndarray) -> float:
    """Square of the force of one number of a fit, as the largest share of what was missing at a place, (contact modes,
    nv); 1 of what acts on readings only; `step` of its coordinate takes it away."""
    smoothed = regression.smoothed
    change = smoothed.linear.offsets[:, : 2 * smoothed.track.model.nv, 1 + column] * step
    # Where a joint sticks, what rubs it may be any force that would move it: there it counts in full.
    force = np.einsum("kji,ki->kj", inverse_of_push(smoothed.track, smoothed.linear, sticks=False), change)
    if not force.any():  # of what is read, not of what acts
        return 1.0
    # A gear that gives moves what is read of its motor, too: the smoother would need a force for that.
    needed = regression.columns.forces[:, :, 1 + column] * step
    most = np.maximum(smoothed.levels.summed(force**2), smoothed.levels.summed(needed**2))
    return float((most / np.maximum(missing, 1e-300)).max())
