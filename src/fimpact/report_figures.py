"""The pictures of a diagnosis: overlay, where, when, in which state, and the candidates."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from fimpact.looks import log_ticks
from fimpact.mismatch.diagnose import Diagnosis
from fimpact.mismatch.fit import Fit
from fimpact.report_look import ALIKE, FAINT, IMPROVED, INK, NAIVE, RECORDED, RIVAL, WIDTH, draw
from fimpact.report_where import mechanism, state, timeline
from fimpact.units import channel_unit

CHANNELS = 2  # shown in the overlay
BARS = 12
POINTS = 1500  # of a line


def shown_run(diagnosis: Diagnosis) -> int:
    """The held-out run whose naive error is the median one."""
    runs = diagnosis.bench.held_out.windows.runs
    errors = diagnosis.naming.naive.judged.point.squares
    present = np.unique(runs)
    mean = np.array([errors[runs == run].mean() for run in present])
    return int(present[np.argsort(mean)[(len(mean) - 1) // 2]])


def predicted(diagnosis: Diagnosis, judged: Fit) -> np.ndarray:
    """Prediction of the held-out windows, (w, T, ny), in the channels' units."""
    problem, point = diagnosis.bench.held_out, judged.point
    return problem.simulator.predict(point.hypothesis, problem.windows, point.qpos, point.qvel) + problem.offset


def overlay(diagnosis: Diagnosis) -> Figure:
    """Recorded, naive and improved over time, and below what either leaves."""
    problem, naming = diagnosis.bench.held_out, diagnosis.naming
    at = np.flatnonzero(problem.windows.runs == shown_run(diagnosis))
    shown = [naming.naive, naming.best] if naming.best.placed else [naming.naive]
    lines = [problem.windows.measured, *(predicted(diagnosis, explanation.judged) for explanation in shown)]
    lines = [line[at] for line in lines]
    channels = worst_channels(diagnosis)
    time = _window_time(problem.simulator.recording.period, problem.windows, at)
    ratios = [1.5, 1] * len(channels)
    figure, axes = plt.subplots(len(ratios), 1, figsize=(WIDTH, 1.9 * len(channels) + 0.5), sharex=True,
                                height_ratios=ratios)  # fmt: skip
    for row, channel in enumerate(channels):
        series = [_stitched(line[..., channel]) for line in lines]
        _signal(axes[2 * row], _stitched(time), series, diagnosis, channel)
        _errors(axes[2 * row + 1], _stitched(time), series, problem.noise[at][..., channel].mean())
        unit = channel_unit(problem.simulator.base, diagnosis.recording.channels[channel])
        _thousandths(axes[2 * row + 1], unit)
    axes[-1].set_xlabel("time (s)")
    handles = [Line2D([], [], **look) for look in LINES]
    names = ["recorded", "naive fit", "improved"]
    kept = 3 if naming.best.placed else 2
    figure.legend(handles[:kept], names[:kept], ncol=3, loc="outside upper center")
    return figure


LINES = (
    {"color": RECORDED, "linewidth": 2.2, "alpha": 0.35},
    {"color": NAIVE, "linewidth": 1.2, "linestyle": "--"},
    {"color": IMPROVED, "linewidth": 1.0},
)


def worst_channels(diagnosis: Diagnosis) -> list[int]:
    """Those that the naive fit predicts worst for their noise, at most `CHANNELS`, in their order."""
    problem = diagnosis.bench.held_out
    sizes = list(diagnosis.evidence.by_channel.values())
    ratio = [before / noise for (before, _), noise in zip(sizes, problem.noise.mean((0, 1)), strict=True)]
    # What no held-out run measured has no error, and comes last.
    return sorted(np.argsort(np.nan_to_num(ratio, nan=-1.0))[::-1][:CHANNELS].tolist())


def _window_time(period: float, windows, at) -> np.ndarray:
    return (windows.first[at][:, None] + np.arange(windows.length)) * period


