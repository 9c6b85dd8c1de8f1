"""Discriminate: the experiment that tells apart the explanations that the recordings cannot.

For two explanations k and l, the non-centrality of their difference is what is left of y_k - y_l when initial states
and the uncertain parameters have absorbed what they can. The experiment maximises the least of it over all pairs,
within the commands and starts that the recordings themselves used.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from cmaes import CMA

from fimpact.mismatch.explain import Explanation
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.simulate import Windows
from fimpact.recordings import Recording

KNOTS = 8  # per actuator, joined by straight lines
POOL, GENERATIONS = 32, 8  # random experiments to start from, and populations of as many that follow
NEEDED = 11.0  # non-centrality for 80 % power at 1 %


@dataclass(frozen=True)
class Experiment:
    """Commands to play: ctrl (T, nu) every period s, from qpos (nq,) and qvel (nv,); separation: least predicted
    non-centrality between two members; random: the median of that over random experiments of the same limits;
    repeats: experiments needed for 80 % power at 1 %."""

    ctrl: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    period: float
    separation: float
    random: float
    repeats: int


@dataclass(frozen=True)
class Limits:
    """What the recordings used: bounds of a flat design, (d,), and how it becomes an experiment."""

    low: np.ndarray
    high: np.ndarray
    samples: int
    nu: int
    nq: int

    def unpack(self, design: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """ctrl (T, nu), qpos (nq,), qvel (nv,)."""
        knots, start = design[: KNOTS * self.nu].reshape(KNOTS, self.nu), design[KNOTS * self.nu :]
        place = np.linspace(0, KNOTS - 1, self.samples)
        ctrl = np.stack([np.interp(place, np.arange(KNOTS), column) for column in knots.T], 1) if self.nu else None
        return np.zeros((self.samples, 0)) if ctrl is None else ctrl, start[: self.nq], start[self.nq :]


def limits(bench: Bench, recording: Recording) -> Limits:
    """Smallest and largest command of each actuator and state at a run's start, over the training runs."""
    problem = bench.training
    ctrl = np.concatenate([run.ctrl for run in recording.training])
    begins = problem.windows.first == 0
    start = np.concatenate([part[begins] for part in problem.starts], 1)
    low = np.concatenate([np.tile(ctrl.min(0), KNOTS), start.min(0)])
    high = np.concatenate([np.tile(ctrl.max(0), KNOTS), start.max(0)])
    samples = max(len(run.measured) for run in recording.training)
    return Limits(low, high, samples, ctrl.shape[1], problem.simulator.base.nq)


def discriminate(bench: Bench, recording: Recording, members: list[Explanation], seed: int = 0) -> Experiment:
    """The experiment that separates `members` best."""
    allowed, rng = limits(bench, recording), np.random.default_rng(seed)
    span = np.maximum(allowed.high - allowed.low, 1e-9)
    pool = rng.uniform(allowed.low, allowed.low + span, (POOL, len(span)))
    values = separations(bench, members, allowed, pool)
    random, best, best_value = float(np.median(values)), pool[np.argmax(values)], values.max()
    cma = CMA((best - allowed.low) / span, 0.2, np.tile([0.0, 1.0], (len(span), 1)), seed=seed, population_size=POOL)
    for _ in range(GENERATIONS):
        asked = np.array([cma.ask() for _ in range(POOL)])
        values = separations(bench, members, allowed, allowed.low + asked * span)
        cma.tell([(point, -value) for point, value in zip(asked, values, strict=True)])
        if values.max() > best_value:
            best, best_value = allowed.low + asked[np.argmax(values)] * span, values.max()
    repeats = int(np.ceil(NEEDED / max(best_value, 1e-9)))
    return Experiment(*allowed.unpack(best), recording.period, float(best_value), random, repeats)


def separations(bench: Bench, members: list[Explanation], allowed: Limits, designs: np.ndarray) -> np.ndarray:
    """Least non-centrality between two members for each design, (n,); 0 where a simulation diverges."""
    problem = _played(bench, members[0], allowed, designs)
    predicted, linears = [], []
    for member in members:
        point = problem.evaluate(member.fitted.point.hypothesis, *problem.starts, member.fitted.coordinates)
        linears.append(problem.linearise(point, member.fitted.coordinates))
        predicted.append(problem.extend(problem.predict(point.hypothesis, *problem.starts)[..., None])[..., 0])
    pairs = [
        _left(predicted[k] - predicted[m], linears[k], np.linalg.pinv(members[k].fitted.covariance), len(designs))
        for k, m in combinations(range(len(members)), 2)
    ]
    least = np.min(pairs, 0)
    return np.where(np.isfinite(least), least, 0.0)


def _played(bench: Bench, member: Explanation, allowed: Limits, designs: np.ndarray) -> Problem:
    """The designs' windows, cut as the recordings are, from states on the way that `member` predicts."""
    ctrl, qpos, qvel = (np.array(part) for part in zip(*map(allowed.unpack, designs), strict=True))
    simulator, known = bench.training.simulator, bench.training.windows
    length = min(known.length, allowed.samples)
    firsts = np.arange(0, allowed.samples - length + 1, length)
    whole = np.zeros((len(designs), allowed.samples, known.measured.shape[2]))
    every = Windows(np.arange(len(designs)), np.zeros(len(designs), int), whole, ctrl, ())
    way = simulator.motion(member.fitted.point.hypothesis, every, qpos, qvel)
    path = [np.concatenate([start[:, None], states], 1) for start, states in zip((qpos, qvel), way, strict=True)]
    starts = [states[:, firsts * simulator.substeps].reshape(-1, states.shape[2]) for states in path]
    runs, first = np.repeat(np.arange(len(designs)), len(firsts)), np.tile(firsts, len(designs))
    windows = Windows(runs, first, np.zeros((len(runs), length, whole.shape[2])), ctrl, ())
    return Problem(simulator, windows, bench.noise, tuple(starts), np.full(2 * simulator.base.nv, np.inf))


def _left(difference: np.ndarray, linear, known: np.ndarray, designs: int) -> np.ndarray:
    """||difference||^2 after initial states and parameters, with what is known of them, absorbed theirs, (designs,)."""
    free = linear.off(difference).reshape(designs, -1)
    slopes = linear.projected.reshape(designs, free.shape[1], -1)
    along = np.einsum("nma,nm->na", slopes, free)
    gram = np.einsum("nma,nmb->nab", slopes, slopes)
    inner = np.linalg.solve(known + gram, along[..., None])[..., 0]
    return (free**2).sum(1) - (along * inner).sum(1)
