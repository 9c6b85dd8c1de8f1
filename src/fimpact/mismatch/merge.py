"""Merge: an effect's probes along several axes, as one candidate in the direction that the data ask for.

Gravity that leans at 45 degrees shows half of itself about either axis, and would be passed over for a rival that has
one probe of the right shape.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fimpact.mismatch.fit import Fit
from fimpact.mismatch.score import Candidate, score, two_sided


def merged(fitted: Fit, candidates: Sequence[Candidate]) -> list[Candidate]:
    """A candidate for every linear effect that has several probes of the same shape, at strength 1, if its bounds
    allow the mixture."""
    groups: dict[tuple, list[Candidate]] = {}
    for candidate in candidates:
        if candidate.placed.effect.linear:
            groups.setdefault(_shape(candidate), []).append(candidate)
    mixed = [_mixture(fitted, group) for group in groups.values() if len(group) > 1]
    return [candidate for candidate in mixed if candidate]


def _shape(candidate: Candidate) -> tuple:
    """Name, and the values that are no amplitudes."""
    placed = candidate.placed
    shapes = sorted((c.name, placed.values[c.name]) for c in placed.effect.coefficients if c.shape)
    return placed.name, *shapes


def _mixture(fitted: Fit, group: Sequence[Candidate]) -> Candidate | None:
    columns = np.stack([c.column.ravel() for c in group], 1)
    free = np.stack([fitted.linear.off(c.change).ravel() for c in group], 1)
    asked = np.array([c.shares.sum() for c in group])
    strength = np.linalg.lstsq(columns.T @ free, asked, rcond=1e-6)[0]
    effect, values = group[0].placed.effect, dict(group[0].placed.values)
    if not two_sided(effect) and (strength < 0).any():
        return None
    for c in effect.coefficients:
        if not c.shape:
            values[c.name] = float(sum(s * g.placed.values[c.name] for s, g in zip(strength, group, strict=True)))
    change = sum(s * g.change for s, g in zip(strength, group, strict=True))
    return score(fitted, replace(group[0].placed, values=values), change)
