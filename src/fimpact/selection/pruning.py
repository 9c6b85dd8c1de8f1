"""Leave out of a fit what is worth nothing, and put special cases in the place of what is no likelier.

Each takes the state of a search (`forward.Search`).
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from scipy import stats

from fimpact.deciding import BELIEF, P_ALARM, REFINES, SHARE, TIED
from fimpact.selection.one_round import chance_of, share_of
from fimpact.selection.regression import Regression
from fimpact.smoothing.columns import columns
from fimpact.smoothing.parameters import is_shape
from fimpact.smoothing.smoother import Smoothed, smooth


def pruned(search, fit: Smoothed, floor: float = SHARE, drive: bool = False, stays: Collection[str] = ()) -> Smoothed:
    """The fit without what is worth nothing, one refit for all of it.

    Args:
        floor: the share of `search.whole` that each must bear; where that is of what is left, what was in before stays.
        drive: a whole drive has just come in. What else is missing hides its parts: until that is found, one stays that
            is told from nothing by itself. stays: names that are not asked.
    """
    small = floor == REFINES
    before = {*stays, *(law.name for law in search.current.placed if small)}
    alone, needed, by_chance = 2 * stats.norm.sf(BELIEF), set[str](), np.log(len(search.candidates) / P_ALARM)
    while fit.converged:
        regression = Regression(fit, columns(fit, []))
        parts = [i for i, law in enumerate(fit.placed) if law.name in search.parts and not small]
        # What a drive's parts bear is counted beside one another: one of them may take nearly all that was missing.
        bars = {i: (search.whole(fit, REFINES, fit), REFINES) for i in parts}
        missing = search.whole(fit, floor)
        bearing = [
            i for i, law in enumerate(fit.placed)
            if law.name in before or bears(regression, i, *bars.get(i, (missing, floor)))
        ]  # fmt: skip
        level = alone if drive else P_ALARM / max(len(fit.placed), 1)
        kept = [i for i in bearing if fit.placed[i].name in before | needed or is_sure(regression, i, level)]
        if len(kept) == len(fit.placed):
            return fit
        placed, priors = tuple(fit.placed[i] for i in kept), tuple(fit.priors[i] for i in kept)
        without = smooth(search.track, search.begun, search.noise, placed, priors, fit, progress=search.progress)
        spread, doubted = regression.dispersion, [i for i in bearing if i not in kept]
        # The sd of a size tells little where another number may take its place: a refit without it does.
        if doubted and not drive and without.converged and without.loss(spread) - fit.loss(spread) > by_chance:
            surest = min(doubted, key=lambda i: chance_of(regression, _away(regression, i)))
            needed.add(fit.placed[surest].name)
            continue
        search.weak |= {law.name for i, law in enumerate(fit.placed) if i not in kept}
        fit = without
    return fit


def without_doubtful_parts(search) -> Smoothed:
    """What is in but for parts of whole drives that are worth nothing, now that all is found that will be."""
    names = [law.name for law in search.current.placed]
    if not search.parts & {*names}:
        return search.current
    fit = pruned(search, search.current, stays={*names} - search.parts)
    gone = {*names} - {law.name for law in fit.placed}
    others = [(own, tuple(law for law in own.placed if law.name not in gone)) for own in search.alternatives]
    search.alternatives = [replace(own, placed=placed) for own, placed in others]
    return fit


def simplified(search) -> Smoothed:
    """The fit with a special case in place of each effect that is no likelier than it."""
    fit = search.current
    for place, law in enumerate(fit.placed):
        names, kinds = {own.name for own in fit.placed}, law.effect.contains
        special = [c for c in search.candidates if c.effect.name in kinds and c.site == law.site]
        special = [c for c in special if c.name not in names]
        for candidate in special[:1]:
            known = [c.name for c in law.effect.coefficients if not c.shape]
            size = float(np.mean([law.values[name] for name in known]))
            own = list(zip(fit.placed, fit.priors, strict=True))
            own[place] = candidate.placed([size]), candidate.priors
            placed, priors = zip(*own, strict=True)
            found = smooth(search.track, search.begun, search.noise, placed, priors, fit, progress=search.progress)
            if found.converged and found.loss(fit.dispersion) < fit.loss(fit.dispersion) + TIED:
                fit = found
    return fit


def bears(regression: Regression, place: int, missing: np.ndarray, floor: float) -> bool:
    """Tell whether the effect number `place` bears its share `floor` of what is `missing`, squared, (contact modes,
    nv)."""
    steps = _away(regression, place)
    return any(share_of(regression, i, step, missing) > floor / 2 for i, step in steps.items())


def is_sure(regression: Regression, place: int, chance: float) -> bool:
    """Tell whether the effect number `place` is less likely than `chance` to be none."""
    return chance_of(regression, _away(regression, place)) < chance


def _away(regression: Regression, place: int) -> dict[int, float]:
    """Steps of the coordinates of an effect that take it away."""
    fit = regression.smoothed
    own = [(i, n) for i, n in enumerate(fit.numbers) if n.place == place and not is_shape(fit.placed[place], n.name)]
    return {i: -1.0 if n.log else -n.value for i, n in own}
