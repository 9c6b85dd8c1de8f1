"""The experiment that would tell apart what the recordings cannot: designed, told, and handed out as files."""

from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import mujoco
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from fimpact import tables
from fimpact.mismatch.diagnose import Diagnosis
from fimpact.mismatch.discriminate import Experiment, discriminate, repeats
from fimpact.mismatch.pulses import dof_names
from fimpact.report_look import IMPROVED, WIDTH

COMMANDS, START = "experiment.csv", "experiment-start.csv"
MANY = 20  # repetitions beyond which nobody would play it


def next_experiment(diagnosis: Diagnosis) -> Experiment | None:
    """The experiment that separates the members of the answer; None where there is but one, or none worth it."""
    members = diagnosis.naming.contenders
    return discriminate(diagnosis.bench, diagnosis.recording, members) if len(members) > 1 else None


def described(diagnosis: Diagnosis, experiment: Experiment) -> dict[str, Any]:
    """What a reader needs, in plain types: the pairs of names with the predicted separation and the runs needed, and
    the state to start from. files: what `write_experiment` writes, nothing where no pair can be told apart."""
    names = [member.name for member in diagnosis.naming.members]
    pairs = [
        {"one": one, "other": other, "separation": float(size), "repeats": _few(size)}
        for (one, other), size in zip(combinations(names, 2), experiment.pairs, strict=True)
    ]
    worthwhile = any(pair["repeats"] for pair in pairs)
    own = {"seconds": len(experiment.ctrl) * experiment.period, "period": experiment.period}
    start = start_table(diagnosis.bench.training.simulator.base, experiment).to_dict("records")
    files = [COMMANDS, START] if experiment.ctrl.shape[1] else [START]
    return {**own, "pairs": pairs, "random": experiment.random, "start": start, "files": files if worthwhile else []}


def _few(separation: float) -> int | None:
    """Runs needed for the power that is asked for; None: too many."""
    needed = repeats(separation)
    return needed if needed <= MANY else None


def start_table(model: mujoco.MjModel, experiment: Experiment) -> pd.DataFrame:
    """The state to start from, a row per coordinate: quantity ("qpos" or "qvel"), of, value in units of the MJCF."""
    rows = [("qpos", name, value) for name, value in zip(_places(model), experiment.qpos, strict=True)]
    rows += [("qvel", name, value) for name, value in zip(dof_names(model), experiment.qvel, strict=True)]
    return pd.DataFrame(rows, columns=["quantity", "of", "value"])


def _places(model: mujoco.MjModel) -> list[str]:
    """Name of the joint behind each element of qpos; those of free and ball joints are numbered."""
    ends, names = np.append(model.jnt_qposadr[1:], model.nq), []
    for joint, first, end in zip(map(model.joint, range(model.njnt)), model.jnt_qposadr, ends, strict=True):
        names += [joint.name] if end - first == 1 else [f"{joint.name}[{i}]" for i in range(end - first)]
    return names


def write_experiment(diagnosis: Diagnosis, experiment: Experiment, folder: Path) -> None:
    """Write the commands, a row per sample with its time in s, and the start to `folder`."""
    model = diagnosis.bench.training.simulator.base
    tables.write(start_table(model, experiment), folder / START)
    if experiment.ctrl.shape[1]:
        names = [model.actuator(i).name for i in range(model.nu)]
        table = pd.DataFrame(experiment.ctrl, columns=names)
        table.insert(0, "time", np.arange(len(table)) * experiment.period)
        tables.write(table, folder / COMMANDS)


def commands(diagnosis: Diagnosis, experiment: Experiment) -> Figure:
    """The commands over time, a panel for each actuator."""
    model, time = diagnosis.bench.training.simulator.base, np.arange(len(experiment.ctrl)) * experiment.period
    count = experiment.ctrl.shape[1]
    figure, axes = plt.subplots(count, 1, figsize=(WIDTH, 0.45 + 0.75 * count), sharex=True, squeeze=False)
    for i, ax in enumerate(axes[:, 0]):
        ax.step(time, experiment.ctrl[:, i], where="post", color=IMPROVED)
        ax.set_title(f"command of {model.actuator(i).name}")
    axes[-1, 0].set_xlabel("time (s)")
    return figure
