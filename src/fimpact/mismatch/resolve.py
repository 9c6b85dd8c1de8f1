"""Resolve: what a further experiment says about the explanations that could not be told apart."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from fimpact.effects import EFFECTS, get_effect
from fimpact.effects.base import Placed, Scales
from fimpact.mismatch.coordinates import Coordinates, coordinates
from fimpact.mismatch.explain import Explanation, beside, corrected, explain, shapes_of, sizes_of
from fimpact.mismatch.fit import Fit, fit, lost, relinearised
from fimpact.mismatch.judge import Bench, base_fit, bench, settle
from fimpact.mismatch.price import STATED, schwarz
from fimpact.mismatch.problem import Point, Problem
from fimpact.mismatch.pulses import felt
from fimpact.mismatch.scales import scales
from fimpact.mismatch.score import proposals, scores
from fimpact.mismatch.settle import first_point, settled
from fimpact.mismatch.simulate import Hypothesis
from fimpact.mismatch.weigh import leading, led_by, weigh
from fimpact.mismatch.weigh import members as untold
from fimpact.recordings import Recording, Run

TURNING = 0.5  # share of what it costs that data choose a shape which one step must promise to gain
LOOK = 2  # steps of a fit that show whether its beginning is worth more
PASSES, ALIKE = 3, 0.25  # times that windows are left out, and how stray, relative to the worst, goes with it
CLOSE = 1 / 500  # weight, relative to the likeliest, that is worth numerics of its own, where several names have it
# Weight, relative to the likeliest, of a name that remains, and of one that says the same with more coefficients: an
# experiment asks which, not whether.
REMAINING, MORE = 1 / 20, 1 / 10


def stated(recording: Recording, diagnosis: dict) -> np.ndarray:
    """Where a `diagnosis` in plain types says that the unknowns are, (p,), beside its best name."""
    return np.array([row["after"] for row in diagnosis["parameters"][: len(recording.unknowns)]])


def resolve(
    recording: Recording, added: Sequence[Run], members: Sequence[dict[str, dict]], begin: np.ndarray | None = None
) -> list[Explanation]:
    """Members refitted to the recording with the runs `added` to its training runs, in falling order of weight, but for
    the first, which is `leading`.

    The first is fitted from what was measured, and the others from there: they are alike. Windows of the added runs
    that no member follows are left out: where a motion amplifies whatever is not known, it says nothing of any member,
    but it spoils all the fits.

    Args:
        members: each a mapping ``effect@site`` -> values, as `diagnosis.json` holds them, the likeliest first.
        begin: unknowns where fits begin (`stated`); None: as the model has them.
    """
    added = [replace(run, held_out=False) for run in added]
    made, rivals, begun = _followed(recording, added, members, begin)
    far: Collection[int] | None = ()  # that an experiment's windows stray is no reason for long steps
    if all(lost(rival.fitted.point) for rival in rivals):
        far = None
        rivals = _fitted(made, rivals[0].fitted.point.hypothesis.theta, begun, far)
    freed = [_refitted(made, rival, _values(rival), far, held=False) for rival in rivals if _may_turn(made, rival)]
    return _priced(_compared(made, rivals + freed))


def _followed(recording: Recording, added: list[Run], members: Sequence[dict], begin: np.ndarray | None) -> tuple:
    """The bench without the windows of the `added` runs that no member follows, the members' fits on it, and the values
    from which those began."""
    begun = members
    for attempt in range(PASSES + 1):
        made = bench(replace(recording, runs=(*recording.training, *added, *recording.held_out)))
        new = made.training.windows.runs >= len(recording.training)
        rivals = _fitted(made, made.training.simulator.theta if begin is None else begin, begun, ())
        begin = rivals[0].fitted.point.hypothesis.theta
        if not attempt and _stray(made, rivals, new).any():
            rivals = [_anew(made, rival) for rival in rivals]
            begun = list(map(_values, rivals))
        strays = _stray(made, rivals, new)
        if attempt == PASSES or not strays.any():
            break
        added = _left_out(made, added, strays)
    return made, rivals, begun


def _compared(made: Bench, rivals: list[Explanation]) -> list[Explanation]:
    """`rivals` by weight, those of several names that come near the likeliest with numerics of their own."""
    found = felt(made.training, rivals[0].fitted), felt(made.held_out, rivals[0].judged)
    ranked = weigh(made, *found, rivals)
    near = [r for r in ranked if r.weight >= CLOSE * ranked[0].weight]
    if len({r.name for r in near}) == 1:
        return ranked
    return weigh(made, *found, [*corrected(made, near), *ranked[len(near) :]])


def remaining(ranked: list[Explanation]) -> list[str]:
    """Names that remain of what `resolve` returns."""
    return [member.name for member in untold(ranked[0], ranked[1:], REMAINING, MORE)]


def _fitted(
    made: Bench, theta: np.ndarray, members: Sequence[dict[str, dict]], far: Collection[int] | None
) -> list[Explanation]:
    """The members' fits: the first from the unknowns `theta`, with numerics measured there, the others beside it."""
    problem = made.training
    bare = first_point(problem, coordinates(problem.simulator), Hypothesis(theta))
    placed = _placed(members[0], problem, scales(problem, bare))
    free = _free(problem, placed, held=True)
    _check(first_point(problem, free, Hypothesis(theta, placed)), members[0])
    first = explain(*base_fit(made, free, Hypothesis(theta, placed), far))
    return [first, *(_refitted(made, first, member, far) for member in members[1:])]


