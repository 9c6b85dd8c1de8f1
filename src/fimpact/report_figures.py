"""The pictures of a diagnosis: overlay, where, when, in which state, and the candidates. One column wide each."""

import re
from collections.abc import Callable
from io import StringIO
from pathlib import Path

import matplotlib.pyplot as plt
import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from fimpact.added_force import added_force
from fimpact.looks import STYLE, log_ticks, save
from fimpact.mismatch.diagnose import Diagnosis
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import squares
from fimpact.units import channel_unit

# Okabe-Ito; ink, quiet and paper change places in a dark page.
INK, QUIET, FAINT, PAPER = "#1a1a1a", "#6f6f6f", "#dcdcdc", "#ffffff"
RECORDED, NAIVE, IMPROVED, RIVAL, ALIKE = INK, "#D55E00", "#0072B2", "#9a9a9a", "#56B4E9"
MODES = {"free": "#6f6f6f", "impact": "#CC79A7", "contact": "#009E73"}
COLOURS = tuple(c.lower() for c in (INK, QUIET, FAINT, PAPER, NAIVE, IMPROVED, RIVAL, ALIKE, *MODES.values()))
WIDTH = 3.75  # inches: a phone
LOOK = {
    **STYLE,
    "font.size": 8,
    "axes.titlesize": 8.5,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    **dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
    "axes.titlecolor": INK,
    "svg.fonttype": "path",
}
CHANNELS = 2  # shown in the overlay
UNSEEN = 10.0  # times the quartile of the deviations, beyond which a force is not shown
BARS = 12
POINTS = 1500  # of a line
CLOUD = 900  # points in a scatter
COLUMNS = 40  # of the timeline, at least
GROUPS = 12  # over which its medians are taken


def force_unit(model: mujoco.MjModel, dof: int) -> str:
    """Unit of the generalised force of a degree of freedom."""
    return "N" if _translates(model, dof) else "N m"


def _translates(model, dof: int) -> bool:
    joint = model.dof_jntid[dof]
    kind, first = mujoco.mjtJoint(model.jnt_type[joint]), model.jnt_dofadr[joint]
    return kind == mujoco.mjtJoint.mjJNT_SLIDE or (kind == mujoco.mjtJoint.mjJNT_FREE and dof - first < 3)


def draw(picture: Callable[..., Figure], *args) -> Figure:
    """A picture in the style of the page."""
    with plt.rc_context(LOOK):
        return picture(*args)


def store(figure: Figure, stem: Path) -> None:
    """Write `figure` as `stem`.svg and `stem`.png, the same bytes each time."""
    with plt.rc_context(LOOK):
        for suffix in (".svg", ".png"):
            save(figure, f"{stem}{suffix}")


def inline(figure: Figure, prefix: str) -> str:
    """`figure` as SVG for an HTML page: no addresses, ids of its own, and colours that follow the page's scheme."""
    out = StringIO()
    with plt.rc_context(LOOK):
        figure.savefig(out, format="svg", metadata={"Date": None})
    svg = out.getvalue()
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.S)
    svg = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", svg)
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{prefix}-", svg)
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg))
    return re.sub("|".join(COLOURS), lambda found: f"var(--c-{found[0][1:]})", svg, flags=re.I)


def shown_run(diagnosis: Diagnosis) -> int:
    """The held-out run whose naive error is the median one."""
    runs = diagnosis.bench.held_out.windows.runs
    errors = squares(diagnosis.naming.naive.judged)
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
    handles = [Line2D([], [], color=c, linestyle=style, linewidth=width) for c, style, width in LINES]
    names = ["recorded", "naive fit", "improved"]
    kept = 3 if naming.best.placed else 2
    figure.legend(handles[:kept], names[:kept], ncol=3, loc="outside upper center")
    return figure


LINES = ((RECORDED, "-", 2.2), (NAIVE, "--", 1.2), (IMPROVED, "-", 1.0))


def worst_channels(diagnosis: Diagnosis) -> list[int]:
    """Those that the naive fit predicts worst for their noise, at most `CHANNELS`, in their order."""
    problem = diagnosis.bench.held_out
    sizes = list(diagnosis.evidence.by_channel.values())
    ratio = [before / noise for (before, _), noise in zip(sizes, problem.noise.mean((0, 1)), strict=True)]
    return sorted(np.argsort(ratio)[::-1][:CHANNELS].tolist())


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
    for values, (colour, style, width) in zip(series, LINES, strict=False):
        ax.plot(time, values, color=colour, linestyle=style, linewidth=width, alpha=0.35 if width > 2 else 1)
    ax.set_title(name)
    ax.set_ylabel(unit or "reading")
    ax.yaxis.set_major_locator(MaxNLocator(4))


def _errors(ax: Axes, time, series, noise: float) -> None:
    recorded, *models = series
    ax.axhspan(-2 * noise, 2 * noise, color=FAINT, linewidth=0)
    for values, (colour, _, _) in zip(models, LINES[1:], strict=False):
        ax.plot(time, recorded - values, color=colour, linewidth=0.9)
    ax.yaxis.set_major_locator(MaxNLocator(3))


