"""Where a refit begins: what a regression gives the members of a trial, beside what is in already."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fimpact.deciding import NOTHING, TRUST, TYPICAL
from fimpact.effects.base import Effect, Placed
from fimpact.selection.one_round import Trial
from fimpact.selection.regression import Regression
from fimpact.selection.substitutes import Exchange
from fimpact.smoothing.candidates import Candidate


def begun(regression: Regression, trial: Trial | Exchange) -> tuple[tuple[Placed, ...], tuple[dict[str, float], ...]]:
    """Members of a trial with the values that the regression gives them, and the priors of their amplitudes."""
    values: dict[int, dict[int, float]] = {}
    for column, value in zip(trial.estimate.kept, trial.estimate.values, strict=True):
        if column >= regression.p:
            owner, amplitude = regression.columns.owners[column - regression.p]
            values.setdefault(owner, {})[amplitude] = float(value)
    tried = regression.columns.candidates
    blends: dict[str, list[int]] = {}
    for owner in values:
        blends.setdefault(tried[owner].name, []).append(owner)
    placed = tuple(_blended([(tried[i], values[i]) for i in owners]) for owners in blends.values())
    return placed, tuple(tried[owners[0]].priors for owners in blends.values())


def _blended(parts: Sequence[tuple[Candidate, dict[int, float]]]) -> Placed:
    """One effect at one site with the amplitudes of all its choices of shapes, (amplitude -> in sd) each, at the mean
    of their shapes."""
    (first, _), weights = parts[0], [sum(map(abs, own.values())) + 1e-12 for _, own in parts]
    shapes = {name: float(np.average([c.shapes[name] for c, _ in parts], weights=weights)) for name in first.shapes}
    amplitudes = [sum(own.get(i, 0.0) for _, own in parts) * sd for i, sd in enumerate(first.sd)]
    return _within(replace(first, shapes=shapes).placed(amplitudes))


def held_by(effect: Effect, site: str, placed: Sequence[Placed]) -> list[int]:
    """Which of `placed` are special cases of an effect at the same site."""
    return [i for i, law in enumerate(placed) if law.site == site and law.effect.name in effect.contains]


def is_sum(candidate: Candidate, placed: Sequence[Placed]) -> bool:
    """Whether a candidate is one of `placed` and more of the same kind: it holds that, and has no shape of its own."""
    return bool(held_by(candidate.effect, candidate.site, placed)) and not candidate.shapes


def with_held(law: Placed, placed: Sequence[Placed]) -> Placed:
    """A law that takes the place of its special cases begins with their amplitudes."""
    values = dict(law.values)
    for i in held_by(law.effect, law.site, placed):
        own = next(c for c in placed[i].effect.coefficients if not c.shape)
        alike = [c.name for c in law.effect.coefficients if c.name in (own.name, placed[i].effect.name)]
        for name in alike[:1]:
            values[name] += placed[i].values[own.name]
    return replace(law, values=values)


def _within(placed: Placed) -> Placed:
    values = {c.name: float(np.clip(placed.values[c.name], c.low, c.high)) for c in placed.effect.coefficients}
    return replace(placed, values=values)


def at_typical_sizes(regression: Regression, trial: Trial) -> Trial:
    """`trial` with all members of its compound, at typical sizes where the regression has less of them."""
    columns = regression.columns
    values = dict(zip(trial.estimate.kept, trial.estimate.values, strict=True))
    own = {i: values.get(i, 0.0) for i in range(regression.p)}
    members = [columns.candidates[i] for i in trial.option.members]
    typical = {c.effect.name: TYPICAL * min(m.sd[0] for m in members if m.effect is c.effect) for c in members}
    for i, (owner, _) in enumerate(columns.owners, regression.p):
        candidate = columns.candidates[owner]
        if owner in trial.option.members:
            own[i] = max(values.get(i, 0.0), typical[candidate.effect.name] / candidate.sd[0])
    return replace(trial, estimate=replace(trial.estimate, kept=tuple(own), values=np.array(list(own.values()))))


def in_midst(placed: Sequence[Placed], priors: Sequence[dict[str, float]]) -> tuple[Placed, ...]:
    """Effects of which those that lie far below their like at other joints are put in their midst: far below as they
    are, and beside what their joints carry, since a wrist has a smaller gear; and alone, since it has two or three.

    Args:
        priors: sd of the amplitudes of each, as such parts have them.
    """
    sizes: dict[str, list[np.ndarray]] = {}
    for law, prior in zip(placed, priors, strict=True):
        sizes.setdefault(law.effect.name, []).append(_sizes(law, prior))
    moved = []
    for law, prior in zip(placed, priors, strict=True):
        alike, own = np.array(sizes[law.effect.name]), _sizes(law, prior)
        midst, name = np.median(alike, axis=0), law.effect.coefficients[0].name
        near = (alike[:, 0] < own[0] * TRUST) & (alike[:, 0] > own[0] / TRUST) & (alike[:, 1] > NOTHING)
        far = (own < midst / TRUST).all() and near.sum() < 2
        moved.append(replace(law, values=law.values | {name: float(midst[0])}) if far else law)
    return tuple(moved)


def _sizes(law: Placed, prior: dict[str, float]) -> np.ndarray:
    """The first amplitude of an effect as it is, and beside its prior, (2,)."""
    name = law.effect.coefficients[0].name
    return np.array([law.values[name], law.values[name] / prior.get(name, 1.0)])
