"""Rivals of what is chosen, and what may stand in the place of what is in, each refitted.

Each takes the state of a search (`forward.Search`) and changes it.
"""

from collections import Counter
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from fimpact.deciding import P_ALARM, RIVALS, TIED, UNLIKELY
from fimpact.selection.one_round import Round, Trial
from fimpact.selection.options import Option, joint_at
from fimpact.selection.pruning import pruned
from fimpact.selection.refit_start import held_by
from fimpact.selection.regression import Regression
from fimpact.selection.substitutes import Alternative, Exchange, exchanges
from fimpact.smoothing.candidates import Candidate
from fimpact.smoothing.smoother import Smoothed


def exchanged(search, regression: Regression, offered: Sequence[Option]) -> bool:
    """Put in the place of an effect, or of two, what is likelier, refitted; what is as likely joins the set.

    Of whole drives no two are exchanged, and under servos none: there the whole drive is one. What holds an effect that
    is in takes its place together with that of another, or it is no exchange.
    """
    tried, spread = regression.columns.candidates, regression.dispersion
    beside = [option for option in offered if not search.is_second_gear(tried, option)]
    alone = standing_alone(search)
    one = alone if search.coupled else range(len(search.current.placed))
    leaving = [*((i,) for i in one), *combinations(alone, 2)]
    sums = set() if search.limits.quick else {c.name for c in search.open(sums=True)}
    wholes = [Option(c.name, c.effect.order, (i,)) for i, c in enumerate(tried) if c.name in sums]
    others = exchanges(regression, [*offered, *wholes], beside, leaving)
    others = [e for e in others if not search.is_second_gear(tried, e.option, e.places)]
    others = [e for e in others if e.option.name not in sums or _takes_more(search, tried, e)]
    others = [e for e in others if e.option.members or len(e.places) < 2]
    # No tangent says which ties go to what is not sure, but a refit may say that what is in has left the set.
    asked, found = others[:RIVALS], []
    more = np.log(len(offered)) if offered else 0.0  # of each effect, which is one of as many
    for other in asked:
        fit = search.refitted(regression, other, other.places)
        ahead = search.current.loss(spread) - fit.loss(spread) if fit.converged else -np.inf
        ahead += more * bool(other.option.members) * (len(search.current.placed) - len(fit.placed))
        fewer = (len(fit.numbers), len(fit.placed)) < (len(search.current.numbers), len(search.current.placed))
        bar = (-TIED if fewer else TIED) if other.sure else -np.log(UNLIKELY)
        if ahead > bar:
            gone = " and ".join(search.current.placed[i].name for i in other.places)
            search.progress(f"selecting: {other.option.name} in place of {gone}")
            before = Alternative(search.current.placed, search.current.theta, float(np.exp(-ahead)))
            kept = other.option.members and before.weight > UNLIKELY
            search.current, search.alternatives = fit, [before] if kept else []
            return True
        if other.option.members:
            found.append(Alternative(fit.placed, fit.theta, float(np.exp(min(ahead, 0.0)))))
    rest = [e for e in others if not any(e is own for own in asked)]
    for other in [e for e in rest if e.option.members and e.weight < np.exp(TIED)]:
        own, _, theta = search.begun_with(regression, other, other.places)
        found.append(Alternative(own, theta, min(other.weight, 1.0)))
    known = {frozenset(p.name for p in a.placed) for a in search.alternatives}
    for own in found:
        names = frozenset(p.name for p in own.placed)
        if own.weight > UNLIKELY and names not in known:
            search.alternatives.append(own)
            known.add(names)
    return False


def weighed(search, regression: Regression, found: Round) -> bool:
    """Refit the strongest hints where no more than chance was found, and keep what is likelier beyond chance.

    The missing force of a fit has grown with what is missing, which hides in it; a refit needs less of it.
    """
    hints = {t.places: t for t in sorted(found.tried, key=lambda t: -t.p) if t.p < 1 and len(t.option.members) == 1}
    if not hints:
        return False
    strongest, *others = list(hints.values())[: -RIVALS - 1 : -1]
    asked = Round(strongest, tuple((trial, 1.0) for trial in others), found.tried)
    steps, before, spread = search.track.steps, search.current, regression.dispersion
    best = pruned(search, among_rivals(search, regression, asked, search.refitted(regression, strongest)))
    search.track.steps = steps  # what comes to nothing keeps no other question from being asked
    odds = np.log(len(search.candidates)) + best.loss(spread) - before.loss(spread)
    if not (best.converged and best.placed and odds < np.log(P_ALARM)):
        search.alternatives, search.weak = [], set()
        return False
    search.current, search.hint = best, min(search.hint, float(np.exp(odds)))
    search.rounds.append(asked)
    return True


