"""Separate: how far an experiment that nobody has played would drive two explanations apart.

The non-centrality of k under l is what is left of y_l - y_k when initial states, the clock and the coordinates of k
have absorbed what they can, each as far as the recordings leave it open, among the disturbance that the recordings
show and the error of the time step: wild motion magnifies a difference, and with it everything that hides it, so no
window alone can separate. All start from the unknowns in which they differ least: what a mass is that the recordings
leave open is no difference between two effects. Shapes stay as they are stated, as `resolve` asks first: a spring may
always turn into a constant force.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.linalg import block_diag

from fimpact.effects.sites import HINGE, SLIDE
from fimpact.mismatch.colour import CLOCK, Colour, colour
from fimpact.mismatch.coordinates import NOTHING
from fimpact.mismatch.disturbance import Disturbance, disturbance
from fimpact.mismatch.explain import Explanation, shapes_of
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.generalised import REWEIGHTED, generalised
from fimpact.mismatch.judge import Bench, correct
from fimpact.mismatch.problem import Linear, Point, Problem
from fimpact.mismatch.pulses import felt
from fimpact.mismatch.simulate import Hypothesis, Simulator
from fimpact.mismatch.turned import turns
from fimpact.mismatch.weigh import generalises
from fimpact.mismatch.windows import Windows

OPEN = 1e-13  # added to scaled information, so that a direction without any can be solved for
MOST = 9.0  # non-centrality that one window may be counted for


@dataclass(frozen=True)
class Known:
    """What the recordings say: the disturbance in them, the members' fits where their unknowns meet, and the
    information of each on its coordinates, but for shapes, and on the clock of a further run, (k + 1, k + 1)."""

    pushing: Disturbance
    fits: list[Fit]
    information: list[np.ndarray]


def known(bench: Bench, members: list[Explanation]) -> Known:
    """What is known before the experiment."""
    found = felt(bench.training, members[0].fitted)
    pushing, fits = disturbance(members[0].fitted, found), [member.fitted for member in members]
    told = [_information(fitted, colour(found, pushing)) for fitted in fits]
    return Known(pushing, _meeting(fits, told), [block_diag(own, CLOCK**-2.0) for own in told])


def _information(fitted: Fit, shade: Colour) -> np.ndarray:
    own = generalised([fitted], [shade]).information
    return own[np.ix_(_sizes(fitted), _sizes(fitted))]


def _meeting(fits: list[Fit], told: list[np.ndarray]) -> list[Fit]:
    """The fits at the unknowns that cost all of them least, effects as large as the recordings say they are there."""
    count = fits[0].coordinates.unknowns
    rows = [np.linalg.pinv(own[count:, count:], hermitian=True) @ own[count:, :count] for own in told]
    weights = [own[:count, :count] - own[:count, count:] @ row for own, row in zip(told, rows, strict=True)]
    at = [fitted.point.hypothesis.theta for fitted in fits]
    pull = np.sum([weight @ theta for weight, theta in zip(weights, at, strict=True)], 0)
    shared = np.linalg.lstsq(np.sum(weights, 0), pull, rcond=1e-12)[0]
    return [_moved(fitted, shared, -row @ (shared - theta)) for fitted, row, theta in zip(fits, rows, at, strict=True)]


def _moved(fitted: Fit, theta: np.ndarray, by: np.ndarray) -> Fit:
    free, hypothesis = fitted.coordinates, fitted.point.hypothesis
    z = free.read(hypothesis)
    z[: free.unknowns] = theta
    z[_sizes(fitted)[free.unknowns :]] += by
    moved = free.write(hypothesis, np.clip(z, free.low, free.high))
    return replace(fitted, point=replace(fitted.point, hypothesis=moved))


def _sizes(fitted: Fit) -> list[int]:
    """Indices of the coordinates that are no shapes."""
    free = fitted.coordinates
    shapes = [value in shapes_of(fitted.point.hypothesis.placed) for value in free.values]
    return [*range(free.unknowns), *(free.unknowns + np.flatnonzero(~np.array(shapes, bool)))]


def separations(bench: Bench, told: Known, ctrl, qpos, qvel) -> np.ndarray:
    """Non-centrality of each pair of `told` members for each of n experiments, (n, pairs); 0 where one diverges: the
    lesser of one under the other and the other under the one, or, where one is a special case, which the other can
    always do as well, that of the other under the special one.

    Args:
        ctrl: (n, T, nu). qpos: (n, nq). qvel: (n, nv).
    """
    first = told.fits[0]
    problem = _played(bench, first, ctrl, qpos, qvel)
    point = problem.evaluate(Hypothesis(first.point.hypothesis.theta), *problem.starts, NOTHING)
    shade = _noise(bench, problem, first, point, told.pushing)
    shared = _shared(problem, point, first)
    predicted, linears = zip(*(_member(problem, fitted, shared) for fitted in told.fits), strict=True)
    linears = [shade.apply(linear) for linear in linears]
    found = []
    for a, b in combinations(range(len(predicted)), 2):
        under = [one for one, other in ((a, b), (b, a)) if not _contains(told.fits[one], told.fits[other])] or [a, b]
        apart = predicted[a] - predicted[b]
        found.append(np.min([_left(apart, linears[one], told.information[one], len(ctrl)) for one in under], 0))
    least = np.array(found).T
    return np.where(np.isfinite(least), least, 0.0)


def _contains(one: Fit, other: Fit) -> bool:
    return generalises(one.point.hypothesis, other.point.hypothesis)


def _played(bench: Bench, member: Fit, ctrl, qpos, qvel) -> Problem:
    """The experiments' windows, cut as the recordings are, from states on the way that `member` predicts."""
    simulator, cut, (count, samples) = bench.training.simulator, bench.training.windows, ctrl.shape[:2]
    length = min(cut.length, samples)
    firsts = np.arange(0, samples - length + 1, length)
    whole = np.zeros((count, samples, cut.measured.shape[2]))
    every = Windows(np.arange(count), np.zeros(count, int), whole, ctrl, ())
    way = simulator.motion(member.point.hypothesis, every, qpos, qvel)
    path = [np.concatenate([start[:, None], states], 1) for start, states in zip((qpos, qvel), way, strict=True)]
    starts = [states[:, firsts * simulator.substeps].reshape(-1, states.shape[2]) for states in path]
    runs, first = np.repeat(np.arange(count), len(firsts)), np.tile(firsts, count)
    turned = _turned(simulator, path[0], runs, first * simulator.substeps)
    windows = Windows(runs, first, np.zeros((len(runs), length, whole.shape[2])), ctrl, (), turned=turned)
    spread = np.where(first[:, None] == 0, simulator.recording.start_sd, np.inf)
    return Problem(simulator, windows, bench.noise, tuple(starts), spread)


