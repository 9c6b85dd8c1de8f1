"""Can the designer find contact from a start that has none, and what can a system's best experiment show?"""

from collections.abc import Callable

import numpy as np
import pandas as pd

from fimpact.paper import reference_simulator
from fimpact.paper.design import fisher, uniform
from fimpact.paper.estimate import beliefs, untried
from fimpact.paper.forecast import forecaster
from fimpact.paper.information.fisher import identifiability
from fimpact.paper.search import Campaign
from fimpact.paper.systems import System, make_system
from fimpact.paper.task import Task
from fimpact.paper.trial import draw_truth, information, prior_precision, stream

CLEAR = 0.1  # share of the starting gap that a contact-free candidate keeps
LEAST = 1e-3  # share of the bounds from which on it is no use to try
SHRINK = 0.8  # of the draws' bounds, each time that too few of them stay clear
COLUMNS = (
    "system seed start_contact_steps designed_contact_steps reached contact_steps_at_guess reached_at_guess"
).split()


def run_reach(config: dict, system: str, progress: Callable[[str], None]) -> pd.DataFrame:
    """Designs for what is believed before the first experiment, from first candidates that all stay clear.

    Returns one row per seed. `start_contact_steps` counts, over all first candidates, steps in contact (0).
    `reached` says whether the design touches when it is run on the seed's truth, as an experiment would;
    `reached_at_guess` whether it touches on the designer's first guess, which may be too short to touch at all.
    """
    made, rows = make_system(system, config["systems"][system]), []
    for seed in config["reach"]["seeds"]:
        rows.append(_reach(config, made, seed))
        progress(f"{system} contact-free start: {len(rows)} of {len(config['reach']['seeds'])} seeds")
    return pd.DataFrame(rows, columns=COLUMNS)


def _reach(config: dict, system: System, seed: int) -> tuple:
    rho, guess = draw_truth(system, seed)
    task = first_task(config, system, guess, stream(system, seed, "reach"))
    start = contact_free(task, np.vstack([task.beliefs, guess, rho]), config["design"]["spread"])
    design = fisher(task, start=start).design

    def steps(relative, inputs) -> int:
        return reference_simulator.simulate(system, relative * system.nominal, inputs)[1]

    before = sum(steps(r, inputs) for r in (rho, guess) for inputs in start)
    on_truth, on_guess = steps(rho, design), steps(guess, design)
    return system.name, seed, before, on_truth, int(on_truth > 0), on_guess, int(on_guess > 0)


def contact_free(task: Task, rho: np.ndarray, count: int) -> np.ndarray:
    """The first `count` draws that for no row of `rho` (k, p) close more than 90 % of the gap, shape (count, d).

    They are uniform within bounds that shrink until enough of them stay clear: a long arm hardly misses the wall.
    A row of `rho` that starts in contact has no start without; it is left out.

    Raises:
        ValueError: there is none, not even close to the middle of the inputs.
    """
    middle = np.mean(task.system.inputs.bounds, 0)
    rho = rho[forecaster(task.system).forecast(rho, np.tile(middle, (len(rho), 1))).first > 0]
    kept: list[np.ndarray] = []
    share = 1.0
    while len(kept) < count:
        if share < LEAST or not len(rho):
            raise ValueError(
                f"{task.system.name} has no start that stays clear of its surface, which `reach` is about; "
                f"move systems.{task.system.name}.surface away, or shorten the experiment (steps, timestep)"
            )
        draws = middle + share * (np.array([uniform(task).design for _ in range(count)]) - middle)
        seen = forecaster(task.system).forecast(np.tile(rho, (count, 1)), np.repeat(draws, len(rho), 0))
        clear = (seen.closest > CLEAR * seen.first).reshape(count, -1).all(1)
        kept.extend(draws[clear])
        share *= SHRINK
    return np.array(kept[:count])


def run_identifiability(config: dict, system: str) -> str:
    """Markdown report: what one designed experiment shows, direction by direction, weakest first."""
    made = make_system(system, config["systems"][system])
    rho = np.ones(len(made.nominal))
    task = first_task(config, made, rho, stream(made, 0, "identifiability"), sure=True)
    chosen = fisher(task).design
    campaign = Campaign(
        made, made.template, (reference_simulator.run(made, made.nominal, chosen, 0.0),), rho, made.settings["prior"]
    )
    report = identifiability(information(campaign, rho), tuple(p.name for p in made.parameters), campaign.prior_sd)
    lines = [
        f"- eigenvalue {value:.3g}: {words}" for value, words in zip(report.eigenvalues, report.verdict, strict=True)
    ]
    errors = [
        f"- {p.name}: {100 * error:.2g} % of nominal"
        for p, error in zip(made.parameters, report.standard_errors, strict=True)
    ]
    head = f"# What one designed experiment shows of the {system}\n\nDirections of relative change, weakest first:\n\n"
    return (
        head + "\n".join(lines) + "\n\nStandard error of each parameter, prior included:\n\n" + "\n".join(errors) + "\n"
    )


def first_task(config: dict, system: System, rho: np.ndarray, rng: np.random.Generator, sure: bool = False) -> Task:
    """The designer's task before the first experiment, for the first guess `rho` (p,); `sure`: of which it is sure."""
    campaign = Campaign(system, system.template, (), rho, system.settings["prior"])
    draws = beliefs(campaign, untried(campaign), config["design"]["draws"], rng)
    believed = rho[None] if sure else draws
    return Task(system, believed, prior_precision(campaign), 0, 1, config["design"], rng, rho)
