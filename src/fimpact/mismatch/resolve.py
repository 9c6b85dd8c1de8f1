"""Resolve: what a further experiment says about the explanations that could not be told apart."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from fimpact.effects import get_effect
from fimpact.effects.base import Placed, Scales
from fimpact.mismatch.coordinates import coordinates
from fimpact.mismatch.explain import Explanation, beside, corrected, explain, shapes_of, sizes_of
from fimpact.mismatch.fit import Fit, fit, lost
from fimpact.mismatch.judge import Bench, base_fit, bench, settle
from fimpact.mismatch.price import schwarz
from fimpact.mismatch.problem import Point, Problem
from fimpact.mismatch.pulses import pulses
from fimpact.mismatch.scales import scales
from fimpact.mismatch.score import proposals
from fimpact.mismatch.settle import settled
from fimpact.mismatch.simulate import Hypothesis
from fimpact.mismatch.weigh import members as untold
from fimpact.mismatch.weigh import weigh
from fimpact.recordings import Recording, Run

PASSES, ALIKE = 3, 0.25  # times that windows are left out, and how stray, relative to the worst, goes with it
CLOSE = 1e-4  # weight, relative to the likeliest, that is worth numerics of its own, where several names have it
# Weight, relative to the likeliest, of a name that remains, and of one that says the same with more coefficients: an
# experiment asks which, not whether.
REMAINING, MORE = 1 / 20, 1 / 10


Begin = tuple[np.ndarray, np.ndarray]  # unknowns, (p,): of the naive fit, and of the members


def stated(recording: Recording, diagnosis: dict) -> Begin:
    """Where a `diagnosis` in plain types says that the unknowns are, naively and beside its best name."""
    rows = diagnosis["parameters"][: len(recording.unknowns)]
    return np.array([row["naive"] for row in rows]), np.array([row["after"] for row in rows])


def resolve(
    recording: Recording, added: Sequence[Run], members: Sequence[dict[str, dict]], begin: Begin | None = None
) -> list[Explanation]:
    """Members refitted to the recording with the runs `added` to its training runs, in falling order of weight.

    Windows of the added runs that no member follows are left out: where a motion amplifies whatever is not known, it
    says nothing of any member, but it spoils all the fits.

    Args:
        members: each a mapping ``effect@site`` -> values, as `diagnosis.json` holds them.
        begin: where fits begin (`stated`); None: as the model has it.
    """
    added = [replace(run, held_out=False) for run in added]
    made, naive, rivals, begun = _followed(recording, added, members, begin)
    far: Collection[int] | None = ()  # that an experiment's windows stray is no reason for long steps
    if all(lost(rival.fitted.point) for rival in rivals):
        far = None
        naive, rivals = _fitted(made, [e.point.hypothesis.theta for e in (naive[0], rivals[0].fitted)], begun, far)
    shaped = [member for member, rival in zip(members, rivals, strict=True) if shapes_of(rival.placed)]
    stated = [_refitted(made, naive, member, far, held=True) for member in shaped]
    return _priced(_compared(made, naive, rivals + stated))


def _followed(recording: Recording, added: list[Run], members: Sequence[dict], begin: Begin | None) -> tuple:
    """The bench without the windows of the `added` runs that no member follows, the naive model's fits and the members'
    on it, and the values from which those began."""
    begun = members
    for attempt in range(PASSES + 1):
        made = bench(replace(recording, runs=(*recording.training, *added, *recording.held_out)))
        new = made.training.windows.runs >= len(recording.training)
        naive, rivals = _fitted(made, begin or (made.training.simulator.theta,) * 2, begun, ())
        begin = naive[0].point.hypothesis.theta, rivals[0].fitted.point.hypothesis.theta
        if not attempt and _stray(made, rivals, new).any():
            rivals = [_anew(made, naive, rival) for rival in rivals]
            begun = [{p.name: p.values for p in rival.placed} for rival in rivals]
        strays = _stray(made, rivals, new)
        if attempt == PASSES or not strays.any():
            break
        added = _left_out(made, added, strays)
    return made, naive, rivals, begun


def _compared(made: Bench, naive: tuple[Fit, Fit], rivals: list[Explanation]) -> list[Explanation]:
    """`rivals` by weight, those of several names that come near the likeliest with numerics of their own."""
    found = pulses(made.training, naive[0]), pulses(made.held_out, naive[1])
    ranked = weigh(made, *found, rivals)
    near = [r for r in ranked if r.weight >= CLOSE * ranked[0].weight]
    if len({r.name for r in near}) == 1:
        return ranked
    return weigh(made, *found, [*corrected(made, near), *ranked[len(near) :]])


def remaining(ranked: list[Explanation]) -> list[str]:
    """Names that remain of what `resolve` returns."""
    return [member.name for member in untold(ranked[0], ranked[1:], REMAINING, MORE)]


def _fitted(made: Bench, begin: Begin, members: Sequence[dict[str, dict]], far: Collection[int] | None) -> tuple:
    """The naive model's fits, in training and held-out windows, and the members'."""
    naive = base_fit(made, coordinates(made.training.simulator), Hypothesis(begin[0]), far)
    return naive, [_refitted(made, naive, member, far, theta=begin[1]) for member in members]


def _anew(made: Bench, naive, rival: Explanation) -> Explanation:
    """`rival`, or what its shapes come to from where a screening begins them, if that fits better: what no recording
    showed of a shape may be far from what was stated."""
    found, own = [rival], {p.name: p.values for p in rival.placed}
    for i, name in shapes_of(rival.placed):
        placed = rival.placed[i]
        for value in _probed(made.training, naive[0].point, placed, name) - {placed.values[name]}:
            found.append(_refitted(made, naive, own | {placed.name: placed.values | {name: value}}))
    return min(found, key=lambda r: r.fitted.point.cost)


def _probed(problem: Problem, point: Point, placed: Placed, name: str) -> set[float]:
    """What a screening tries for the shape `name`."""
    probes = placed.effect.probes(scales(problem, point), problem.simulator.base, placed.site)
    return {probe[name] for probe in probes}


def _priced(ranked: list[Explanation]) -> list[Explanation]:
    """Each explanation once, with its shapes as stated or, at the price of any coefficient that the data choose, as
    they are now: one that has turned into its special case, stick into slip at no distance, is no rival of that."""
    best: dict[str, tuple[float, Explanation]] = {}
    for rival in ranked:
        cost = _cost(rival)
        if rival.name not in best or cost < best[rival.name][0]:
            best[rival.name] = cost, rival
    costs = np.array([cost for cost, _ in best.values()])
    raw = np.exp(-(costs - costs.min()) / 2)
    weighed = [replace(r, weight=float(w)) for (_, r), w in zip(best.values(), raw / raw.sum(), strict=True)]
    return sorted(weighed, key=lambda r: -r.weight)


def _cost(rival: Explanation) -> float:
    """Deviance in units of its dispersion, and the price of shapes that the data moved."""
    free = len(rival.fitted.coordinates.values) == sum(len(p.effect.coefficients) - len(p.held) for p in rival.placed)
    moved = free * (len(shapes_of(rival.placed)) * schwarz(rival.parts) - rival.shaped)
    return rival.deviance / rival.dispersion + moved


def _stray(made: Bench, rivals: list[Explanation], new: np.ndarray) -> np.ndarray:
    """Of the windows, (w,), those `new` ones that every rival follows worse than any recorded one, the worst of them:
    one of those can spoil the fit of others."""
    samples = np.maximum(np.isfinite(made.training.windows.measured).sum((1, 2)), 1)
    size = np.min([rival.fitted.point.squares for rival in rivals], 0) / samples
    return new & (size > max(size[~new].max(), ALIKE * size.max()))


def _left_out(made: Bench, added: list[Run], strays: np.ndarray) -> list[Run]:
    """The added runs without what was measured in the windows `strays`."""
    windows, out = made.training.windows, [run.measured.copy() for run in added]
    before = len(made.training.simulator.recording.training) - len(added)
    for run, first in zip(windows.runs[strays] - before, windows.first[strays], strict=True):
        out[run][first : first + windows.length] = np.nan
    return [replace(run, measured=measured) for run, measured in zip(added, out, strict=True)]


def _refitted(
    made: Bench,
    naive,
    member: dict[str, dict],
    far: Collection[int] | None = (),
    held: bool = False,
    theta: np.ndarray | None = None,
) -> Explanation:
    """`member` fitted, from the unknowns `theta` or those of the naive fit; held: its shapes stay as stated."""
    problem, point = made.training, naive[0].point
    placed = _placed(member, problem, scales(problem, point))
    free = coordinates(problem.simulator, placed, tuple(map(sizes_of, placed)))
    free = free.without(shapes_of(placed)) if held else free
    theta = point.hypothesis.theta if theta is None else theta
    start = problem.evaluate(Hypothesis(theta, placed), point.qpos, point.qvel, free)
    if not np.isfinite(start.cost):
        raise ValueError(f"{'+'.join(member)} at {member} cannot be simulated on the added runs")
    start = settled(problem, free, start)
    fitted = fit(problem, free, start, 12, beside(problem, naive[0], start, free), far=far)
    return explain(fitted, settle(made.held_out, fitted.point.hypothesis, naive[1].point))


def _placed(member: dict[str, dict], problem: Problem, found: Scales) -> tuple[Placed, ...]:
    placed = []
    for name, values in member.items():
        known, _, site = name.partition("@")
        effect = get_effect(known)
        sizes = next((p.sizes for p in proposals([effect], problem, found) if p.site == site), {})
        placed.append(Placed(effect, site, dict(values), sizes))
    return tuple(placed)
