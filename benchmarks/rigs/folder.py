"""What a generated case consists of, and its folder: a naive model, logs, a case file, and the truth."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import yaml


@dataclass(frozen=True)
class Made:
    """A case to write.

    model: the naive MJCF. case: tables of the case file but model, time and runs. logs: name -> columns of one run;
    the last is held out. effects: effect@site -> values, what the naive model lacks. parameters: unknown -> true value.
    notes: anything else that is known of the truth.
    """

    model: str
    case: dict
    logs: dict[str, dict[str, np.ndarray]]
    effects: dict[str, dict[str, float]]
    parameters: dict[str, float]
    notes: dict = field(default_factory=dict)


def write(made: Made, folder: Path) -> Path:
    """Write a case to a new folder; returns the path of its case file. `truth.json` is for whoever marks answers."""
    folder.mkdir(parents=True)
    (folder / "model.xml").write_text(made.model)
    runs = [{"file": f"{name}.csv"} for name in made.logs]
    runs[-1]["held_out"] = True
    for name, columns in made.logs.items():
        pd.DataFrame(columns).to_csv(folder / f"{name}.csv", index=False, float_format="%.9g")
    table = {"model": "model.xml", "time": {"column": "time_s", "unit": "s"}, "runs": runs} | made.case
    (folder / "case.yaml").write_text(yaml.safe_dump(table, sort_keys=False))
    truth = {"effects": made.effects, "parameters": made.parameters, "notes": made.notes}
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")
    return folder / "case.yaml"


def round_to(values: np.ndarray, noise: float, quantum: float, rng: np.random.Generator) -> np.ndarray:
    """Values as an instrument reports them: with noise (sd), in steps of `quantum`."""
    return np.round((values + noise * rng.standard_normal(values.shape)) / quantum) * quantum


def multisine(time: np.ndarray, rates: np.ndarray, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Sum of sines of `rates` (Hz) and `sizes` at random phases, (T,)."""
    phases = rng.uniform(0, 2 * np.pi, len(rates))
    return (sizes * np.sin(2 * np.pi * rates * time[:, None] + phases)).sum(1)