def _turned(simulator: Simulator, path: np.ndarray, runs: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Where joints turn on the `path`, (n, steps, nq), of each run."""
    model = simulator.base
    joints = [j for j in range(model.njnt) if model.jnt_type[j] in (HINGE, SLIDE)]
    ways = {int(model.jnt_dofadr[j]): path[:, :, model.jnt_qposadr[j]] for j in joints}
    return turns(ways, runs, first, dict.fromkeys(ways, 0.0), model.nv)


def _noise(bench: Bench, problem: Problem, member: Fit, point: Point, pushing: Disturbance) -> Colour:
    """What `pushing` does in the windows of `problem`, whose own noise is raised by the error of the time step."""
    correct(bench, problem, point)
    shade = colour(felt(problem, replace(member, point=point)), pushing)
    return replace(shade, clocks=shade.clocks.sum(2, keepdims=True))


def _shared(problem: Problem, point: Point, member: Fit) -> Linear:
    """Sensitivities to initial states and unknowns, which effects that hide so well hardly change."""
    base, free = problem.predict(point.hypothesis, point.qpos, point.qvel), member.coordinates
    own = free.without(free.values)
    nothing = problem.extend(np.zeros((*base.shape, 0)))
    linear = Linear(*problem.starts_at(point, base), nothing, nothing)
    return linear.and_of(problem.columns(point, own, range(own.unknowns), base, linear))


def _member(problem: Problem, fitted: Fit, shared: Linear) -> tuple[np.ndarray, Linear]:
    """What a member predicts, (w, m), and its problem linearised, but for what is projected off."""
    hypothesis, free = fitted.point.hypothesis, fitted.coordinates
    base = problem.predict(hypothesis, *problem.starts)
    point = replace(fitted.point, qpos=problem.starts[0], qvel=problem.starts[1])
    own = problem.columns(point, free, _sizes(fitted)[free.unknowns :], base, shared)
    return problem.extend(base[..., None])[..., 0], shared.and_of(own)


def _left(difference: np.ndarray, linear: Linear, information: np.ndarray, count: int) -> np.ndarray:
    """What is left of squares of `difference` in each experiment, (count,); windows that would count for more than
    `MOST` neither do nor pull the coordinates (iteratively reweighted)."""
    free = linear.off(difference).reshape(count, -1, difference.shape[1])
    slopes = linear.projected.reshape(*free.shape, -1)
    weight = np.ones(free.shape[:2])
    for _ in range(REWEIGHTED):
        along = np.einsum("nwma,nwm,nw->na", slopes, free, weight)
        gram = np.einsum("nwma,nwmb,nw->nab", slopes, slopes, weight, optimize=True)
        step = _solved(information + gram, along)
        squares = ((free - np.einsum("nwma,na->nwm", slopes, step)) ** 2).sum(2)
        weight = 1 / np.maximum(squares / MOST, 1.0)
    return np.minimum(squares, MOST).sum(1) + np.einsum("na,ab,nb->n", step, information, step)


def _solved(information: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Newton steps, (n, k); what neither the recordings nor an experiment show stays where it is."""
    size = np.sqrt(np.einsum("naa->na", information))
    size = np.where(size > 0, size, 1.0)
    scaled = information / (size[:, :, None] * size[:, None, :]) + OPEN * np.eye(size.shape[1])
    return np.linalg.solve(scaled, (along / size)[..., None])[..., 0] / size
