"""The contact force that contact_implicit plans, over time, beside MuJoCo's own: one design of each system."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from fimpact.report.plotting.style import METHODS, STYLE, WIDTH, write

SHOWN = 0.02  # share of the largest force above which there is something to see
AROUND = 0.1  # share of that time that is shown before and after it
TEXT = "{name}, seed {seed}: {said}"


def draw(forces: pd.DataFrame, plans: pd.DataFrame, stem: Path | str) -> None:
    """Draw planned and simulated forces, normal and tangential, a row per system, to `stem`.svg and `stem`.png.

    Args:
        forces: a row per system, seed, time and axis, in N, as in `forces.csv`.
        plans: a row per system and seed, as in `plans.csv`; of each system the first with contact in both is drawn.
    """
    systems = list(plans.groupby("system", sort=False))
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(len(systems), 2, figsize=(WIDTH, 2.5 * len(systems)), squeeze=False)
        for row, (system, part) in zip(axes, systems, strict=True):
            _row(row, forces[forces.system == system], _shown(part))
        axes[0, 0].legend(frameon=False, fontsize=8)
        write(figure, stem)


def _shown(plans: pd.DataFrame) -> pd.Series:
    touching = plans[plans.correlation.notna()]
    return (touching if len(touching) else plans).iloc[0]


def _row(row: np.ndarray, forces: pd.DataFrame, plan: pd.Series) -> None:
    forces = forces[forces.seed == plan.seed]
    for ax, (axis, part) in zip(row, forces.groupby("axis", sort=False), strict=True):
        _panel(ax, part)
        ax.set_ylabel(f"{axis} force / N")
    row[0].set_xlim(*_span(forces))
    row[1].set_xlim(*_span(forces))
    alike = "no contact to compare" if np.isnan(plan.correlation) else f"correlation {plan.correlation:.2f}"
    row[0].set_title(TEXT.format(name=plan.system.capitalize(), seed=plan.seed, said=alike))
    if not np.isnan(plan.impulse_ratio):
        row[1].set_title(f"MuJoCo's impulse: {plan.impulse_ratio:.2f} of the plan's")


def _panel(ax: Axes, part: pd.DataFrame) -> None:
    _, colour, _, _ = METHODS["contact_implicit"]
    planned, played = "λ, planned: rigid", "MuJoCo, played: soft"
    ax.step(part.time, part.planned, where="mid", color=colour, linewidth=1.4, label=planned)
    ax.step(part.time, part.simulated, where="mid", color="black", linewidth=1.4, linestyle="--", label=played)
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.set_xlabel("time / s")


def _span(forces: pd.DataFrame) -> tuple[float, float]:
    """The part of the experiment in which either force is more than next to nothing."""
    size = forces[["planned", "simulated"]].abs().max(axis=1)
    seen = forces.time[size > SHOWN * size.max()]
    if seen.empty:
        return float(forces.time.min()), float(forces.time.max())
    step = forces.time.drop_duplicates().diff().min()
    room = AROUND * (seen.max() - seen.min()) + 2 * step
    return float(seen.min() - room), float(min(seen.max() + room, forces.time.max() + step / 2))