def _stitched(rows: np.ndarray) -> np.ndarray:
    """Windows (w, T) one after another with a gap between them, thinned to what a line can show."""
    step = max(1, rows.size // POINTS)
    thin = rows[:, ::step]
    return np.concatenate([thin, np.full((len(thin), 1), np.nan)], 1).ravel()


def _signal(ax: Axes, time, series, diagnosis: Diagnosis, channel: int) -> None:
    name = diagnosis.recording.channels[channel]
    unit = channel_unit(diagnosis.bench.training.simulator.base, name)
    for values, look in zip(series, LINES, strict=False):
        ax.plot(time, values, **look)
    ax.set_title(name)
    ax.set_ylabel(unit or "reading")
    ax.yaxis.set_major_locator(MaxNLocator(4))


def _errors(ax: Axes, time, series, noise: float) -> None:
    recorded, *models = series
    ax.axhspan(-2 * noise, 2 * noise, color=FAINT, linewidth=0)
    for values, look in zip(models, LINES[1:], strict=False):
        ax.plot(time, recorded - values, color=look["color"], linewidth=0.9)
    ax.yaxis.set_major_locator(MaxNLocator(3))


def _thousandths(ax: Axes, unit: str) -> None:
    """Label errors in the unit, or in thousandths or millionths of it."""
    largest = max(abs(limit) for limit in ax.get_ylim())
    power = 0 if largest > 0.2 else 3 if largest > 2e-4 else 6
    prefix = {0: "", 3: "m", 6: "µ"}[power]
    ax.yaxis.set_major_formatter(lambda value, _: f"{value * 10**power:.4g}".replace("-", "−"))
    ax.set_ylabel(f"error\n({prefix}{unit})" if unit else f"error\n(×10$^{{-{power}}}$)" if power else "error")


def candidates(diagnosis: Diagnosis) -> Figure:
    """Held-out error of the naive fit and of every candidate that was refitted, with the noise floor."""
    rows = candidate_rows(diagnosis)
    labels = [_wrapped(row["name"]) for row in rows]
    lines = max(label.count("\n") + 1 for label in labels)
    figure, ax = plt.subplots(figsize=(WIDTH, max(0.27, 0.14 * lines + 0.04) * len(rows) + 1.0))
    # What diverges on held-out runs ends beyond the axis.
    largest = max(row["error"] for row in rows if np.isfinite(row["error"]))
    values = [row["error"] if np.isfinite(row["error"]) else 10 * largest for row in rows]
    floor = diagnosis.evidence.noise_floor
    low = 0.6 * min(floor, *values)
    logarithmic = max(values) > 5 * floor
    # Values stand clear of the line that marks the floor.
    ends = [max(value, floor) if value > 0.7 * floor else value for value in values]
    if logarithmic:
        ax.set_xscale("log")
        ax.set_xlim(low, 2.2 * max(values))
    else:
        ax.set_xlim(0, 1.2 * max(*values, floor))
    colours = {"best": IMPROVED, "alike": ALIKE, "naive": NAIVE, "rival": RIVAL}
    ax.barh(range(len(rows)), values, color=[colours[row["role"]] for row in rows], height=0.7)
    look = {"xytext": (3, 0), "textcoords": "offset points", "va": "center", "fontsize": 7.5}
    for i, row in enumerate(rows):
        ax.annotate(f"{row['error']:.3g}", (ends[i], i), **look)
    ax.set_yticks(range(len(rows)), labels, fontsize=7.5)
    ax.invert_yaxis()
    ax.axvline(floor, color=INK, linestyle=":", linewidth=1.3)
    ax.annotate("noise floor", (floor, 1), xycoords=("data", "axes fraction"), xytext=(2, 3),
                textcoords="offset points", fontsize=7.5)  # fmt: skip
    if logarithmic:
        log_ticks(ax.xaxis, *ax.get_xlim(), "{:g}".format)
    ax.set_xlabel("held-out error (noise = 1)")
    return figure


def candidate_rows(diagnosis: Diagnosis) -> list[dict]:
    """name, error and role ("naive", "best", "alike" or "rival") of each explanation, best first."""
    naming, windows = diagnosis.naming, diagnosis.bench.held_out.windows
    samples = np.isfinite(windows.measured).sum()
    alike = {member.name for member in naming.members}
    found = {}
    for explanation in (r for step in naming.steps for r in step.rivals):
        name = explanation.name
        role = "best" if name == naming.best.name else "alike" if name in alike else "rival"
        error = float(np.sqrt(explanation.judged.point.squares.sum() / samples))
        found[name] = {"name": name, "error": error, "role": role}
    if naming.best.placed:
        found[naming.best.name] = {"name": naming.best.name, "error": diagnosis.evidence.after, "role": "best"}
    kept = sorted(found.values(), key=lambda row: (row["role"] != "best", row["error"]))[: BARS - 1]
    return [*kept, {"name": "naive fit", "error": diagnosis.evidence.before, "role": "naive"}]


def _wrapped(name: str) -> str:
    # A name in words, in two lines where it is long.
    text = name.replace("_", " ").replace("@", " @ ").replace("+", " + ")
    return (
        text if len(text) < 24 else text.replace(" @ ", "\n@ ", 1) if "+" not in text else text.replace(" + ", "\n+ ")
    )


def pictures(diagnosis: Diagnosis) -> dict[str, Figure]:
    """All figures by file name."""
    drawn = {"overlay": overlay, "mechanism": mechanism, "timeline": timeline, "state": state, "candidates": candidates}
    return {name: draw(picture, diagnosis) for name, picture in drawn.items()}