def standing_alone(search) -> list[int]:
    """Effects that are in, by number, but for the parts of whole drives; of a drive of which one part is left at a
    joint, that part is an effect as any other."""
    parts = Counter(law.site for law in search.current.placed if law.name in search.parts)
    return [i for i, p in enumerate(search.current.placed) if p.name not in search.parts or parts[p.site] == 1]


def _takes_more(search, tried: Sequence[Candidate], other: Exchange) -> bool:
    """Whether an option takes more away than what it holds."""
    own = tried[other.option.members[0]]
    return {*held_by(own.effect, own.site, search.current.placed)} < {*other.places}


def unsettled(search) -> list[Alternative]:
    """What qualified most clearly of what no fit has settled with, in the place of what is named at its joint: nobody
    knows how likely it is."""
    alone = [own for own in search.unfitted if len(own[1]) == 1]
    if not alone or not search.current.placed:
        return []
    (law,) = max(alone, key=lambda own: own[0].gain)[1]
    model, placed = search.track.model, search.current.placed
    if law.name in {own.name for own in placed}:
        return []
    joint = joint_at(model, law.site)
    others = tuple(own for own in placed if not joint or joint_at(model, own.site) != joint)
    return [Alternative((*others, law), search.current.theta, 1.0)]


def among_rivals(search, regression: Regression, found: Round, best: Smoothed) -> Smoothed:
    """The likeliest of the chosen and its rivals, each refitted; the others are kept as alternatives."""
    assert found.chosen is not None
    # The compound stands for many kinds, which are told apart by what they predict; others are by refits.
    rivals = [] if found.chosen.option.compound else list(found.rivals)
    late = _late(search, regression, found, rivals[:RIVALS])
    rest = [own for own in rivals[RIVALS:] if own[0].places not in {trial.places for trial, _ in late}]
    tried, fits = [*rivals[:RIVALS], *late], [best]
    rivals = [*tried, *rest]
    steps = search.track.steps
    for trial, _ in tried:
        fits.append(search.refitted(regression, trial))
        search.progress(f"selecting: rival {len(fits) - 1} of {len(tried)} refitted, {trial.option.name}")
    search.track.steps = steps if late else search.track.steps  # no question goes unasked because this one came first
    spread = regression.dispersion
    trials = [found.chosen, *(trial for trial, _ in tried)]
    said = [fit.converged and not (late and _usual(fit, own)) for fit, own in zip(fits, trials, strict=True)]
    losses = np.array([fit.loss(spread) if own else np.inf for fit, own in zip(fits, said, strict=True)])
    losses = np.where(np.isfinite(losses), losses, np.inf)
    weights = np.exp(losses.min() - losses) if np.isfinite(losses.min()) else np.ones(len(fits))
    as_good = [i for i, w in enumerate(weights) if w >= np.exp(-TIED)]
    orders = [found.chosen.option.order, *(trial.option.order for trial, _ in tried)]
    first = min(as_good, key=lambda i: (len(fits[i].numbers), orders[i], i))
    answers = [(fit.placed, fit.theta, w) for fit, w in zip(fits, weights, strict=True)]
    # Where there was no refit, or none that converged, stands what the regression says, which is not believed further
    # than that it is as likely.
    told = weights[0] if np.isfinite(losses[0]) else weights[first]
    for i, (trial, weight) in enumerate(rivals, 1):
        if i >= len(fits) or not np.isfinite(losses[i]):
            own, _, theta = search.begun_with(regression, trial)
            answers[i : i + 1] = [(own, theta, min(weight, 1.0) * told)]
    search.alternatives = [
        Alternative(placed, theta, float(w / weights[first]))
        for i, (placed, theta, w) in enumerate(answers)
        if i != first and w > UNLIKELY * weights[first]
    ]
    return fits[first]


def _usual(fit: Smoothed, trial: Trial) -> bool:
    """Whether what a trial has added is no more than every log has: it explains nothing, though commands that jump are
    read before they do instead of after."""
    added = [law for law in fit.placed if law.name in trial.places]
    return bool(added) and all(law.usual for law in added)


def _late(
    search, regression: Regression, found: Round, known: Sequence[tuple[Trial, float]]
) -> list[tuple[Trial, float]]:
    """Where something comes late, and sensors show forces that jump with commands, all else that may: at such jumps
    nothing that is late has a tangent."""
    assert found.chosen is not None
    tried, seen = regression.columns.candidates, {found.chosen.places, *(trial.places for trial, _ in known)}

    def is_late(trial: Trial, *enters: str) -> bool:
        own = [tried[i].effect for i in trial.option.members]
        return all(effect.shifts_time and effect.enters in enters for effect in own)

    if not (search.track.late.any() and is_late(found.chosen, "command", "measurement")):
        return []
    others = {t.places: t for t in reversed(found.tried) if is_late(t, "command") and t.places not in seen}
    return [(trial, 0.0) for trial in others.values()]
