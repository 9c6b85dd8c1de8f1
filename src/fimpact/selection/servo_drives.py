"""What is asked before all else of robots with servos and gears: how late the servos are, and whole drives.

Each takes the state of a search (`forward.Search`) and changes it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fimpact.deciding import LOUD, TIED, UNLIKELY
from fimpact.effects import typical
from fimpact.effects.classes import DRIVE
from fimpact.effects.sites import driven
from fimpact.selection.one_round import Trial
from fimpact.selection.options import joint_at
from fimpact.selection.pruning import pruned
from fimpact.selection.refit_start import at_typical_sizes, in_midst
from fimpact.selection.regression import Regression
from fimpact.selection.rivals import standing_alone
from fimpact.selection.soft_gears import refitted_with
from fimpact.selection.substitutes import Alternative
from fimpact.smoothing.servo_lag import LATE, Way
from fimpact.smoothing.smoother import Smoothed, smooth


def align(search, late: Sequence[Way]) -> None:
    """Refit with each of the ways in which motors may be late, and keep the likeliest; what is missing is what is
    missing once the clocks agree."""
    known, steps = {c.name: c for c in search.candidates}, search.track.steps
    ways = [way for way in late if all(own.name in known for own in way)]
    fits = [_with(search, way, known) for way in ways if len(way) == 1]
    every = np.stack([search.missing, *(fit.tau**2 for fit in fits if fit.converged)])
    missing = every[every.sum(1).argmin(0), :, np.arange(every.shape[2])].T
    if not far(search, missing):  # else whole drives are lacking, and softness stands in for them
        fits += [_with(search, way, known) for way in ways if len(way) > 1]
    fits = [fit for fit in fits if fit.converged]
    search.missing, all_of_it = missing, search.missing
    fits = [pruned(search, fit) for fit in fits]
    search.weak = set()
    fits = [fit for fit in fits if fit.converged and fit.loss() < search.naive.loss()]
    search.track.steps = steps  # no other question goes unasked because this one came first
    search.dropped = {own.name for way in late for own in way if own.effect.name in LATE} if fits else set()
    if not fits:
        search.missing = all_of_it
        return
    best = min(fits, key=lambda fit: fit.loss())
    search.current, search.hint = best, 0.0
    others = {tuple(law.name for law in fit.placed): fit for fit in fits}
    del others[tuple(law.name for law in best.placed)]
    weights = [(fit, float(np.exp((best.loss() - fit.loss()) / best.dispersion))) for fit in others.values()]
    search.alternatives = [Alternative(fit.placed, fit.theta, w) for fit, w in weights if w > UNLIKELY]


def _with(search, way: Way, known: dict) -> Smoothed:
    asked = [known[own.name] for own in way]
    placed = [candidate.placed_as(own.values) for own, candidate in zip(way, asked, strict=True)]
    search.progress(f"selecting: {way[0].name}, which takes away nearly all that the next sample misses")
    priors = [candidate.priors for candidate in asked]
    return smooth(search.track, search.begun, search.noise, placed, priors, progress=search.progress)


def drive(search) -> None:
    """Refit with a geared drive at every driven joint, and keep what bears something.

    Where much is missing of what motors give, under servos, and where a sample is long against the drive, a column at
    zero is wrong, and one kind of physics alone goes wrong at each joint: the compound is refitted whatever its columns
    say, but where another does more than twice as much.
    """
    tried, lacks_much, steps = search.open(), far(search, search.missing), search.track.steps
    if not ((search.coupled or lacks_much) and any(c.effect.name in DRIVE for c in tried)):
        return
    alone = lacks_much and search.coupled  # nothing else has a say: its columns are no tangents
    if alone:
        tried = [c for c in tried if c.effect.name in DRIVE]
    regression, found = search.searched(tried)
    search.first, search.asked = None if alone else (regression, found), regression
    trial = next((t for t in found.tried if t.option.compound), None)
    if trial is None:
        return
    if not alone and found.tried[0].gain > 2 * trial.gain:
        if search.coupled:
            search.failed.add(trial.option.name)  # its kinds and places are asked one by one
        return
    search.progress(f"selecting: {trial.option.name}, {trial.share:.0%} of the force missing at one place")
    best = _alike(search, refitted_whole(search, regression, trial))
    before = {law.name for law in search.current.placed}
    search.parts = {law.name for law in best.placed} - before
    best = pruned(search, best, drive=True)
    spread = regression.dispersion
    if best.converged and best.placed and best.loss(spread) < search.current.loss(spread):
        added = tuple(law for law in best.placed if law.name not in before)
        stays = before <= {law.name for law in best.placed}  # else what stood in its place has gone with it
        search.alternatives = [replace(a, placed=(*a.placed, *added)) for a in search.alternatives if stays]
        search.current, search.hint = best, trial.p
        search.rounds.append(replace(found, chosen=trial))
        search.failed.add(trial.option.name)
    else:
        search.weak.clear()
        search.parts.clear()
        less = ((best.tau / search.scales.force) ** 2).sum() < ((search.naive.tau / search.scales.force) ** 2).sum()
        if best.converged and not best.placed and less and best.loss() < search.naive.loss() - TIED:
            search.begins_at(best)  # on the way a better optimum was found for the naive model itself
    search.track.steps = steps  # no other question goes unasked because this one came first


def restored(search) -> bool:
    """Put what a drive lost at a joint in the place of what stands alone there, a gain of the servo, say, that took its
    place while something else was missing; False where nothing of it is likelier."""
    fit, model, steps = search.current, search.track.model, search.track.steps
    lost = [c for c in search.candidates if c.name in search.parts - {law.name for law in fit.placed}]
    for place in standing_alone(search):
        joint = joint_at(model, fit.placed[place].site)
        own = [c for c in lost if c.site == joint]
        asked = joint, frozenset({*(c.name for c in own), *(law.name for law in fit.placed)})
        if not own or fit.placed[place].name in search.parts or asked in search.softened:
            continue
        search.softened.add(asked)
        found = refitted_with(search, own, [place], fit.loss())
        if found.converged and (found := pruned(search, found)).converged:
            spread = fit.dispersion
            if fit.loss(spread) - found.loss(spread) > TIED:
                search.progress(f"selecting: what a drive has at {joint} in place of {fit.placed[place].name}")
                search.current, search.alternatives, search.track.steps = found, [], steps
                return True
    search.track.steps = steps  # no other question goes unasked because this one came first
    return False


def far(search, missing: np.ndarray) -> bool:
    """Whether so much is missing, squared, (N, nv), beside what motors give that columns are no tangents."""
    model, missing = search.track.model, np.sqrt(missing.sum(0) / search.track.count)
    joints = driven(model)
    lost = [missing[model.joint(joint).dofadr[0]] for joint in joints]
    given = [typical.applied(search.scales, model, joint) for joint in joints]
    return any(own > LOUD * most for own, most in zip(lost, given, strict=True))


def refitted_whole(search, regression: Regression, trial: Trial) -> Smoothed:
    """The fit with `trial`: with all of a compound, begun at typical sizes where the regression has less of them, and
    where that does not converge with what the regression has of it."""
    if not trial.option.compound:
        return search.refitted(regression, trial)
    fit = search.refitted(regression, at_typical_sizes(regression, trial))
    return fit if fit.converged or search.coupled else search.refitted(regression, trial)


def _alike(search, fit: Smoothed) -> Smoothed:
    """`fit`, or the likelier one that begins with what lies far below its like at other joints in their midst: the same
    motors and gears sit at every joint, and a light one has optima of its own far below."""
    placed = in_midst(fit.placed, fit.priors)
    if placed == fit.placed:
        return fit
    other = smooth(search.track, search.begun, search.noise, placed, fit.priors, fit, progress=search.progress)
    return other if other.converged and (not fit.converged or other.loss() < fit.loss()) else fit
