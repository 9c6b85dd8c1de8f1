"""Synthetic tables in the layout of trials.csv, diagnostics.csv, sweep.csv and reach.csv."""

import numpy as np
import pandas as pd

PARAMETERS = {"arm": ("inertia_1", "length_1"), "block": ("mass", "width")}
FINAL = {
    "fisher": 0.02,
    "contact_implicit": 0.03,
    "uniform": 0.25,
    "contact_blind": 0.12,
    "best_of_n": 0.05,
    "multisine": 0.2,
}
TOUCH = {
    "fisher": 1.0,
    "contact_implicit": 1.0,
    "uniform": 0.3,
    "contact_blind": 0.2,
    "best_of_n": 0.9,
    "multisine": 0.1,
}


def trials(final: dict, rounds: int = 1, contact: dict | None = None) -> pd.DataFrame:
    """Trials of the arm whose errors fall geometrically from 0.3 to `final[method][seed]` in every parameter."""
    rows = []
    for method, errors in final.items():
        for seed, error in enumerate(errors):
            for number in range(rounds + 1):
                size = 0.3 * (error / 0.3) ** (number / rounds)
                touch = number > 0 and (contact or {}).get(method, True)
                rows += experiment("arm", method, seed, number, size, 100.0 * number, 10 * touch)
    return pd.DataFrame(rows)


def experiment(system, method, seed, number, size, trace, contact_steps) -> list[dict]:
    """The rows of one experiment: the parameters err by `size` with alternating sign."""
    shared = {"system": system, "method": method, "seed": seed, "round": number}
    known = {"information_trace": trace, "information_logdet": np.log(11.1 + trace), "contact_steps": contact_steps}
    known |= {"status": "converged" if number else "prior", "seconds": 2.0 if number else 0.0}
    signs = (size * (-1) ** i for i in range(len(PARAMETERS[system])))
    return [
        shared | {"parameter": name, "truth": 2.0, "estimate": 2 + 2 * error, "relative_error": error} | known
        for name, error in zip(PARAMETERS[system], signs, strict=True)
    ]


def campaign(seeds: int = 8, rounds: int = 5, seed: int = 0, touch: dict | None = None) -> pd.DataFrame:
    """Both systems and all six methods with scatter as in a real campaign; some experiments never touch."""
    rng, rows, chance = np.random.default_rng(seed), [], TOUCH | (touch or {})
    for system in PARAMETERS:
        for method, error in FINAL.items():
            for number in range(seeds):
                rows += _random_campaign(rng, system, method, number, rounds, error, chance[method])
    return pd.DataFrame(rows)


def _random_campaign(rng, system, method, seed, rounds, error, chance) -> list[dict]:
    size, trace, rows = 0.25 * np.exp(0.2 * rng.standard_normal()), 0.0, []
    for number in range(rounds + 1):
        steps = int(rng.integers(2, 40)) if number and rng.random() < chance else 0
        trace += 50 * steps / error * np.exp(rng.standard_normal())
        size = max(size * (0.6 if steps else 0.99), error * np.exp(0.4 * rng.standard_normal())) if number else size
        rows += experiment(system, method, seed, number, size, trace, steps)
    return rows


def diagnose(table: pd.DataFrame) -> pd.DataFrame:
    """Diagnostics to `table`: seed 0 is never covered, every other seed always."""
    keys = ["system", "method", "seed", "round", "parameter"]
    rows = table.loc[table["round"] > 0, keys].assign(standard_error=0.02, agreement=1.0, candidates=640)
    return rows.assign(covered=(rows.seed > 0).astype(int)).reset_index(drop=True)


def sweep(surfaces=(0.6, 0.65, 0.7, 0.75, 0.8), seeds: int = 8) -> pd.DataFrame:
    """A campaign per surface position; the farther the surface, the rarer a random touch."""
    parts = []
    for place, surface in enumerate(surfaces):
        part = campaign(seeds, 3, place, {"uniform": 0.9 - 0.2 * place})
        parts.append(part[part.method.isin(["fisher", "uniform"])].assign(surface=surface))
    return pd.concat(parts, ignore_index=True)


def reach(seeds: int = 4) -> pd.DataFrame:
    """Both systems: every start without contact ends in contact, but for the arm's seed 0."""
    rows = [
        {"system": system, "seed": seed, "start_contact_steps": 0, "designed_contact_steps": 9 * hit, "reached": hit}
        | {"contact_steps_at_guess": 9 * (seed > 1), "reached_at_guess": int(seed > 1)}
        for system in PARAMETERS
        for seed in range(seeds)
        for hit in [int(system == "block" or seed > 0)]
    ]
    return pd.DataFrame(rows)


def plans() -> tuple[pd.DataFrame, pd.DataFrame]:
    """Plans of both systems and their forces: seed 0 finds no contact, seed 1 does, and MuJoCo's lasts longer."""
    time = (np.arange(50) + 0.5) * 0.01
    rows = [
        {"system": system, "seed": seed, "correlation": [np.nan, 0.7][seed], "impulse_ratio": [np.nan, 1.1][seed]}
        for system in PARAMETERS
        for seed in range(2)
    ]
    forces = [
        pd.DataFrame({"system": system, "seed": seed, "time": time, "axis": axis}).assign(
            planned=seed * size * 50 * (np.arange(50) == 30), simulated=seed * size * 11 * (abs(np.arange(50) - 32) < 3)
        )
        for system in PARAMETERS
        for seed in range(2)
        for axis, size in (("normal", 1.0), ("tangential", -0.3))
    ]
    return pd.DataFrame(rows), pd.concat(forces)
