"""Widen: a more general law in the place of a special one that was named.

Beside another effect a special case may take part of what it lacks from that one, or from a third, and where nothing is
near the noise no single step shows it. So the general law is fitted from where the special one is.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from fimpact.effects.base import Placed
from fimpact.mismatch.coordinates import coordinates
from fimpact.mismatch.explain import Explanation, explain, sizes_of
from fimpact.mismatch.fit import Fit, fit
from fimpact.mismatch.judge import Bench, settle
from fimpact.mismatch.score import Candidate
from fimpact.mismatch.simulate import Hypothesis

LOOK = 3  # steps of a fit that show whether its beginning is worth more


def widened(
    bench: Bench, current: Explanation, candidates: Sequence[Candidate], progress: Callable[[str], None] = print
) -> Iterator[Explanation]:
    """`current` with each general law among the `candidates` in the place of its special case, refitted from the most
    promising of its probes, as strong as that."""
    for i, special in enumerate(current.placed):
        taken = {placed.name for placed in current.placed}
        general = [c.placed for c in candidates if special.effect.name in c.placed.effect.contains]
        probes = [placed for placed in general if placed.site == special.site and placed.name not in taken]
        for name in dict.fromkeys(placed.name for placed in probes):
            progress(f"refitting with {name} in the place of {special.name}")
            begun = [_instead(current, i, placed) for placed in probes if placed.name == name]
            looks = [_fit(bench, current.fitted, placed, LOOK) for placed in begun]
            best = min(looks, key=lambda fitted: np.nan_to_num(fitted.point.cost, nan=np.inf))
            if np.isfinite(best.point.cost):
                fitted = _fit(bench, best, best.point.hypothesis.placed)
                yield explain(fitted, settle(bench.held_out, fitted.point.hypothesis, current.judged.point))


def _instead(current: Explanation, i: int, general: Placed) -> tuple[Placed, ...]:
    """The effects of `current`, that of index `i` replaced."""
    share = _size(current.placed[i]) / _size(general)
    strengths = {
        c.name: float(np.clip(general.values[c.name] * share, c.low, c.high))
        for c in general.effect.coefficients
        if not c.shape
    }
    return (*current.placed[:i], replace(general, values=general.values | strengths), *current.placed[i + 1 :])


def _size(placed: Placed) -> float:
    return float(np.linalg.norm([placed.values[c.name] for c in placed.effect.coefficients if not c.shape]))


def _fit(bench: Bench, near: Fit, placed: tuple[Placed, ...], steps: int = 12) -> Fit:
    problem, point = bench.training, near.point
    free = coordinates(problem.simulator, placed, tuple(map(sizes_of, placed)))
    start = problem.evaluate(Hypothesis(point.hypothesis.theta, placed), point.qpos, point.qvel, free)
    return fit(problem, free, start, steps, refresh=steps > LOOK)
