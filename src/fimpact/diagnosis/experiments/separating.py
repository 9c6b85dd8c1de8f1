"""The experiment that separates all pairs of explanations best, found by a search with random starts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from cmaes import CMA

from fimpact.diagnosis.experiments.design_space import DesignSpace, limits
from fimpact.diagnosis.experiments.predicted_separation import PriorKnowledge, separations, unknown_information
from fimpact.recordings import Recording
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import Simulator

POOL = 24  # random experiments to start from, a third of them smaller than the limits allow, a third with square waves
POPULATION, GENERATIONS = 8, 24  # of the search that follows
SPREAD = 0.1  # its first steps, of the limits
NEEDED = 11.0  # non-centrality for 80 % power at 1 %
ENOUGH_SEPARATION, PATIENCE = (
    2.5 * NEEDED,
    6,
)  # separation of all pairs, and generations in a row no better, that end the search
MIN_IMPROVEMENT = 1.02  # times the utility, of an experiment that keeps it going
MIN_GENERATIONS, MIN_UTILITY = 8, 0.02  # generations after which a search ends whose best has a lower utility


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
    """Count the experiments needed for 80 % power at 1 %."""
    return int(np.ceil(NEEDED / max(separation, 1e-9)))


def discriminate(
    recording: Recording,
    simulator: Simulator,
    members: Sequence[Hypothesis],
    noise: np.ndarray,
    force: np.ndarray | None = None,
    information: np.ndarray | None = None,
    seed: int = 0,
) -> Experiment:
    """Design the experiment that separates `members` best.

    Args:
        noise: sd of the readings, (ny,). force: sd of the missing force in a sample, (nv,); None: nothing is missing.
        information: of the unknowns, (p, p), as `PriorKnowledge` has it; None: their priors'.
    """
    told = unknown_information(simulator, members[0].theta) if information is None else information
    force = np.zeros(simulator.base.nv) if force is None else force
    known = PriorKnowledge(simulator, tuple(members), noise, force, told)
    allowed = limits(recording, simulator.base, noise)
    rng = np.random.default_rng(seed)

    def value(designs: np.ndarray) -> np.ndarray:
        return separations(known, *map(np.array, zip(*map(allowed.unpack, designs), strict=True)))

    third = POOL // 3
    drawn = allowed.draw(rng, 2 * third)
    pool = np.concatenate([drawn[:third], allowed.shrink(rng, drawn[third:]), allowed.draw(rng, third, waves=True)])
    found = np.concatenate([value(part) for part in np.array_split(pool, 3)])
    random, at = float(np.median(found[:third].min(1))), np.argmax(utility(found))
    best, pairs = best_design(value, allowed, pool[at], found[at], seed)
    return Experiment(*allowed.unpack(best), recording.period, pairs, random)


def utility(pairs: np.ndarray) -> np.ndarray:
    """What separations (n, pairs) are worth, (n,): a pair that nothing separates must not decide for all others, nor
    one that anything does."""
    return (pairs / (pairs + NEEDED)).mean(1)


def best_design(
    value, allowed: DesignSpace, best: np.ndarray, pairs: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Search the design of most utility, and its separations, from `best` on, whose own are `pairs`."""
    span, most = np.maximum(allowed.high - allowed.low, 1e-9), utility(pairs[None])[0]
    box = np.tile([0.0, 1.0], (len(span), 1))
    cma = CMA((best - allowed.low) / span, SPREAD, box, seed=seed, population_size=POPULATION)
    last = 0
    for generation in range(GENERATIONS):
        vain = generation >= MIN_GENERATIONS and most < MIN_UTILITY
        if vain or pairs.min() > ENOUGH_SEPARATION or generation - last > PATIENCE:
            break
        asked = np.array([cma.ask() for _ in range(POPULATION)])
        found = value(allowed.low + asked * span)
        gains = utility(found)
        cma.tell([(point, -gain) for point, gain in zip(asked, gains, strict=True)])
        last = generation if gains.max() > MIN_IMPROVEMENT * most else last
        if gains.max() > most:
            at = np.argmax(gains)
            best, pairs, most = allowed.low + asked[at] * span, found[at], gains[at]
    return best, pairs
