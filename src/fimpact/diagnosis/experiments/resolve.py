"""What a further experiment says about the explanations that could not be told apart."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fimpact.deciding import UNLIKELY
from fimpact.effects import get_effect
from fimpact.effects.base import Placed, Scales
from fimpact.recordings import Recording, Run
from fimpact.smoothing.candidates import at
from fimpact.smoothing.columns import motion_scales
from fimpact.smoothing.parameters import Parameter
from fimpact.smoothing.prepare import Prepared, prepare
from fimpact.smoothing.smoother import Smoothed, smooth

DECADE = float(np.log(10))  # sd of the logarithm of a shape


@dataclass(frozen=True)
class Resolved:
    """One explanation refitted to all runs; weight: of all of them together 1."""

    name: str
    weight: float
    fitted: Smoothed


def stated_unknowns(recording: Recording, diagnosis: dict) -> np.ndarray:
    """Read where a `diagnosis` in plain types says that the unknowns are, (p,)."""
    after = {row["of"]: row["after"] for row in diagnosis["parameters"]}
    return np.array([after[unknown.name] for unknown in recording.unknowns])


def resolve(
    recording: Recording,
    added: Sequence[Run],
    members: Sequence[dict[str, dict]],
    begin: np.ndarray | None = None,
    progress: Callable[[str], None] = lambda line: None,
) -> list[Resolved]:
    """Refit `members` to the training runs of `recording` and those `added`, in falling order of weight.

    Args:
        members: each a mapping ``effect@site`` -> values, as `diagnosis.json` holds them.
        begin: unknowns where fits begin (`stated_unknowns`); None: as the model has them.

    Raises:
        ValueError: a member names no effect of the catalogue, or cannot be simulated on the added runs.
    """
    runs = [*recording.training, *(replace(run, held_out=False) for run in added)]
    prepared = prepare(recording, runs)
    naive = smooth(prepared.track, prepared.begun, prepared.noise, theta=begin, progress=progress)
    fits = [refit(prepared, naive, member, begin, progress) for member in members]
    for member, fit in zip(members, fits, strict=True):
        if not np.isfinite(fit.chi2):
            raise ValueError(f"{'+'.join(member)} at {member} cannot be simulated on the added runs")
    weights = weigh(fits)
    names = ["+".join(sorted(member)) for member in members]
    found = [Resolved(n, float(w), fit) for n, w, fit in zip(names, weights, fits, strict=True)]
    return sorted(found, key=lambda member: -member.weight)


def weigh(fits: Sequence[Smoothed]) -> np.ndarray:
    """Weights by the marginal likelihood; what did not converge, or has turned into a special case of itself, such as
    stick into slip at no distance, has none beside what is in order."""
    spread = max(fit.dispersion for fit in fits)
    losses = np.array([marginal_loss(fit, spread) for fit in fits])
    sound = np.array([fit.converged and not any(n.at_bound for n in shapes_of(fit)) for fit in fits])
    losses = np.where(np.isfinite(losses) & (sound | ~sound.any()), losses, np.inf)
    weights = np.exp(losses.min() - losses)
    return weights / weights.sum()


def marginal_loss(fit: Smoothed, dispersion: float = 1.0) -> float:
    """Minus the logarithm of the marginal likelihood, where a shape may be anything within a decade: a shape that the
    data do not see must gain nothing by being free."""
    shapes = shapes_of(fit)
    if not shapes:
        return fit.loss(dispersion)
    sd = [np.inf if n not in shapes else DECADE if n.log else n.size for n in fit.numbers]
    prior = np.diag(np.power(sd, -2.0))
    before, after = (np.linalg.slogdet(own)[1] for own in (fit.information, fit.information + prior))
    return fit.loss(dispersion) + (after - before) / 2 + float(np.log([own for own in sd if np.isfinite(own)]).sum())


def shapes_of(fit: Smoothed) -> list[Parameter]:
    """The numbers that mean nothing where an effect has no size."""
    own = {(place, c.name) for place, law in enumerate(fit.placed) for c in law.effect.coefficients if c.shape}
    return [number for number in fit.numbers if (number.place, number.name) in own]


def surviving_names(ranked: Sequence[Resolved]) -> list[str]:
    """Names that remain of what `resolve` returns: those that are not unlikely beside the likeliest."""
    return [member.name for member in ranked if member.weight > UNLIKELY * ranked[0].weight]


def refit(
    prepared: Prepared,
    naive: Smoothed,
    member: dict[str, dict],
    theta: np.ndarray | None = None,
    progress: Callable[[str], None] = lambda line: None,
) -> Smoothed:
    """Fit the effects of `member`, begun at its values and the unknowns at `theta`, default: those of `naive`."""
    scales = motion_scales(naive)
    found = [_placed(prepared, scales, name, values) for name, values in member.items()]
    placed, priors = [law for law, _ in found], [prior for _, prior in found]
    return smooth(prepared.track, prepared.begun, prepared.noise, placed, priors, naive, theta, progress)


def _placed(prepared: Prepared, scales: Scales, name: str, values: dict) -> tuple[Placed, dict[str, float]]:
    """One effect with the `values` that were stated, and the priors of its amplitudes."""
    known, _, site = name.partition("@")
    effect = get_effect(known)
    offered = at(effect, site, prepared.track.model, scales)
    if not offered:
        return Placed(effect, site, dict(values)), {}
    first = offered[0]
    own = {**effect.neutral, **values}
    return Placed(effect, site, own, first.sizes, first.ranges), first.priors
