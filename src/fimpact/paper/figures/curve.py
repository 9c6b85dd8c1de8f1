"""When does it pay? Error reduction against how often random experiments touch."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from fimpact.paper.measures import BASELINE, DESIGNED, errors, final, reduction, touched
from fimpact.paper.summary import percent, reduction_curve
from fimpact.report.plotting.style import METHODS, STYLE, WIDTH, in_percent, log_ticks, set_ticks, write

INTERVAL = ["reduction", "reduction_low", "reduction_high"]


def curve(sweep: pd.DataFrame, trials: pd.DataFrame, stem: Path | str) -> None:
    """Draw error reduction against the share of random experiments that touched, to `stem`.svg and `stem`.png.

    Args:
        sweep: trials at several surface positions, as in `sweep.csv`.
        trials: the full campaign, which is marked on the curve as the headline.
    """
    systems: list[tuple[Any, pd.DataFrame]] = list(trials.groupby("system", sort=False))
    points = reduction_curve(sweep)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, len(systems), figsize=(WIDTH, 3.3), squeeze=False, sharey=True)
        for ax, (system, part) in zip(axes[0], systems, strict=True):
            _surfaces(ax, points[points.system == system].sort_values(["touched", "surface"]))
            _headline(ax, system, part)
            ax.set(xlabel="uniform random experiments that touched", xlim=(-0.1, 1.1))
            set_ticks(ax.xaxis, [0, 0.25, 0.5, 0.75, 1], in_percent)
        _reduction_axis(axes[0, 0])
        write(figure, stem)


def _surfaces(ax: Axes, points: pd.DataFrame) -> None:
    _, colour, line, marker = METHODS[DESIGNED]
    _whiskers(ax, points, color=colour, linestyle=line, marker=marker)
    point: Any
    for index, point in enumerate(points.itertuples()):
        # In two rows along the bottom, so that neighbours do not run into each other or into a whisker.
        name, row = f"{point.surface:g} m".replace("-", "−"), 0.015 + 0.065 * (index % 2)
        ax.text(point.touched, row, name, color=colour, fontsize=8, ha="center", transform=ax.get_xaxis_transform())


def _headline(ax: Axes, system: str, trials: pd.DataFrame) -> None:
    error, share = final(errors(trials)), touched(trials[trials.method == BASELINE])
    interval = reduction(error[DESIGNED], error[BASELINE])
    star = pd.DataFrame([(share, *interval)], columns=["touched", *INTERVAL])
    _whiskers(ax, star, color="black", linestyle="none", marker="*", markersize=11)
    _name(ax, share, 1 - np.nanmax(interval), f"headline, {len(error)} seeds")
    ax.set_title(f"{system.capitalize()}: {percent(interval[0])} error reduction where {percent(share, 0)} touch")


def _whiskers(ax: Axes, table: pd.DataFrame, **look) -> None:
    # Drawn as the error that remains, on a logarithmic axis: equal steps are then equal factors of error.
    middle, low, high = (1 - table[name].to_numpy() for name in INTERVAL)
    # A bootstrap interval of medians may leave its own estimate just outside.
    lengths = np.maximum([middle - high, low - middle], 0)
    ax.errorbar(table.touched, middle, lengths, capsize=2.5, elinewidth=1, **look)


def _name(ax: Axes, x: float, y: float, text: str) -> None:
    # Above the whisker's end, where no line runs; edges lean inwards.
    side = "left" if x < 0.15 else "right" if x > 0.85 else "center"
    halo = [withStroke(linewidth=2.5, foreground="white")]
    ax.annotate(text, (x, y), (0, 3), textcoords="offset points", fontsize=8, ha=side, va="bottom", path_effects=halo)


def _reduction_axis(ax: Axes) -> None:
    ax.set_yscale("log")
    low, high = ax.get_ylim()
    low, high = low / 1.15, high * 2.5  # room for the names of the surfaces
    ax.set_ylim(high, low)
    log_ticks(ax.yaxis, low, high, lambda remaining: in_percent(1 - remaining))
    ax.set_ylabel("error reduction (95 % interval)")
