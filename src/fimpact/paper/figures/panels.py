"""The paper's four panels and the ablation; the curve, which has a room of its own, is reached from here too."""

from pathlib import Path
from typing import cast

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from fimpact.paper.figures.curve import curve
from fimpact.paper.measures import BASELINE, DESIGNED, errors, final, information, information_ratio, touched
from fimpact.paper.summary import percent, times
from fimpact.report.plotting.style import (
    METHODS,
    STYLE,
    WIDTH,
    in_percent,
    label_ends,
    log_places,
    log_ticks,
    power,
    set_ticks,
    write,
)

__all__ = ["ablation", "curve", "panels"]

LABELS = {DESIGNED: "designed", "contact_implicit": "IPOPT", BASELINE: "random"}  # of the panels' lines, if they ran


def panels(trials: pd.DataFrame, stem: Path | str) -> None:
    """Draw error and information over experiments, a row per system, to `stem`.svg and `stem`.png."""
    systems = list(trials.groupby("system", sort=False))
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(len(systems), 2, figsize=(WIDTH, 2.7 * len(systems)), squeeze=False)
        for row, (system, part) in zip(axes, systems, strict=True):
            _error_panel(row[0], str(system), part)
            _information_panel(row[1], str(system), part)
        write(figure, stem)


def ablation(trials: pd.DataFrame, stem: Path | str) -> None:
    """Draw the final error of every seed and method, a panel per system, to `stem`.svg and `stem`.png."""
    systems = list(trials.groupby("system", sort=False))
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(len(systems), 1, figsize=(WIDTH, 2.4 * len(systems)), squeeze=False)
        for ax, (system, part) in zip(axes[:, 0], systems, strict=True):
            _strips(ax, str(system), part)
        write(figure, stem)


def _error_panel(ax: Axes, system: str, trials: pd.DataFrame) -> None:
    table = errors(trials).loc[_shown(trials)]
    _bands(ax, table)
    _label(ax, table)
    log_ticks(ax.yaxis, *ax.get_ylim(), in_percent)
    ax.set_ylabel("parameter error (rms)")
    designed, random = (
        percent(value, 0 if value > 0.1 else 1) for value in final(table).median()[[DESIGNED, BASELINE]]
    )
    ax.set_title(f"{system.capitalize()} error: {designed} designed, {random} random")


def _information_panel(ax: Axes, system: str, trials: pd.DataFrame) -> None:
    table = information(trials).loc[_shown(trials), 1:]
    least = cast(float, table.where(table > 0).min(axis=None))
    # A logarithm has no zero: experiments that tell nothing lie on a line of their own below the least that does.
    floor = 10.0 ** np.floor(np.log10(least) - 0.5) if least > 0 else 1.0
    lifted = table.clip(lower=floor)
    _bands(ax, lifted)
    low, high = ax.get_ylim()
    places = log_places(low, high, most=4)
    if (table == 0).any(axis=None):
        ax.axhline(floor, color="0.6", linewidth=0.6, zorder=0)
        ax.set_ylim(floor / 1.5, high)
        places = [floor, *log_places(np.nanmax([low, least]), high, most=4)]
    set_ticks(ax.yaxis, places, lambda y: "none" if y == floor else power(y))
    _label(ax, lifted)
    ax.set_ylabel("accumulated information, tr I")
    ax.set_title(_compare(system, trials))


def _compare(system: str, trials: pd.DataFrame) -> str:
    ratio = information_ratio(trials)[DESIGNED]
    if np.isfinite(ratio.median()):
        return f"{system.capitalize()} information: {times(ratio.median())} by design"
    return f"{system.capitalize()}: none at random in {np.isinf(ratio).sum()} of {len(ratio)} seeds"


def _shown(trials: pd.DataFrame) -> list[str]:
    return [method for method in LABELS if method in set(trials.method)]


def _bands(ax: Axes, table: pd.DataFrame) -> None:
    # Median and interquartile band over seeds.
    ax.set_yscale("log")
    for method in table.index.unique("method"):
        _, colour, line, marker = METHODS[method]
        low, middle, high = (table.loc[method].quantile(q) for q in (0.25, 0.5, 0.75))
        ax.fill_between(table.columns, low, high, color=colour, alpha=0.2, linewidth=0)
        ax.plot(table.columns, middle, color=colour, linestyle=line, marker=marker)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set_xlabel("experiments")


def _label(ax: Axes, table: pd.DataFrame) -> None:
    middle = final(table).median()
    last = cast(float, table.columns[-1])
    label_ends(ax, [(last, middle[method], LABELS[method], METHODS[method][1]) for method in map(str, middle.index)])


def _strips(ax: Axes, system: str, trials: pd.DataFrame) -> None:
    error = final(errors(trials))
    methods = [method for method in METHODS if method in error]
    _notes(ax, 1.07, "axes fraction", "median", "touched")
    for place, method in enumerate(methods):
        _strip(ax, place, method, error[method])
        share = touched(trials[trials.method == method])
        _notes(ax, place, "data", percent(error[method].median()), percent(share, 0))
    ax.set_yticks(range(len(methods)), [METHODS[method][0] for method in methods])
    ax.set(xscale="log", ylim=(len(methods) - 0.5, -0.5), xlabel="parameter error after the last experiment (rms)")
    log_ticks(ax.xaxis, *ax.get_xlim(), in_percent)
    best = error[methods].median().idxmin()
    ax.set_title(f"{system.capitalize()}: {METHODS[str(best)][0]} errs least, in the median")


def _strip(ax: Axes, place: int, method: str, error: pd.Series) -> None:
    _, colour, _, marker = METHODS[method]
    spread = place + np.linspace(-0.25, 0.25, len(error))
    ax.plot(error, spread, marker, color=colour, alpha=0.7, markersize=4, markeredgewidth=0)
    low, middle, high = error.quantile([0.25, 0.5, 0.75])
    ax.plot([low, high], [place, place], color="black", linewidth=1.2)
    ax.plot([middle] * 2, [place - 0.3, place + 0.3], color="black", linewidth=2)


def _notes(ax: Axes, y: float, coordinates: str, *notes: str) -> None:
    for x, note in zip((1.1, 1.22), notes, strict=True):
        place = ("axes fraction", coordinates)
        ax.annotate(note, (x, y), xycoords=place, ha="right", va="center", annotation_clip=False)
