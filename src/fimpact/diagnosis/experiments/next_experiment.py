"""The experiment that would tell apart what the recordings cannot: designed, told, and handed out as files."""

from itertools import combinations
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd

from fimpact.deciding import UNLIKELY
from fimpact.diagnosis.experiments.predicted_separation import fitted_information
from fimpact.diagnosis.experiments.separating import Experiment, discriminate, repeats
from fimpact.diagnosis.pipeline import Diagnosis, Member
from fimpact.simulation.simulator import Simulator
from fimpact.support import tables

COMMANDS, START = "experiment.csv", "experiment-start.csv"
MANY = 20  # repetitions beyond which nobody would play it
MOST = 4  # members that are told apart: of more, the likeliest


def next_experiment(diagnosis: Diagnosis) -> Experiment | None:
    """Design the experiment that separates the members of the answer; None where there is but one."""
    members = contenders(diagnosis)
    if len(members) < 2:
        return None
    fit = diagnosis.explanation.final
    information = fitted_information(fit.information, [number.place for number in fit.numbers])
    force = np.median(fit.levels.forces, axis=0)
    simulator, hypotheses = Simulator(diagnosis.recording), [member.hypothesis for member in members]
    return discriminate(diagnosis.recording, simulator, hypotheses, fit.levels.reading, force, information)


def contenders(diagnosis: Diagnosis) -> list[Member]:
    """The members that an experiment is to tell apart, the likeliest first."""
    return [member for member in diagnosis.members if member.weight > UNLIKELY][:MOST]


def described(diagnosis: Diagnosis, experiment: Experiment) -> dict[str, Any]:
    """What a reader needs, in plain types: the pairs of names with the predicted separation and the runs needed, and
    the state to start from. files: what `write_experiment` writes, nothing where no pair can be told apart."""
    names = [member.name for member in contenders(diagnosis)]
    pairs = [
        {"one": one, "other": other, "separation": float(size), "repeats": _few(size)}
        for (one, other), size in zip(combinations(names, 2), experiment.pairs, strict=True)
    ]
    worthwhile = any(pair["repeats"] for pair in pairs)
    own = {"seconds": len(experiment.ctrl) * experiment.period, "period": experiment.period}
    start = start_table(diagnosis.simulator.base, experiment).to_dict("records")
    files = [COMMANDS, START] if experiment.ctrl.shape[1] else [START]
    return {**own, "pairs": pairs, "random": experiment.random, "start": start, "files": files if worthwhile else []}


def _few(separation: float) -> int | None:
    """Runs needed for the power that is asked for; None: too many."""
    needed = repeats(separation)
    return needed if needed <= MANY else None


def start_table(model: mujoco.MjModel, experiment: Experiment) -> pd.DataFrame:
    """The state to start from, a row per coordinate: quantity ("qpos" or "qvel"), of, value in units of the MJCF."""
    places, rates = _coordinates(model, model.jnt_qposadr, model.nq), _coordinates(model, model.jnt_dofadr, model.nv)
    rows = [("qpos", name, value) for name, value in zip(places, experiment.qpos, strict=True)]
    rows += [("qvel", name, value) for name, value in zip(rates, experiment.qvel, strict=True)]
    return pd.DataFrame(rows, columns=["quantity", "of", "value"])


def _coordinates(model: mujoco.MjModel, first: np.ndarray, count: int) -> list[str]:
    """Name, or number, of the joint behind each coordinate; those of free and ball joints are numbered.

    Args:
        first: index of each joint's first coordinate, (njnt,), of positions or of speeds, of which there are `count`.
    """
    names: list[str] = []
    for joint, start, end in zip(map(model.joint, range(model.njnt)), first, np.append(first[1:], count), strict=True):
        name = joint.name or f"joint {joint.id}"
        names += [name] if end - start == 1 else [f"{name}[{i}]" for i in range(end - start)]
    return names


def write_experiment(diagnosis: Diagnosis, experiment: Experiment, folder: Path) -> None:
    """Write the commands, a row per sample with its time in s, and the start to `folder`."""
    model = diagnosis.simulator.base
    tables.write(start_table(model, experiment), folder / START)
    if experiment.ctrl.shape[1]:
        names = [model.actuator(i).name for i in range(model.nu)]
        table = pd.DataFrame(experiment.ctrl, columns=names)
        table.insert(0, "time", np.arange(len(table)) * experiment.period)
        tables.write(table, folder / COMMANDS)
