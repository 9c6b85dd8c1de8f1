"""Fit the effects that somebody insists on, and no others: no search, and no choice among names."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from fimpact.effects.base import Effect, Placed, Scales
from fimpact.selection.regression import Regression
from fimpact.smoothing.candidates import Candidate, at
from fimpact.smoothing.columns import columns, motion_scales
from fimpact.smoothing.prepare import Prepared
from fimpact.smoothing.smoother import Smoothed, smooth


def fit_forced(
    prepared: Prepared,
    naive: Smoothed,
    places: Sequence[tuple[Effect, str]],
    progress: Callable[[str], None] = lambda line: None,
    known: Sequence[dict[str, float]] = (),
) -> Smoothed:
    """Fit the naive model with the effects at `places`, begun where a regression has them.

    Of an effect with shapes, the choice that explains most is begun with. What cannot be begun at all, because its
    column is nothing, begins at its probe.

    Args:
        known: values with which each begins instead, as far as there are any.
    """
    scales = motion_scales(naive)
    offered = [own for effect, site in places for own in at(effect, site, prepared.track.model, scales)]
    regression = Regression(naive, columns(naive, offered))
    placed, priors = [], []
    for i, (effect, site) in enumerate(places):
        own = [k for k, c in enumerate(offered) if c.effect.name == effect.name and c.site == site]
        best = max(own, key=lambda k: _explained(regression, k))
        law = _begun(regression, best, offered[best], scales)
        told = {name: value for name, value in (known[i] if known else {}).items() if name in law.values}
        placed.append(replace(law, values=law.values | told))
        priors.append(offered[best].priors)
    return smooth(prepared.track, prepared.begun, prepared.noise, placed, priors, naive, progress=progress)


def _columns(regression: Regression, candidate: int) -> list[int]:
    return [regression.p + i for i in regression.columns.of(candidate)]


def _explained(regression: Regression, candidate: int) -> float:
    found = regression.proper([*range(regression.p), *_columns(regression, candidate)])
    return -found.loss


def _begun(regression: Regression, index: int, candidate: Candidate, scales: Scales) -> Placed:
    found = regression.proper([*range(regression.p), *_columns(regression, index)])
    values = dict(zip(found.kept, found.values, strict=True))
    amplitudes = [0.1 * sd for sd in candidate.sd]
    for column in _columns(regression, index):
        amplitude = regression.columns.owners[column - regression.p][1]
        if values.get(column):
            amplitudes[amplitude] = values[column] * candidate.sd[amplitude]
    return candidate.placed(amplitudes)