def _thousandths(ax: Axes, unit: str) -> None:
    """Label errors in the unit, or in thousandths or millionths of it."""
    largest = max(abs(limit) for limit in ax.get_ylim())
    power = 0 if largest > 0.2 else 3 if largest > 2e-4 else 6
    prefix = {0: "", 3: "m", 6: "µ"}[power]
    ax.yaxis.set_major_formatter(lambda value, _: f"{value * 10**power:.4g}".replace("-", "−"))
    ax.set_ylabel(f"error\n({prefix}{unit})" if unit else f"error\n(×10$^{{-{power}}}$)" if power else "error")


def mechanism(diagnosis: Diagnosis) -> Figure:
    """Share of the unexplained by joint and channel, and the size of the residual force by contact mode."""
    location = diagnosis.location
    places, modes = location.places[:BARS], location.modes
    rows = (max(len(places), 2), len(modes)) if len(modes) > 1 else (max(len(places), 2),)
    figure, axes = plt.subplots(len(rows), 1, figsize=(WIDTH, 0.24 * sum(rows) + 0.75 * len(rows)), squeeze=False,
                                height_ratios=rows)  # fmt: skip
    colours = [IMPROVED if place.kind == "joint" else RIVAL for place in places]
    names = [f"{p.name} ({'force' if p.kind == 'joint' else 'sensor'})" for p in places]
    _bars(axes[0, 0], names, [100 * p.share for p in places], colours, "{:.0f} %")
    axes[0, 0].set(xlim=(0, 118), title="Explained by freeing one place alone")
    if len(rows) > 1:
        _bars(axes[1, 0], list(modes), list(modes.values()), [MODES.get(m, RIVAL) for m in modes], "{:.2g}")
        axes[1, 0].set_title("Unexplained force by contact mode")
        axes[1, 0].margins(x=0.18)
    return figure


def _bars(ax: Axes, names, values, colours, form: str) -> None:
    ax.barh(range(len(names)), values, color=colours, height=0.68)
    for i, value in enumerate(values):
        ax.annotate(form.format(value), (value, i), xytext=(3, 0), textcoords="offset points", va="center")
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.tick_params(axis="y", length=0)
    ax.spines["bottom"].set_visible(False)
    ax.set_xticks([])


def timeline(diagnosis: Diagnosis) -> Figure:
    """Standardised residual force by joint over the training runs that it is largest in, and the contact mode."""
    location, windows = diagnosis.location, diagnosis.bench.training.windows
    at, names = _telling(diagnosis)
    size = np.abs(location.force / location.deviation)[at].reshape(-1, len(location.dofs)).T
    seconds = windows.length * diagnosis.recording.period * len(at)
    figure, (ax, ribbon) = plt.subplots(2, 1, figsize=(WIDTH, 1.35 + 0.28 * len(size)), sharex=True,
                                        height_ratios=(max(len(size), 2), 0.5))  # fmt: skip
    top = max(4.0, float(np.percentile(size, 99)))
    image = ax.imshow(size, aspect="auto", cmap="cividis", vmin=0, vmax=top, extent=(0, seconds, len(size), 0),
                      interpolation="nearest")  # fmt: skip
    ax.set_yticks(np.arange(len(size)) + 0.5, location.dofs)
    ax.tick_params(axis="both", length=0)
    ax.set_title("Unexplained force (standard deviations)")
    figure.colorbar(image, ax=[ax, ribbon], pad=0.02, aspect=12).outline.set_visible(False)
    for start in np.flatnonzero(np.diff(windows.runs[at])) + 1:
        ax.axvline(start * seconds / len(at), color=PAPER, linewidth=1)
    _ribbon(ribbon, location.mode[at].ravel(), seconds)
    thinned = diagnosis.recording.windows
    ribbon.set_xlabel(f"time in the fitted windows of {names} (s)" if thinned else f"time in {names} (s)")
    return figure


def _telling(diagnosis: Diagnosis) -> tuple[np.ndarray, str]:
    """Windows of the training runs with most unexplained force, as many as fill the picture, and what to call them."""
    location, windows = diagnosis.location, diagnosis.bench.training.windows
    size = ((location.force / location.deviation) ** 2).mean((1, 2))
    ranked = sorted(np.unique(windows.runs), key=lambda run: -size[windows.runs == run].mean())
    chosen: list[int] = []
    while ranked and np.isin(windows.runs, chosen).sum() * location.mode.shape[1] < COLUMNS:
        chosen.append(ranked.pop(0))
    at = np.concatenate([run_rows[np.argsort(windows.first[run_rows])]
                         for run in chosen for run_rows in [np.flatnonzero(windows.runs == run)]])  # fmt: skip
    many = f"{len(chosen)} training runs, one after another"
    return at, many if len(chosen) > 1 else f"training run {windows.names[chosen[0]]}"


