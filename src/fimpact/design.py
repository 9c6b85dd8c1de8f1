"""Five ways to choose the next experiment, under the same bounds and horizon.

`fisher` is contact-implicit: no contact schedule is given. It starts from spread draws and searches around the
best with a covariance-adapting strategy (CMA-ES), then refines with exact forward-mode gradients. If none of the
draws touches, the contact first acts at a distance and is tightened to the exact one while the search follows.

What optimises does so for what is believed, not for one guess: the criterion is its mean over a few draws of the
posterior. A design that only works if the estimate is right teaches nothing when it is wrong.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import numpy as np
from cmaes import CMA

from fimpact.engine import mjx
from fimpact.information import CRITERIA
from fimpact.programs import programs
from fimpact.rollout import relax_contact, remove_contact
from fimpact.systems.base import System

POPULATION = 16
TOLD = 1e-3  # gain in a (logarithmic) criterion above which a candidate is taken to have touched
STEPS = 0.5 ** np.arange(4, 12)  # of a search along a gradient, in shares of the inputs' range; one batch


@dataclass(frozen=True)
class Task:
    """What a designer is given: the system, what is believed of its parameters (draws of the posterior in relative
    units, (k, p)), what is `known` already (prior precision plus information of past experiments, (p, p)), the
    round, its budget and its random numbers."""

    system: System
    model: mjx.Model
    beliefs: np.ndarray
    known: np.ndarray
    round: int
    rounds: int
    budget: dict
    rng: np.random.Generator


@dataclass(frozen=True)
class Design:
    """The chosen inputs (d,), the criterion's value there, and how many candidates were simulated for it."""

    design: np.ndarray
    value: float
    candidates: int


def fisher(task: Task, blind: bool = False, start: np.ndarray | None = None) -> Design:
    """Maximise the criterion of the accumulated information through contact.

    Args:
        blind: believe that contact does not exist and look at the motion instead.
        start: initial candidates (n, d); uniform draws if not given.
    """
    candidates = start if start is not None else _draws(task, task.budget["spread"])
    values, reaches, count = evaluate(task, candidates, 0.0, blind), np.zeros(1), len(candidates)
    if not blind and values.max() < _nothing(task) + TOLD:
        reaches, count = np.array(task.budget["relaxation"]) * _gap(task), 2 * count
        values = evaluate(task, candidates, reaches[0])
    found, value = _search(task, candidates[np.argmax(values)], values.max(), reaches, blind)
    design, value, climbed = _refine(task, found, value, blind)
    return Design(design, value, count + POPULATION * task.budget["generations"] + climbed)


def _search(task: Task, start: np.ndarray, value: float, reaches: np.ndarray, blind: bool) -> tuple[np.ndarray, float]:
    low, high = task.system.inputs.bounds
    unit = np.tile([0.0, 1.0], (len(low), 1))
    seed = int(task.rng.integers(2**31))
    cma = CMA((start - low) / (high - low), task.budget["sigma"], bounds=unit, seed=seed, population_size=POPULATION)
    best, best_value = start, value if reaches[0] == 0.0 else -np.inf
    for generation in range(task.budget["generations"]):
        reach = reaches[min(generation, len(reaches) - 1)]
        points = np.array([cma.ask() for _ in range(POPULATION)])
        values = evaluate(task, low + points * (high - low), reach, blind)
        cma.tell([(point, -value) for point, value in zip(points, values, strict=True)])
        if reach == 0.0 and values.max() > best_value:
            best, best_value = low + points[np.argmax(values)] * (high - low), values.max()
    return best, float(best_value)


def _refine(task: Task, best: np.ndarray, value: float, blind: bool) -> tuple[np.ndarray, float, int]:
    # Contact bends the criterion within a hundredth of the range, so every gradient is followed in a batch of
    # steps of all sizes; a quasi-Newton method would spend its gradients on backtracking.
    low, high = task.system.inputs.bounds
    spent = 0
    for _ in range(task.budget["gradients"]):
        slope = _gradient(task, best, blind) * (high - low)
        spent += _gradient_cost(task)
        if not (np.isfinite(slope).all() and slope.any()):
            break
        line = best + STEPS[:, None] * slope / np.linalg.norm(slope) * (high - low)
        values = evaluate(task, line.clip(low, high), 0.0, blind)
        if values.max() <= value:
            break
        best, value = line.clip(low, high)[np.argmax(values)], float(values.max())
    return best, value, spent


