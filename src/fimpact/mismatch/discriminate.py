"""Discriminate: the experiment that tells apart the explanations that the recordings cannot.

The experiment separates all pairs, within the commands and starts that the recordings themselves used.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from cmaes import CMA

from fimpact.mismatch.explain import Explanation
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.separate import known, separations
from fimpact.recordings import Recording

KNOTS = 8  # per actuator
ABRUPT = 0.02  # share of the way between two knots in which the quickest commands change
QUICKEST = 4  # samples: the shortest period of a square wave on top, for what shows at a change of the command only
POOL = 48  # random experiments to start from, a third of them calmer than the limits allow, a third with square waves
POPULATION, GENERATIONS = 8, 64  # of the search that follows
SPREAD = 0.1  # its first steps, of the limits
NEEDED = 11.0  # non-centrality for 80 % power at 1 %
ENOUGH, PATIENCE = 2.5 * NEEDED, 12  # separation of all pairs, and generations in a row no better, that end the search
BETTER = 1.02  # times the worth, of an experiment that keeps it going
TRIED, VAIN = 16, 0.02  # generations after which a search ends whose best is worth less


@dataclass(frozen=True)
class Experiment:
    """Commands to play: ctrl (T, nu) every period s, from qpos (nq,) and qvel (nv,); pairs: predicted non-centrality
    between each two members, in the order of `itertools.combinations` (`separations`); random: the median of the least
    of them over random experiments of the same limits."""

    ctrl: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    period: float
    pairs: np.ndarray
    random: float

    @property
    def separation(self) -> float:
        """The least of the pairs'."""
        return float(self.pairs.min())


def repeats(separation: float) -> int:
    """Experiments needed for 80 % power at 1 %."""
    return int(np.ceil(NEEDED / max(separation, 1e-9)))


@dataclass(frozen=True)
class Limits:
    """What the recordings used: bounds of a flat design, (d,), and how it becomes an experiment: the height of each
    knot, how gently commands go from one to the next, how much of its range each command takes for a square wave, how
    quick that is, 0 to 1, and the start."""

    low: np.ndarray
    high: np.ndarray
    samples: int
    model: mujoco.MjModel

    @property
    def nu(self) -> int:
        """Number of commands."""
        return self.model.nu

    def unpack(self, design: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """ctrl (T, nu), qpos (nq,), qvel (nv,)."""
        ends = np.cumsum([KNOTS * self.nu, 1, self.nu, 1])
        knots, gentle, shares, pace, start = np.split(design, ends)
        passed, part = np.divmod(np.linspace(0, KNOTS - 1, self.samples), 1.0)
        place = passed + np.clip((part - 0.5) / gentle[0] + 0.5, 0, 1)
        ctrl = [np.interp(place, np.arange(KNOTS), column) for column in knots.reshape(KNOTS, self.nu).T]
        low, high = (bound[: self.nu] for bound in (self.low, self.high))
        cycles = max(self.samples / QUICKEST, 1.0) ** pace[0]
        wave = np.where(np.arange(self.samples) * cycles / self.samples % 1.0 < 0.5, 0.5, -0.5)
        waved = np.array(ctrl).reshape(self.nu, self.samples).T + wave[:, None] * shares * (high - low)
        qpos, qvel = start[: self.model.nq].copy(), start[self.model.nq :]
        mujoco.mj_normalizeQuat(self.model, qpos)  # between two orientations lies none
        return np.clip(waved, low, high), qpos, qvel

    def draw(self, rng: np.random.Generator, count: int, waves: bool = False) -> np.ndarray:
        """Random designs, (count, d), without square waves or with them."""
        out = rng.uniform(self.low, np.maximum(self.high, self.low + 1e-9), (count, len(self.low)))
        out[:, KNOTS * self.nu + 1 : (KNOTS + 1) * self.nu + 1] *= waves
        return out

    def calmer(self, rng: np.random.Generator, designs: np.ndarray) -> np.ndarray:
        """`designs` with smaller commands, each by a factor of its own."""
        out, commands = designs.copy(), slice(KNOTS * self.nu)
        out[:, commands] *= rng.uniform(0, 1, (len(designs), 1))
        return np.clip(out, self.low, self.high)


def limits(bench: Bench, recording: Recording) -> Limits:
    """Smallest and largest command of each actuator and state at a run's start, over the training runs."""
    problem = bench.training
    ctrl = np.concatenate([run.ctrl for run in recording.training])
    begins = problem.windows.first == problem.windows.first.min()  # 0, where something is measured from the start on
    start = np.concatenate([part[begins] for part in problem.starts], 1)
    none, all_ = np.zeros(ctrl.shape[1] + 1), np.ones(ctrl.shape[1] + 1)
    low = np.concatenate([np.tile(ctrl.min(0), KNOTS), [ABRUPT], none, start.min(0)])
    high = np.concatenate([np.tile(ctrl.max(0), KNOTS), [1.0], all_, start.max(0)])
    samples = max(len(run.measured) for run in recording.training)
    return Limits(low, high, samples, problem.simulator.base)


def discriminate(bench: Bench, recording: Recording, members: list[Explanation], seed: int = 0) -> Experiment:
    """The experiment that separates `members` best."""
    allowed, rng, told = limits(bench, recording), np.random.default_rng(seed), known(bench, members)

    def value(designs: np.ndarray) -> np.ndarray:
        return separations(bench, told, *map(np.array, zip(*map(allowed.unpack, designs), strict=True)))

    third = POOL // 3
    drawn = allowed.draw(rng, 2 * third)
    pool = np.concatenate([drawn[:third], allowed.calmer(rng, drawn[third:]), allowed.draw(rng, third, waves=True)])
    found = value(pool)
    random, at = float(np.median(found[:third].min(1))), np.argmax(worth(found))
    best, pairs = _search(value, allowed, pool[at], found[at], seed)
    return Experiment(*allowed.unpack(best), recording.period, pairs, random)


def worth(pairs: np.ndarray) -> np.ndarray:
    """What separations (n, pairs) are worth, (n,): a pair that nothing separates must not decide for all others, nor
    one that anything does."""
    return (pairs / (pairs + NEEDED)).mean(1)


def _search(value, allowed: Limits, best: np.ndarray, pairs: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """The design that is worth most and its separations, from `best` on, whose own are `pairs`."""
    span, most = np.maximum(allowed.high - allowed.low, 1e-9), worth(pairs[None])[0]
    box = np.tile([0.0, 1.0], (len(span), 1))
    cma = CMA((best - allowed.low) / span, SPREAD, box, seed=seed, population_size=POPULATION)
    last = 0
    for generation in range(GENERATIONS):
        vain = generation >= TRIED and most < VAIN
        if vain or pairs.min() > ENOUGH or generation - last > PATIENCE:
            break
        asked = np.array([cma.ask() for _ in range(POPULATION)])
        found = value(allowed.low + asked * span)
        gains = worth(found)
        cma.tell([(point, -gain) for point, gain in zip(asked, gains, strict=True)])
        last = generation if gains.max() > BETTER * most else last
        if gains.max() > most:
            at = np.argmax(gains)
            best, pairs, most = allowed.low + asked[at] * span, found[at], gains[at]
    return best, pairs
