"""Suppose: what a member of a set may be where the recordings show nothing of its shape.

A fit that has come to rest there says what the plain effect says in every experiment, and none could be designed to
tell the two apart.
"""

from collections.abc import Iterator
from contextlib import suppress

from fimpact.mismatch.explain import Explanation, void
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.resolve import beside_member, values_of
from fimpact.mismatch.scales import scales

BORNE = 2.0  # cost, half of squares, up to which recordings bear a version that fits them worse
NONE = 1e-6  # share of the largest amplitude below which one is none


def supposed(bench: Bench, member: Explanation) -> Fit:
    """The fit of `member` or, where a shape of it means nothing, of that version with the shape as a screening begins
    it which differs most from the plain effect (the least of its amplitudes is largest) among those that the recordings
    bear."""
    if not void(member):
        return member.fitted
    most = member.fitted.point.cost + BORNE
    return max((f for f in _fits(bench, member) if f.point.cost <= most), key=_least, default=member.fitted)


def _fits(bench: Bench, member: Explanation) -> Iterator[Fit]:
    for values in _versions(bench, member):
        with suppress(ValueError):  # where it cannot be simulated
            yield beside_member(bench, member, values)


def _versions(bench: Bench, member: Explanation) -> Iterator[dict[str, dict[str, float]]]:
    """Values of `member` with a shape that means nothing, and amplitudes that are none, as each probe has them; the
    probe as large as the effect is."""
    found = scales(bench.training, member.fitted.point)
    for i in sorted({i for i, _ in void(member)}):
        placed = member.placed[i]
        shapes = {c.name for c in placed.effect.coefficients if c.shape}
        largest = max(abs(v) for name, v in placed.values.items() if name not in shapes)
        for probe in placed.effect.probes(found, bench.training.simulator.base, placed.site):
            size = largest / max(abs(v) for name, v in probe.items() if name not in shapes)
            shaped = {name: v if name in shapes else size * v for name, v in probe.items()}
            kept = {n: v for n, v in placed.values.items() if n not in shapes and abs(v) > NONE * largest}
            yield values_of(member) | {placed.name: placed.values | shaped | kept}


def _least(fitted: Fit) -> float:
    placed = fitted.point.hypothesis.placed
    return min(abs(p.values[c.name]) for p in placed for c in p.effect.coefficients if not c.shape)