def _ribbon(ax: Axes, modes: np.ndarray, seconds: float) -> None:
    edges = np.flatnonzero(np.append(True, modes[1:] != modes[:-1]))
    width = seconds / len(modes)
    spans = np.diff(np.append(edges, len(modes)))
    for mode in np.unique(modes):
        own = [(e * width, s * width) for e, s in zip(edges, spans, strict=True) if modes[e] == mode]
        ax.broken_barh(own, (0, 1), color=MODES.get(str(mode), RIVAL), linewidth=0)
        start, length = max(own, key=lambda span: span[1])
        if length > 0.12 * seconds:
            ax.annotate(str(mode), (start + length / 2, 0.5), ha="center", va="center", fontsize=7, color=PAPER)
    ax.set(yticks=[0.5], ylim=(0, 1), xlim=(0, seconds))
    ax.set_yticklabels(["mode"])
    ax.tick_params(axis="y", length=0)
    ax.spines[["left", "bottom"]].set_visible(False)


def state(diagnosis: Diagnosis) -> Figure:
    """Unexplained force of the located joint against its speed and position, and what the improved model adds."""
    location, model = diagnosis.location, diagnosis.bench.training.simulator.base
    dof = located_dof(diagnosis)
    position = int(model.jnt_qposadr[model.dof_jntid[dof]] + dof - model.jnt_dofadr[model.dof_jntid[dof]])
    force, deviation = (part[..., dof].ravel() for part in (location.force, location.deviation))
    added = added_force(diagnosis, dof)
    # At the end of a window a force has no time to show: what would be seen there is noise, hugely magnified.
    seen = deviation <= UNSEEN * np.quantile(deviation, 0.25)
    unit, metres = force_unit(model, dof), "m" if _translates(model, dof) else "rad"
    axes_of = {f"speed ({metres}/s)": location.qvel[..., dof], f"position ({metres})": location.qpos[..., position]}
    figure, axes = plt.subplots(2, 1, figsize=(WIDTH, 4.2), sharey=True)
    for ax, (label, x) in zip(axes, axes_of.items(), strict=True):
        _cloud(ax, x.ravel()[seen], force[seen], deviation[seen], None if added is None else added[seen])
        ax.set(xlabel=label, ylabel=f"force ({unit})")
    axes[0].set_title(f"What {location.dofs[dof]} feels and the naive fit lacks")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, ncol=2, loc="outside lower center")
    return figure


def located_dof(diagnosis: Diagnosis) -> int:
    """The degree of freedom that explains most."""
    location = diagnosis.location
    return next((location.dofs.index(p.name) for p in location.places if p.kind == "joint"), 0)


def _cloud(ax: Axes, x, force, deviation, added) -> None:
    shown = np.random.default_rng(0).permutation(len(x))[:CLOUD]
    limit = 1.5 * np.percentile(np.abs(force), 98)
    ax.axhline(0, color=QUIET, linewidth=0.6)
    ax.plot(x[shown], force[shown], ".", color=RIVAL, markersize=2.2, alpha=0.5, zorder=1)
    edges = np.quantile(x, np.linspace(0, 1, GROUPS + 1))
    group = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, GROUPS - 1)
    present = [g for g in range(GROUPS) if (group == g).any()]
    weight = 1 / deviation**2
    middle = np.array([np.average(x[group == g]) for g in present])
    mean = np.array([np.average(force[group == g], weights=weight[group == g]) for g in present])
    error = np.array([_spread(force[group == g], weight[group == g]) for g in present])
    look = {"capsize": 2, "linestyle": "none", "marker": "o", "markersize": 3.5, "elinewidth": 1}
    ax.errorbar(middle, mean, error, color=INK, label="unexplained, mean ± 95 %", zorder=3, **look)
    if added is not None:
        law = [np.average(added[group == g], weights=weight[group == g]) for g in present]
        ax.plot(middle, law, color=IMPROVED, linewidth=1.8, label="improved model adds", zorder=4)
        limit = max(limit, 1.2 * np.abs(law).max())
    ax.set_ylim(-limit, limit)


def _spread(force, weight) -> float:
    mean = np.average(force, weights=weight)
    return float(1.96 * np.sqrt((weight**2 * (force - mean) ** 2).sum()) / weight.sum())


def candidates(diagnosis: Diagnosis) -> Figure:
    """Held-out error of the naive fit and of every candidate that was refitted, with the noise floor."""
    rows = candidate_rows(diagnosis)
    labels = [_wrapped(row["name"]) for row in rows]
    lines = max(label.count("\n") + 1 for label in labels)
    figure, ax = plt.subplots(figsize=(WIDTH, max(0.27, 0.14 * lines + 0.04) * len(rows) + 1.0))
    values = [row["error"] for row in rows]
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
    for i, value in enumerate(values):
        ax.annotate(f"{value:.3g}", (ends[i], i), xytext=(3, 0), textcoords="offset points", va="center", fontsize=7.5)
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
        error = float(np.sqrt(squares(explanation.judged).sum() / samples))
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
