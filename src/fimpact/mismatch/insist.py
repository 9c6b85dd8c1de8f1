"""Insist: the effects that somebody names, where they are said to be, and no others; all values fitted."""

from collections.abc import Sequence

import numpy as np

from fimpact.effects.base import Effect
from fimpact.mismatch.explain import Explanation, numerics, refit, sharpened
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.pulses import pulses
from fimpact.mismatch.scales import scales
from fimpact.mismatch.score import proposals, screen

TRIES = 2  # probes of an effect from which its refit begins


def insisted(made: Bench, naive: Explanation, places: Sequence[tuple[Effect, str]]) -> Explanation:
    """`naive` with effects, (effect, site) each, added one after the other, and refitted together; what changes nothing
    in the training windows, or makes all of them diverge, is left out."""
    current = naive
    for effect, site in places:
        current = _with(made, current, effect, site)
    if current is naive:
        return naive
    return sharpened(made, pulses(made.training, naive.fitted), numerics(made, current))


def _with(made: Bench, current: Explanation, effect: Effect, site: str) -> Explanation:
    """`current` with one effect, refitted from its best probes."""
    problem = made.training
    every = proposals([effect], problem, scales(problem, current.fitted.point))
    tried = screen(problem, current.fitted, [p for p in every if p.site == site])
    ranked = sorted(tried, key=lambda c: -c.gain)[:TRIES]
    fits = [found for found in (refit(made, current, c) for c in ranked) if np.isfinite(found.deviance)]
    return min(fits, key=lambda e: e.deviance, default=current)