def _gradient(task: Task, design: np.ndarray, blind: bool) -> np.ndarray:
    model = remove_contact(task.model) if blind else task.model
    climb, name = programs(task.system).climb, task.budget["criterion"]
    return np.mean([climb(name, model, rho, design, task.known, blind)[1] for rho in task.beliefs], 0)


def _gradient_cost(task: Task) -> int:
    # A forward-mode gradient carries every sensitivity once more per design variable: so many candidates.
    return 1 + len(task.system.inputs.bounds[0]) + len(STEPS)


def _draws(task: Task, count: int) -> np.ndarray:
    low, high = task.system.inputs.bounds
    return task.rng.uniform(low, high, (count, len(low)))


def evaluate(task: Task, candidates: np.ndarray, reach: float = 0.0, blind: bool = False) -> np.ndarray:
    """Criterion of the accumulated information for `candidates` (n, d), its mean over the beliefs: shape (n,).

    Where a belief cannot be simulated, the candidate is worth less than nothing learnt.
    """
    model = remove_contact(task.model) if blind else relax_contact(task.model, float(reach))
    rows = np.tile(task.beliefs, (len(candidates), 1))
    point = programs(task.system).linearise(model, rows, np.repeat(candidates, len(task.beliefs), 0))
    slopes = point.motion if blind else point.sensitivity
    with np.errstate(over="ignore", invalid="ignore"):
        information = task.known + slopes.transpose(0, 2, 1) @ slopes
    values = np.asarray(_criterion(task)(information))
    values = np.where(np.isfinite(values), values, _nothing(task) - 1)
    return values.reshape(len(candidates), -1).mean(1)


def _criterion(task: Task) -> Callable:
    return jax.vmap(CRITERIA[task.budget["criterion"]])


def _nothing(task: Task) -> float:
    """Value of an experiment that tells nothing."""
    return float(_criterion(task)(task.known[None])[0])


def _gap(task: Task) -> float:
    # With relaxation 1 the contact acts from the first instant on, wherever the surface is.
    low, high = task.system.inputs.bounds
    return float(programs(task.system).predict(task.model, task.beliefs, (low + high)[None] / 2).first.max())


def contact_blind(task: Task) -> Design:
    """The same optimiser with contact removed from its model."""
    return fisher(task, blind=True)


def uniform(task: Task) -> Design:
    """Every knot of every input drawn uniformly within its bounds: the paper's baseline."""
    return Design(task.rng.uniform(*task.system.inputs.bounds), np.nan, 0)


def best_of_n(task: Task) -> Design:
    """The best, by the same criterion and beliefs, of at least as many uniform draws as `fisher` may simulate."""
    budget = task.budget
    count = 2 * budget["spread"] + POPULATION * budget["generations"] + budget["gradients"] * _gradient_cost(task)
    draws = _draws(task, count)
    values = evaluate(task, draws)
    return Design(draws[np.argmax(values)], float(values.max()), count)


def multisine(task: Task) -> Design:
    """Sum of three harmonics with random phases per input; a throw, having no time, follows it over rounds."""
    inputs = task.system.inputs
    count = inputs.knots if inputs.knots > 1 else task.rounds
    phases = task.rng.uniform(0, 2 * np.pi, (3, len(inputs.names)))
    time = np.arange(count)[:, None, None] / count
    waves = np.sin(2 * np.pi * np.arange(1, 4)[None, :, None] * time + phases).sum(1)
    waves /= np.abs(waves).max(0)
    rows = waves if inputs.knots > 1 else waves[task.round][None]
    return Design(((inputs.low + inputs.high) / 2 + rows * (inputs.high - inputs.low) / 2).ravel(), np.nan, 0)


METHODS: dict[str, Callable[[Task], Design]] = {
    "fisher": fisher,
    "uniform": uniform,
    "contact_blind": contact_blind,
    "best_of_n": best_of_n,
    "multisine": multisine,
}
