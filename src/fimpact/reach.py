"""Can the designer find contact from a start that has none, and what can a system's best experiment show?"""

from collections.abc import Callable

import numpy as np
import pandas as pd

from fimpact import truth
from fimpact.design import Task, fisher, uniform
from fimpact.information import identifiability
from fimpact.programs import programs
from fimpact.search import Campaign
from fimpact.systems import System, make_system
from fimpact.trial import draw_truth, information, prior_precision, stream

CLEAR = 0.1  # share of the starting gap that a contact-free candidate keeps
COLUMNS = "system seed start_contact_steps designed_contact_steps reached".split()


def run_reach(config: dict, system: str, progress: Callable[[str], None]) -> pd.DataFrame:
    """Designs from first candidates that all stay clear of the surface, simulated at the designer's own estimate.

    Returns one row per seed; `start_contact_steps` counts, over all first candidates, steps in contact (0).
    """
    made, rows = make_system(system, config["systems"][system]), []
    for seed in config["reach"]["seeds"]:
        rows.append(_reach(config, made, seed))
        progress(f"{system} contact-free start: {len(rows)} of {len(config['reach']['seeds'])} seeds")
    return pd.DataFrame(rows, columns=COLUMNS)


def _reach(config: dict, system: System, seed: int) -> tuple:
    task = _task(config, system, draw_truth(system, seed)[1], stream(system, seed, "reach"))
    start = contact_free(task, config["design"]["spread"])
    theta = task.rho * system.nominal
    before = sum(truth.simulate(system, theta, design)[1] for design in start)
    after = truth.simulate(system, theta, fisher(task, start=start).design)[1]
    return system.name, seed, before, after, int(after > 0)


def contact_free(task: Task, count: int) -> np.ndarray:
    """The first `count` uniform draws that never close more than 90 % of the starting gap, shape (count, d)."""
    kept: list[np.ndarray] = []
    while len(kept) < count:
        draws = np.array([uniform(task).design for _ in range(4 * count)])
        seen = programs(task.system).predict(task.model, task.rho, draws)
        kept.extend(draws[seen.closest > CLEAR * seen.first])
    return np.array(kept[:count])


def run_identifiability(config: dict, system: str) -> str:
    """Markdown report: what one designed experiment shows, direction by direction, weakest first."""
    made = make_system(system, config["systems"][system])
    task = _task(config, made, np.ones(len(made.nominal)), stream(made, 0, "identifiability"))
    chosen = fisher(task).design
    campaign = Campaign(
        made, task.model, (truth.run(made, made.nominal, chosen, 0.0),), task.rho, made.settings["prior"]
    )
    report = identifiability(information(campaign, task.rho), [p.name for p in made.parameters], campaign.prior_sd)
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


def _task(config: dict, system: System, rho: np.ndarray, rng: np.random.Generator) -> Task:
    campaign = Campaign(system, system.template, (), rho, system.settings["prior"])
    return Task(system, campaign.model, rho, prior_precision(campaign), 0, 1, config["design"], rng)
