"""Gears that give, asked by refits: the motion of a rotor behind them is no column beside a trajectory without it.

Each takes the state of a search (`forward.Search`) and changes it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fimpact.deciding import P_ALARM, TIED, TYPICAL, UNLIKELY
from fimpact.effects.base import Placed
from fimpact.selection.options import joint_at
from fimpact.selection.pruning import pruned
from fimpact.selection.rivals import standing_alone
from fimpact.selection.substitutes import Alternative
from fimpact.smoothing.candidates import Candidate
from fimpact.smoothing.dynamics.rotor_states import turning
from fimpact.smoothing.filter.by_run import filtered
from fimpact.smoothing.smoother import Smoothed, smooth


def softened(search) -> bool:
    """Put a gear that gives in the place of all that is named at its joint but the parts of a whole drive, of one that
    gives otherwise too, or, where nothing is named, at the servo at which most is left without a name; False where none
    is likelier.

    What is as likely joins the set.
    """
    before, steps = search.current, search.track.steps
    for joint, out in _asked(search):
        search.softened.add((joint, frozenset(before.placed[i].name for i in out)))
        # What takes the place of others needs be no likelier; what comes beside them must be more than chance.
        bar = -TIED if len(out) > 1 else TIED if out else np.log(len(search.candidates) / P_ALARM)
        least = before.loss() - (bar if not out else np.log(UNLIKELY))
        fits = [refitted_with(search, [candidate], out, least) for candidate in _gears(search, joint, out)]
        fits = [fit for fit in fits if fit.converged]
        if not fits:
            continue
        best = min(fits, key=lambda fit: fit.loss(before.dispersion))
        ahead = before.loss(before.dispersion) - best.loss(before.dispersion)
        if ahead > bar and (best := pruned(search, best)).converged and _gives(best, joint):
            search.progress(f"selecting: {_gives(best, joint)[0].name}, whose rotor moves by itself")
            search.current, search.track.steps = best, steps
            others = [before] * bool(out) + [fit for fit in fits if _gives(fit, joint) != _gives(best, joint)]
            search.alternatives = list(_as_likely(best, others))
            return True
        known = {frozenset(law.name for law in own.placed) for own in search.alternatives}
        found = _as_likely(before, fits if out else ())
        search.alternatives += [own for own in found if frozenset(law.name for law in own.placed) not in known]
    search.track.steps = steps  # no other question goes unasked because this one came first
    return False


def _asked(search) -> Iterator[tuple[str, list[int]]]:
    """Joints where something is named, with the numbers of it, and the one where most is left; of plain motors, of
    which columns tell a gear that gives from any one effect, those where two are. Each with the same names once."""
    fit, model = search.current, search.track.model
    joints = list(dict.fromkeys(c.site for c in search.listed if turning(search.track, [c.placed_as({})])))
    at: dict[str, list[int]] = {joint: [] for joint in joints}
    for i in standing_alone(search):
        joint = joint_at(model, fit.placed[i].site)
        if joint in at:
            at[joint].append(i)
    served = [joint for joint in joints if joint in search.track.served]
    most = max(served, key=lambda joint: _left(fit, int(model.joint(joint).dofadr[0])), default="")
    for joint, out in at.items():
        asked = out or joint == most if joint in served else len(out) > 1
        if asked and (joint, frozenset(fit.placed[i].name for i in out)) not in search.softened:
            yield joint, out


def _left(fit: Smoothed, dof: int) -> float:
    """What the log likelihood may gain at most where nothing is missing of the force on `dof`."""
    force = fit.levels.force.copy()
    force[:, dof] = fit.levels.least[dof]
    known = np.isfinite(fit.filter.sd)
    without = filtered(fit.track, fit.linear, replace(fit.levels, force=force)).sd[known]
    return float(np.log(fit.filter.sd[known] / without).sum())


def _gears(search, joint: str, out: Sequence[int]) -> list[Candidate]:
    found = {c.effect.name: c for c in search.listed if c.site == joint and c.effect.enters == "gear"}
    same = [search.current.placed[i].name for i in out]
    return [c for c in found.values() if [c.name] != same and turning(search.track, [c.placed_as({})])]


def refitted_with(search, tried: Sequence[Candidate], out: Sequence[int], bar: float) -> Smoothed:
    """The fit with what is `tried`, at typical sizes, without the effects number `out`, if it may beat the loss
    `bar`."""
    fit = search.current
    kept = [i for i in range(len(fit.placed)) if i not in out]
    placed, priors = [fit.placed[i] for i in kept], [fit.priors[i] for i in kept]
    for own in tried:
        typical = {name: TYPICAL * size for name, size in own.priors.items()}
        placed.append(own.placed_as(own.effect.neutral | own.shapes | typical))
        priors.append(own.priors)
    return fitted(search, placed, priors, fit.theta, bar)


def fitted(search, placed: Sequence[Placed], priors, theta: np.ndarray, bar: float) -> Smoothed:
    """The fit with `placed`, begun at the unknowns `theta`, if it may beat the loss `bar`. Where a rotor moves freely
    it goes on, if it is ahead and not yet still: damping of gears and ends of plays are found slowly."""
    own = search.track, search.begun, search.noise
    fit = smooth(*own, placed, priors, search.current, theta, search.progress, bar=bar)
    if fit.converged or not fit.loss() < bar or not turning(search.track, placed):
        return fit
    return smooth(*own, fit.placed, priors, fit, progress=search.progress, bar=bar)


def _gives(fit: Smoothed, joint: str) -> list[Placed]:
    return [law for law in fit.placed if law.effect.enters == "gear" and law.site == joint]


def _as_likely(fit: Smoothed, others) -> Iterator[Alternative]:
    for other in others:
        weight = float(np.exp(min(fit.loss(fit.dispersion) - other.loss(fit.dispersion), 0.0)))
        if weight > UNLIKELY:
            yield Alternative(other.placed, other.theta, weight)
