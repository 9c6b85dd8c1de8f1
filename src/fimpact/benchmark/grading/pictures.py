"""The benchmark's four pictures, each from `cases.csv` alone."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from scipy.stats import binomtest

from fimpact.benchmark.grading.claim import NULL, VISIBLE, calibration, claims, error_of
from fimpact.benchmark.grading.confusion import confusion
from fimpact.report.plotting.style import STYLE, WIDTH, in_percent, log_places, set_ticks, write

OURS, OTHERS, MUTED = "#0072B2", "#D55E00", "0.55"
BELOW = -0.06  # where counts stand, under the shares
APART = 0.07  # numbers stand at least that far apart
ERRORS = {  # column -> label, colour, marker; from the naive model to what noise allows
    "heldout_before": ("naive model, fitted", MUTED, "s"),
    "heldout_sysid_five": ("mujoco.sysid, best of five", OTHERS, "v"),
    "heldout_blackbox": ("black-box residual", "#CC79A7", "D"),
    "heldout_refit_all": ("refit every candidate, BIC", "#56B4E9", "^"),
    "heldout_after": ("fimpact", OURS, "o"),
    "heldout_oracle": ("oracle", "#009E73", "P"),
    "noise_floor": ("noise floor", "black", "|"),
}
EDGES = np.array([3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0])  # of lambda
DEPTHS = np.array([0.0, 0.5, 0.9, 0.97, 0.99, 0.997, 1.0])  # of kappa


def held_out(cases: pd.DataFrame, stem: Path | str) -> None:
    """Draw held-out error before, after and of every comparator, a panel per rig, to `stem`.svg and `stem`.png."""
    planted = cases[cases.kind.isin(["single", "double", "twin"])]
    shared = planted[planted.heldout_blackbox.notna()]
    systems = list((shared if len(shared) else planted).groupby("system", sort=True))
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(len(systems), 1, figsize=(WIDTH, 2.3 * len(systems)), squeeze=False)
        for ax, (system, part) in zip(axes[:, 0], systems, strict=True):
            _strips(ax, part)
            ax.set_title(
                f"{_words(str(system))}: {_cases(len(part))} with an effect; one mark per case, bars at the median"
            )
        axes[-1, 0].set_xlabel("held-out error (standard deviations of the noise)")
        write(figure, stem)


def _words(system: str) -> str:
    return system.replace("_", " ").capitalize()


def _cases(count: int) -> str:
    return "1 case" if count == 1 else f"{count} cases"


def _strips(ax: Axes, part: pd.DataFrame) -> None:
    ax.set_xscale("log")
    for place, (column, (_, colour, marker)) in enumerate(ERRORS.items()):
        values = part[column].dropna().sort_values()
        if values.empty:
            continue
        spread = place + np.linspace(-0.25, 0.25, len(values))
        width = 1.0 if marker == "|" else 0.0
        ax.plot(values, spread, marker, color=colour, alpha=0.6, markersize=4, markeredgewidth=width)
        ax.plot([values.median()] * 2, [place - 0.36, place + 0.36], color="black", linewidth=2)
        ax.annotate(
            f"{values.median():.3g}",
            (1.02, place),
            xycoords=("axes fraction", "data"),
            ha="left",
            va="center",
            annotation_clip=False,
        )
    ax.set_yticks(range(len(ERRORS)), [label for label, _, _ in ERRORS.values()])
    ax.set_ylim(len(ERRORS) - 0.5, -0.5)
    low, high = ax.get_xlim()
    set_ticks(ax.xaxis, log_places(low, high), lambda value: f"{value:g}")


def calibration_curve(cases: pd.DataFrame, stem: Path | str) -> None:
    """Draw how often an answer is right against the confidence it states, to `stem`.svg and `stem`.png."""
    stated = claims(cases).to_numpy(float)
    with plt.rc_context(STYLE):
        figure, ax = plt.subplots(figsize=(WIDTH / 2 + 0.4, 3.6))
        ax.plot([0, 1], [0, 1], color=MUTED, linewidth=0.8, zorder=0)
        if len(stated):
            draw_bins(ax, calibration(stated))
            ax.set_title(f"Calibration error {error_of(stated):.3f} over {len(stated)} named answers")
        ax.set(xlabel="stated confidence", ylabel="right (95 % interval)", xlim=(-0.02, 1.04), ylim=(-0.1, 1.04))
        for axis in (ax.xaxis, ax.yaxis):
            set_ticks(axis, [0, 0.25, 0.5, 0.75, 1], in_percent)
        write(figure, stem)


def draw_bins(ax: Axes, table: np.ndarray) -> None:
    """Draw each bin of a calibration and its count: mean confidence, share right, answers, (bins, 3)."""
    counts = [(round(share * n), int(n)) for _, share, n in table]
    _whiskers(ax, table[:, 0], counts, OURS, "o", "-")
    place = -1.0
    for x, _, n in table:
        place = max(x, place + APART)
        ax.annotate(f"{n:.0f}", (place, BELOW), color=MUTED, ha="center", va="center", fontsize=7.5)
    first = table[0, 0]
    left = first >= 1 - place  # the side where there is room
    word, x = ("answers:", min(first - 0.06, 0.94)) if left else ("answers", place + 0.06)
    ax.annotate(word, (x, BELOW), color=MUTED, ha="right" if left else "left", va="center", fontsize=7.5)


def _whiskers(ax: Axes, x, counts: list[tuple[int, int]], colour: str, marker: str, line: str, **rest) -> None:
    """Shares k / n with Wilson intervals."""
    share = np.array([k / n for k, n in counts])
    ends = np.array([binomtest(k, n).proportion_ci(method="wilson") for k, n in counts])
    lengths = np.maximum([share - ends[:, 0], ends[:, 1] - share], 0)
    ax.errorbar(x, share, lengths, color=colour, marker=marker, linestyle=line, capsize=2, elinewidth=0.9, **rest)


def detection(cases: pd.DataFrame, stem: Path | str) -> None:
    """Draw the share detected against effect size and against concealment, to `stem`.svg and `stem`.png."""
    planted = cases[cases.kind != "null"]
    with plt.rc_context(STYLE):
        figure, (left, right) = plt.subplots(1, 2, figsize=(WIDTH, 3.2), sharey=True)
        _against_size(left, planted)
        _against_depth(right, planted[planted["lambda"] >= VISIBLE])
        alarms = cases[cases.kind == NULL].detected
        for ax in (left, right):
            if len(alarms):
                ax.axhline(alarms.mean(), color=MUTED, linewidth=0.8, linestyle=":", zorder=0)
            ax.set_ylim(-0.03, 1.05)
        left.set_ylabel("detected (95 % interval)")
        set_ticks(left.yaxis, [0, 0.25, 0.5, 0.75, 1], in_percent)
        if len(alarms):
            place = {"xycoords": ("axes fraction", "data"), "xytext": (0, 3), "textcoords": "offset points"}
            text = f"false alarms {in_percent(round(float(alarms.mean()), 3))}"
            left.annotate(text, (0.98, alarms.mean()), ha="right", color=MUTED, fontsize=8, **place)
        write(figure, stem)


def _against_size(ax: Axes, planted: pd.DataFrame) -> None:
    groups = {"κ ≥ 0.9": (planted.kappa >= 0.9, OURS, "o", "-"), "κ < 0.9": (planted.kappa < 0.9, OTHERS, "s", "--")}
    for shift, (label, (mask, colour, marker, line)) in zip((0.95, 1.05), groups.items(), strict=True):
        x, counts = _binned(planted[mask], "lambda", EDGES)
        if counts:
            _whiskers(ax, shift * x, counts, colour, marker, line, label=f"{label} ({_cases(int(mask.sum()))})")
    ax.axvline(VISIBLE, color=MUTED, linewidth=0.6, zorder=0)
    ax.set(xscale="log", xlabel="effect size: oracle's non-centrality λ", title="Detection against size")
    set_ticks(ax.xaxis, EDGES.tolist(), lambda value: f"{value:,.0f}")
    # Below: error bars of few cases fill all of the axes.
    ax.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, columnspacing=1.0)


def _against_depth(ax: Axes, visible: pd.DataFrame) -> None:
    counts, labels = [], []
    place = pd.cut(visible.kappa, DEPTHS.tolist(), include_lowest=True)
    for interval, part in visible.groupby(place, observed=True):
        counts.append((int(part.detected.sum()), len(part)))
        labels.append(f"{max(interval.left, 0):g} to\n{interval.right:g}\n({len(part)})")
    if counts:
        _whiskers(ax, np.arange(len(counts)), counts, OURS, "o", "none")
    ax.set_xticks(range(len(labels)), labels, fontsize=7.5)
    ax.set(xlabel="concealment κ (number of cases)", title=f"… against concealment, λ ≥ {VISIBLE:g}")


def _binned(part: pd.DataFrame, column: str, edges: np.ndarray) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """Geometric middles of the bins that have cases, and (detected, all) in each."""
    place = np.clip(np.searchsorted(edges, part[column], side="right") - 1, 0, len(edges) - 2)
    used = np.unique(place)
    counts = [(int(part.detected[place == b].sum()), int((place == b).sum())) for b in used]
    return np.sqrt(edges[used] * edges[used + 1]), counts


FIGURES = {
    "confusion": confusion,
    "held-out": held_out,
    "calibration": calibration_curve,
    "detection": detection,
}
