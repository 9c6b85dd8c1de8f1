"""The picture of an experiment: its commands over time."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from fimpact.diagnosis.experiments.separating import Experiment
from fimpact.diagnosis.pipeline import Diagnosis
from fimpact.report.look import IMPROVED, WIDTH


def commands(diagnosis: Diagnosis, experiment: Experiment) -> Figure:
    """Draw the commands over time, a panel for each actuator."""
    model, time = diagnosis.simulator.base, np.arange(len(experiment.ctrl)) * experiment.period
    count = experiment.ctrl.shape[1]
    figure, axes = plt.subplots(count, 1, figsize=(WIDTH, 0.45 + 0.75 * count), sharex=True, squeeze=False)
    for i, ax in enumerate(axes[:, 0]):
        ax.step(time, experiment.ctrl[:, i], where="post", color=IMPROVED)
        ax.set_title(f"command of {model.actuator(i).name}")
    axes[-1, 0].set_xlabel("time (s)")
    return figure
