"""Where a mismatch sits, in pictures: in the mechanism and the contact mode, in time, in state."""

import matplotlib.pyplot as plt
import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fimpact.added_force import added_force
from fimpact.mismatch.diagnose import Diagnosis
from fimpact.report_look import IMPROVED, INK, MODES, PAPER, QUIET, RIVAL, WIDTH

UNSEEN = 10.0  # times the quartile of the deviations, beyond which a force is not shown
BARS = 12
CLOUD = 900  # points in a scatter
COLUMNS = 40  # of the timeline, at least
GROUPS = 12  # over which its medians are taken


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
    ribbon.set_xlabel(f"time in fitted windows of {names} (s)" if thinned else f"time in {names} (s)")
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
    many = f"{len(chosen)} training runs, end to end"
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
    force, deviation = (part[..., dof].ravel() for part in (location.force, location.deviation))
    added = added_force(diagnosis, dof)
    # At the end of a window a force has no time to show: what would be seen there is noise, hugely magnified.
    seen = deviation <= UNSEEN * np.quantile(deviation, 0.25)
    unit, metres = force_unit(model, dof), "m" if _translates(model, dof) else "rad"
    axes_of = {f"speed ({metres}/s)": location.qvel[..., dof]}
    if (position := _coordinate(model, dof)) is not None:
        axes_of[f"position ({metres})"] = location.qpos[..., position]
    figure, axes = plt.subplots(len(axes_of), 1, figsize=(WIDTH, 2.1 * len(axes_of)), sharey=True, squeeze=False)
    axes = axes[:, 0]
    for ax, (label, x) in zip(axes, axes_of.items(), strict=True):
        _cloud(ax, x.ravel()[seen], force[seen], deviation[seen], None if added is None else added[seen])
        ax.set(xlabel=label, ylabel=f"force ({unit})")
    axes[0].set_title(f"What {location.dofs[dof]} feels and the naive fit lacks")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, ncol=2, loc="outside lower center")
    return figure


def _coordinate(model: mujoco.MjModel, dof: int) -> int | None:
    """Where in `qpos` the position of a degree of freedom stands; None of a rotation that is part of a quaternion."""
    joint = model.dof_jntid[dof]
    part, kind = int(dof - model.jnt_dofadr[joint]), mujoco.mjtJoint(model.jnt_type[joint])
    turns = kind == mujoco.mjtJoint.mjJNT_BALL or (kind == mujoco.mjtJoint.mjJNT_FREE and part >= 3)
    return None if turns else int(model.jnt_qposadr[joint]) + part


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


def force_unit(model: mujoco.MjModel, dof: int) -> str:
    """Unit of the generalised force of a degree of freedom."""
    return "N" if _translates(model, dof) else "N m"


def _translates(model, dof: int) -> bool:
    joint = model.dof_jntid[dof]
    kind, first = mujoco.mjtJoint(model.jnt_type[joint]), model.jnt_dofadr[joint]
    return kind == mujoco.mjtJoint.mjJNT_SLIDE or (kind == mujoco.mjtJoint.mjJNT_FREE and dof - first < 3)
