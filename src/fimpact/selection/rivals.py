"""Rivals of what is chosen, and what may stand in the place of what is in, each refitted.

Each takes the state of a search (`forward.Search`) and changes it.
"""

from collections.abc import Sequence

import numpy as np

from fimpact.deciding import RIVALS, TIED, UNLIKELY
from fimpact.selection.one_round import Round
from fimpact.selection.options import Option
from fimpact.selection.regression import Regression
from fimpact.selection.substitutes import Alternative, exchanges
from fimpact.smoothing.smoother import Smoothed


def exchanged(search, regression: Regression, offered: Sequence[Option]) -> bool:
    """Put in the place of an effect what is likelier, refitted; what is as likely joins the set.

    Under servos an effect is not exchanged: there the whole drive is one.
    """
    if search.coupled:
        return False
    tried, spread = regression.columns.candidates, regression.dispersion
    beside = [option for option in offered if not search.is_second_gear(tried, option)]
    others = exchanges(regression, offered, beside)
    others = [e for e in others if not search.is_second_gear(tried, e.option, e.place)]
    for other in [e for e in others if e.weight > np.exp(-TIED) and e.sure][:RIVALS]:
        fit = search.refitted(regression, other, other.place)
        fewer = len(fit.numbers) < len(search.current.numbers)
        if fit.converged and fit.loss(spread) < search.current.loss(spread) + (TIED if fewer else -TIED):
            search.progress(f"selecting: {other.option.name} in place of {search.current.placed[other.place].name}")
            search.current, search.alternatives = fit, []
            return True
        others.remove(other)
    known = {frozenset(p.name for p in a.placed) for a in search.alternatives}
    # What would be far likelier, and is not borne out by stretches that were not fitted, was followed too far.
    for other in [e for e in others if e.option.members and e.weight < np.exp(TIED)]:
        own, _, theta = search.begun_with(regression, other, other.place)
        if frozenset(p.name for p in own) not in known:
            search.alternatives.append(Alternative(own, theta, min(other.weight, 1.0)))
    return False


def among_rivals(search, regression: Regression, found: Round, best: Smoothed) -> Smoothed:
    """The likeliest of the chosen and its rivals, each refitted; the others are kept as alternatives."""
    assert found.chosen is not None
    # The compound stands for many kinds, which are told apart by what they predict; others are by refits.
    rivals = [] if found.chosen.option.compound else found.rivals
    tried, fits = rivals[:RIVALS], [best]
    for trial, _ in tried:
        fits.append(search.refitted(regression, trial))
        search.progress(f"selecting: rival {len(fits) - 1} of {len(tried)} refitted, {trial.option.name}")
    spread = regression.dispersion
    losses = np.array([fit.loss(spread) if fit.converged else np.inf for fit in fits])
    losses = np.where(np.isfinite(losses), losses, np.inf)
    weights = np.exp(losses.min() - losses) if np.isfinite(losses.min()) else np.ones(len(fits))
    as_good = [i for i, w in enumerate(weights) if w >= np.exp(-TIED)]
    orders = [found.chosen.option.order, *(trial.option.order for trial, _ in tried)]
    first = min(as_good, key=lambda i: (len(fits[i].numbers), orders[i], i))
    answers = [(fit.placed, fit.theta, w) for fit, w in zip(fits, weights, strict=True)]
    # Where there was no refit, or none that converged, stands what the regression says.
    told = weights[0] if np.isfinite(losses[0]) else weights[first]
    for i, (trial, weight) in enumerate(rivals, 1):
        if i >= len(fits) or not np.isfinite(losses[i]):
            own, _, theta = search.begun_with(regression, trial)
            answers[i : i + 1] = [(own, theta, weight * told)]
    search.alternatives = [
        Alternative(placed, theta, float(w / weights[first]))
        for i, (placed, theta, w) in enumerate(answers)
        if i != first and w > UNLIKELY * weights[first]
    ]
    return fits[first]