def _may_turn(made: Bench, rival: Explanation) -> bool:
    """Whether the shapes of `rival`, which are as stated, could gain what it costs that the data choose them, by their
    score."""
    fitted, shapes, free = rival.fitted, shapes_of(rival.placed), _free(made.training, rival.placed)
    shapes = [value for value in shapes if value not in fitted.coordinates.values]
    if not shapes:
        return False
    point, which = fitted.point, [free.unknowns + free.values.index(value) for value in shapes]
    base = made.training.predict(point.hypothesis, point.qpos, point.qvel)
    columns = made.training.columns(point, free, which, base, fitted.linear)
    found = scores(fitted, [rival.placed[i] for i, _ in shapes], list(np.moveaxis(columns, 2, 0)))
    gain = sum(c.z**2 for c in found if c.information > 0)
    return gain > TURNING * len(shapes) * (schwarz(rival.parts) - STATED)


def _anew(made: Bench, rival: Explanation) -> Explanation:
    """`rival`, or what its shapes come to from there or from where a screening begins them, if that fits better: what
    no recording showed of a shape may be far from what was stated."""
    if not shapes_of(rival.placed):
        return rival
    begun = _beginnings(made.training, rival)
    # Most beginnings lead nowhere, and a few steps show which do not.
    looks = [_fit(made, rival, values, held=False, look=True) for values in begun]
    best = min(looks, key=lambda fitted: fitted.point.cost)
    near = replace(rival, fitted=relinearised(made.training, best))
    placed = near.fitted.point.hypothesis.placed
    found = _refitted(made, near, {p.name: p.values for p in placed}, held=False)
    return min(rival, found, key=lambda r: r.fitted.point.cost)


def _beginnings(problem: Problem, rival: Explanation) -> list[dict[str, dict]]:
    """Values of `rival` as they are, and with each shape in turn as a screening begins it."""
    own, begun = _values(rival), [_values(rival)]
    for i, name in shapes_of(rival.placed):
        placed = rival.placed[i]
        values = sorted(_probed(problem, rival.fitted.point, placed, name) - {placed.values[name]})
        begun += [own | {placed.name: placed.values | {name: value}} for value in values]
    return begun


def _values(rival: Explanation) -> dict[str, dict]:
    return {placed.name: placed.values for placed in rival.placed}


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
    weighed.sort(key=lambda r: -r.weight)
    return led_by(leading(weighed, list(EFFECTS)), weighed)


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
    made: Bench, near: Explanation, member: dict[str, dict], far: Collection[int] | None = (), held: bool = True
) -> Explanation:
    """`member` fitted (`_fit`), and what that predicts of held-out windows."""
    fitted = _fit(made, near, member, far, held)
    return explain(fitted, settle(made.held_out, fitted.point.hypothesis, near.judged.point))


def _fit(
    made: Bench,
    near: Explanation,
    member: dict[str, dict],
    far: Collection[int] | None = (),
    held: bool = True,
    look: bool = False,
) -> Fit:
    """`member` fitted, from the unknowns and initial states of `near`; held: its shapes stay as stated; look: a few
    steps only."""
    problem, point = made.training, near.fitted.point
    placed = _placed(member, problem, scales(problem, point))
    free = _free(problem, placed, held)
    start = problem.evaluate(Hypothesis(point.hypothesis.theta, placed), point.qpos, point.qvel, free)
    _check(start, member)
    shared = replace(near.fitted, linear=near.fitted.linear.alone(free.unknowns))
    start = start if look else settled(problem, free, start, known=shared.linear)
    steps = LOOK if look else 12
    return fit(problem, free, start, steps, beside(problem, shared, start, free), refresh=not look, far=far)


def _check(start: Point, member: dict[str, dict]) -> None:
    if not np.isfinite(start.cost):
        raise ValueError(f"{'+'.join(member)} at {member} cannot be simulated on the added runs")


def _free(problem: Problem, placed: tuple[Placed, ...], held: bool = False) -> Coordinates:
    free = coordinates(problem.simulator, placed, tuple(map(sizes_of, placed)))
    return free.without(shapes_of(placed)) if held else free


def _placed(member: dict[str, dict], problem: Problem, found: Scales) -> tuple[Placed, ...]:
    placed = []
    for name, values in member.items():
        known, _, site = name.partition("@")
        effect = get_effect(known)
        sizes = next((p.sizes for p in proposals([effect], problem, found) if p.site == site), {})
        placed.append(Placed(effect, site, dict(values), sizes))
    return tuple(placed)
