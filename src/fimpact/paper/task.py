"""What a designer is asked, and what it answers."""

from dataclasses import dataclass

import numpy as np

from fimpact.paper.systems.base import System


@dataclass(frozen=True)
class Task:
    """What a designer is given: the system, what is believed of its parameters (draws of the posterior in relative
    units, (k, p)), what is `known` already (prior precision plus information of past experiments, (p, p)), the
    round, its budget and its random numbers."""

    system: System
    beliefs: np.ndarray
    known: np.ndarray
    round: int
    rounds: int
    budget: dict
    rng: np.random.Generator
    estimate: np.ndarray | None = None  # (p,), where contact_implicit plans; the mean of the beliefs if not given


@dataclass(frozen=True)
class Design:
    """The chosen inputs (d,), the criterion's value there, and how many candidates were simulated for it."""

    design: np.ndarray
    value: float
    candidates: int
