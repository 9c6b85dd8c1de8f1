"""Five ways to choose the next experiment, under the same bounds and horizon.

`fisher` is contact-implicit: no contact schedule is given. It starts from spread draws in a model whose contact
already acts at a distance, tightens the contact to the exact one while a covariance-adapting search (CMA-ES)
follows it, and refines the best with exact forward-mode gradients (L-BFGS-B).
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from cmaes import CMA
from scipy.optimize import minimize

from fimpact.engine import mjx
from fimpact.information import CRITERIA
from fimpact.information import fisher as fisher_information
from fimpact.programs import programs
from fimpact.rollout import relax_contact, remove_contact
from fimpact.systems.base import System

POPULATION = 32


@dataclass(frozen=True)
class Task:
    """What a designer is given: the system, the current estimate rho (p,), what is `known` already (prior
    precision plus information of past experiments, (p, p)), the round, its budget and its random numbers."""

    system: System
    model: mjx.Model
    rho: np.ndarray
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
    low, high = task.system.inputs.bounds
    budget = task.budget
    reaches = np.array(budget["relaxation"]) * _gap(task)
    candidates = start if start is not None else task.rng.uniform(low, high, (budget["spread"], len(low)))
    values = evaluate(task, candidates, reaches[0], blind)
    best = candidates[np.argmax(values)]
    found, searched = _search(task, best, reaches, blind)
    refined, climbed = _refine(task, found, blind)
    value = float(evaluate(task, refined[None], 0.0, blind)[0])
    return Design(refined, value, len(candidates) + searched + climbed)


def _search(task: Task, start: np.ndarray, reaches: np.ndarray, blind: bool) -> tuple[np.ndarray, int]:
    low, high = task.system.inputs.bounds
    unit = np.tile([0.0, 1.0], (len(low), 1))
    seed = int(task.rng.integers(2**31))
    cma = CMA((start - low) / (high - low), task.budget["sigma"], bounds=unit, seed=seed, population_size=POPULATION)
    best, best_value = start, -np.inf
    for generation in range(task.budget["generations"]):
        reach = reaches[min(generation, len(reaches) - 1)]
        points = np.array([cma.ask() for _ in range(POPULATION)])
        values = evaluate(task, low + points * (high - low), reach, blind)
        cma.tell([(point, -value) for point, value in zip(points, values, strict=True)])
        if reach == 0.0 and values.max() > best_value:
            best, best_value = low + points[np.argmax(values)] * (high - low), values.max()
    return best, POPULATION * task.budget["generations"]


def _refine(task: Task, start: np.ndarray, blind: bool) -> tuple[np.ndarray, int]:
    low, high = task.system.inputs.bounds
    model = remove_contact(task.model) if blind else task.model
    climb, seen = programs(task.system).climb, [(-np.inf, start)]

    def descend(unit: np.ndarray) -> tuple[float, np.ndarray]:
        if len(seen) > task.budget["gradients"]:
            raise _BudgetSpent
        design = low + unit * (high - low)
        value, gradient = climb(task.budget["criterion"], model, task.rho, design, task.known, blind)
        finite = np.isfinite(value) and np.isfinite(gradient).all()
        seen.append((float(value) if finite else -np.inf, design))
        return (-float(value), -np.asarray(gradient) * (high - low)) if finite else (1e6, np.zeros_like(unit))

    with suppress(_BudgetSpent):  # scipy's own limit is only looked at between line searches
        minimize(descend, (start - low) / (high - low), jac=True, bounds=[(0.0, 1.0)] * len(low), method="L-BFGS-B")
    # A forward-mode gradient carries every sensitivity once more per design variable: so many candidates.
    return max(seen, key=lambda point: point[0])[1], (len(seen) - 1) * (1 + len(low))


class _BudgetSpent(Exception):
    """All gradients that the budget allows have been taken."""


def evaluate(task: Task, candidates: np.ndarray, reach: float = 0.0, blind: bool = False) -> np.ndarray:
    """Criterion of the accumulated information for `candidates` (n, d), shape (n,); -inf where not finite."""
    model = remove_contact(task.model) if blind else relax_contact(task.model, float(reach))
    _, measured, moved = programs(task.system).linearise(model, task.rho, candidates)
    criterion = CRITERIA[task.budget["criterion"]]
    values = [float(criterion(task.known + fisher_information(s))) for s in (moved if blind else measured)]
    return np.where(np.isfinite(values), values, -np.inf)


def _gap(task: Task) -> float:
    # With relaxation 1 the contact acts from the first instant on, wherever the surface is.
    low, high = task.system.inputs.bounds
    return float(programs(task.system).predict(task.model, task.rho, (low + high)[None] / 2).first[0])


def contact_blind(task: Task) -> Design:
    """The same optimiser with contact removed from its model."""
    return fisher(task, blind=True)


def uniform(task: Task) -> Design:
    """Every knot of every input drawn uniformly within its bounds: the paper's baseline."""
    return Design(task.rng.uniform(*task.system.inputs.bounds), np.nan, 0)


def best_of_n(task: Task) -> Design:
    """The best, by the same criterion, of as many uniform draws as `fisher` may simulate."""
    low, high = task.system.inputs.bounds
    budget = task.budget
    count = budget["spread"] + POPULATION * budget["generations"] + budget["gradients"] * (1 + len(low))
    draws = task.rng.uniform(low, high, (count, len(low)))
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
