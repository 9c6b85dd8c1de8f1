"""The pictures of a diagnosis: error against horizon, the missing force and its law, every joint before and after."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from fimpact.report.look import IMPROVED, INK, NAIVE, QUIET, RIVAL, WIDTH, draw
from fimpact.report.plotting.style import log_ticks, power

BARS = 12  # joints shown, those that lacked most
CURVES: dict[str, tuple[str, dict[str, Any]]] = {
    "naive": ("naive fit", {"color": NAIVE, "marker": "s", "linestyle": "--"}),
    "freed": ("everything freed", {"color": RIVAL, "linewidth": 3.5, "alpha": 0.6}),
    "improved": ("improved", {"color": IMPROVED, "marker": "o"}),
    "floor": ("noise floor", {"color": INK, "linestyle": ":", "linewidth": 1.3}),
}


def pictures(content: dict[str, Any]) -> dict[str, Figure]:
    """All figures by file name, from what `contents` holds."""
    drawn = {}
    if content["held_out"]["horizons"]:
        drawn["horizon"] = draw(horizon, content["held_out"])
    if content["picture"]["x"]:
        drawn["force"] = draw(force, content["picture"], bool(content["effects"]))
    return drawn | {"joints": draw(joints, content["missing_force"], bool(content["effects"]))}


def horizon(held_out: dict[str, Any]) -> Figure:
    """Held-out error of each model against the time that is predicted in one go."""
    figure, ax = plt.subplots(figsize=(WIDTH, 2.9))
    time, curves = np.array(held_out["horizons"]), held_out["curve"]
    for name, (label, look) in CURVES.items():
        if name in curves:  # where a simulation diverged there is no point
            ax.plot(time, np.array(curves[name], float), label=label, markersize=3.5, **look)
    ax.set(xscale="log", yscale="log", xlabel="time predicted in one go (s)")
    ax.set_ylabel(f"held-out error ({held_out['unit']})")
    log_ticks(ax.xaxis, *ax.get_xlim(), "{:g}".format)
    log_ticks(ax.yaxis, *ax.get_ylim(), _tick)
    figure.legend(*ax.get_legend_handles_labels(), ncol=2, loc="outside upper center")
    return figure


def _tick(value: float) -> str:
    return f"{value:g}" if 0.01 <= value < 1e4 else power(value)


def force(picture: dict[str, Any], found: bool) -> Figure:
    """The force that the naive fit lacks at the joint that lacks most, and the found law through it."""
    figure, ax = plt.subplots(figsize=(WIDTH, 2.6))
    ax.axhline(0, color=QUIET, linewidth=0.6)
    ax.plot(picture["x"], picture["missing"], "o", color=INK, markersize=2.8, label="missing in the naive fit")
    if found:
        ax.plot(picture["x"], picture["law"], color=IMPROVED, linewidth=1.8, label="what was found")
    ax.set(xlabel=picture["against"], ylabel=f"force ({picture['unit']})", title=picture["joint"])
    figure.legend(*ax.get_legend_handles_labels(), ncol=2, loc="outside upper center")
    return figure


def joints(rows: list[dict[str, Any]], found: bool) -> Figure:
    """Missing force of each joint, root mean square over the training runs, before and after; a panel for each unit."""
    rows = sorted(rows, key=lambda row: -row["naive"] / max(row["applied"], 1e-300))[:BARS]
    units = list(dict.fromkeys(row["unit"] for row in rows))
    groups = [[row for row in rows if row["unit"] == unit] for unit in units]
    heights = [max(len(group), 2) for group in groups]
    size = (WIDTH, 0.42 * sum(heights) + 0.65 * len(groups) + 0.3)
    figure, axes = plt.subplots(len(groups), 1, figsize=size, squeeze=False, height_ratios=heights)
    for ax, unit, group in zip(axes[:, 0], units, groups, strict=True):
        _bars(ax, group, found)
        ax.set_xlabel(f"root mean square missing force ({unit})")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), ncol=2, loc="outside upper center")
    return figure


def _bars(ax: Axes, rows: list[dict[str, Any]], found: bool) -> None:
    place, name = np.arange(len(rows)), "left" if found else "naive"
    ax.barh(place - 0.2 * found, [row["naive"] for row in rows], 0.38, color=NAIVE, label="naive fit")
    if found:
        ax.barh(place + 0.2, [row["left"] for row in rows], 0.38, color=IMPROVED, label="improved")
    for at, row in zip(place + 0.2 * found, rows, strict=True):
        share = 100 * row[name] / max(row["applied"], 1e-300)
        text = f"{share:.0f} %" if share >= 1 else "< 1 %"
        ax.annotate(text, (row[name], at), xytext=(3, 0), textcoords="offset points", va="center", color=QUIET)
    ax.set_yticks(place, [row["joint"] for row in rows])
    ax.invert_yaxis()
    ax.tick_params(axis="y", length=0)
    ax.xaxis.set_major_locator(MaxNLocator(4))
    ax.margins(x=0.12)
