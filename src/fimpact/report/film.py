"""The film of a diagnosis: recorded, naive and improved motion side by side, drawn without a graphics card."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from fimpact.diagnosis.pipeline import Diagnosis
from fimpact.recordings import Run
from fimpact.report.look import FAINT, IMPROVED, INK, LOOK, NAIVE, QUIET
from fimpact.report.plotting.gif import write_gif
from fimpact.report.plotting.scene import Scene, outline
from fimpact.report.plotting.stroboscopic import View, common_view, draw_bodies, draw_world, geoms, set_up
from fimpact.report.poses import configurations, scene_of, undrawable
from fimpact.simulation.horizon import MOST_WINDOWS
from fimpact.simulation.window_fit import Starts, window_starts
from fimpact.simulation.windows import cut
from fimpact.support.channel_units import channel_unit

FRAMES = 60
PLAYED = (3.0, 6.0)  # s: slower or faster than it was, if need be
SIZE = (4.8, 135)  # inches, dots per inch: type that can be read on a phone
MOST = 1_500_000  # bytes, which a page carries a third more of
GHOST = 0.18  # opacity of what was recorded behind a model
WINDOWS, LENGTHS = 4, (1.0, 6.0)  # of the case that are shown in one go, and for how long, s
SMALL = 0.03  # share of the picture below which a body is marked by a dot
FAR = 5.0  # pictures away, where nothing is drawn any more
COLOURS = {"recorded": QUIET, "naive fit": NAIVE, "improved": IMPROVED}


@dataclass(frozen=True)
class Stretch:
    """Part of a run: what was recorded and what models say of it, (T, ny) by name, and its time in the run, (T,) s."""

    run: str
    readings: dict[str, np.ndarray]
    time: np.ndarray


def draw_film(diagnosis: Diagnosis, runs: Sequence[Run], starts: Sequence[Starts], path: Path | str) -> str:
    """Write the film of one stretch of `runs` as a GIF.

    Args:
        starts: states at every sample of each run.

    Returns:
        Why there is none, in one sentence; empty where it was written.
    """
    if reason := undrawable(diagnosis.simulator.base, diagnosis.recording.channels):
        return reason
    part = stretch(diagnosis, runs, starts)
    scenes = _scenes(diagnosis, part)
    with plt.rc_context(LOOK):
        shots = list(_shots(diagnosis, scenes, part))
    write_gif(shots, [INK, *COLOURS.values()], FRAMES / _played(part.time), path, MOST)
    return ""


def stretch(diagnosis: Diagnosis, runs: Sequence[Run], starts: Sequence[Starts]) -> Stretch:
    """The stretch, some seconds long, in which the naive model errs as much as in the median one; each model in one go
    from the state at its beginning."""
    recording, simulator = diagnosis.recording, diagnosis.prepared.proving
    windows = cut(runs, max(2, round(_length(diagnosis) / recording.period)), MOST_WINDOWS)
    begun = window_starts(windows, starts)
    naive = simulator.predict(diagnosis.naive, windows, begun.qpos, begun.qvel, begun.act)
    missed = np.nan_to_num((naive - windows.measured) / diagnosis.prepared.noise, nan=0.0, posinf=1e9)
    at = np.argsort(np.sum(missed**2, (1, 2)), kind="stable")[[len(naive) // 2]]
    chosen, found = windows.part(at), {"recorded": windows.measured[at[0]], "naive fit": naive[at[0]]}
    if diagnosis.best.placed:
        states = begun.qpos[at], begun.qvel[at], begun.act[at]
        found["improved"] = simulator.predict(diagnosis.best, chosen, *states)[0]
    seen = np.flatnonzero(np.isfinite(found["recorded"]).any(1))[-1] + 1
    time = (int(chosen.first[0]) + np.arange(seen)) * recording.period
    return Stretch(windows.names[int(chosen.runs[0])], {name: rows[:seen] for name, rows in found.items()}, time)


def _length(diagnosis: Diagnosis) -> float:
    own = diagnosis.recording.window or 1.0
    return float(np.clip(WINDOWS * own, *LENGTHS))


def _scenes(diagnosis: Diagnosis, part: Stretch) -> dict[str, Scene]:
    simulator, channels = diagnosis.simulator, diagnosis.recording.channels
    models = {"naive fit": diagnosis.naive, "improved": diagnosis.best}
    shown, axes, scenes = _shown(part.time), None, {}
    for name, values in part.readings.items():
        model = simulator.model(models[name]) if name in models else simulator.base
        qpos = configurations(model, channels, values)[shown]
        scenes[name] = scene_of(model, qpos, part.time[shown], axes)
        axes = scenes[name].axes
    return scenes


def _shown(time: np.ndarray) -> np.ndarray:
    return np.unique(np.linspace(0, len(time) - 1, min(FRAMES, len(time))).astype(int))


def _played(time: np.ndarray) -> float:
    return float(np.clip(np.ptp(time), *PLAYED))


def _shots(diagnosis: Diagnosis, scenes: dict[str, Scene], part: Stretch) -> Iterator[np.ndarray]:
    view = common_view([scenes["recorded"]], every=1)
    figure, tops, bottoms = set_up(view, list(scenes), SIZE[0])
    figure.set_dpi(SIZE[1])
    for ax, scene in zip(tops, scenes.values(), strict=True):
        draw_world(ax, scene, view)
        ax.add_patch(Rectangle((0, 0), 1, 1, transform=ax.transAxes, fill=False, edgecolor=FAINT))
    _signals(diagnosis, bottoms, part)
    canvas: Any = figure.canvas  # of Agg
    canvas.draw()
    figure.set_layout_engine("none")
    still = canvas.copy_from_bbox(figure.bbox)
    for step in range(len(scenes["recorded"].time)):
        canvas.restore_region(still)
        _act(tops, bottoms, scenes, step, view)
        yield np.asarray(canvas.buffer_rgba())[:, :, :3].copy()
    plt.close(figure)


def _signals(diagnosis: Diagnosis, axes: list[Axes], part: Stretch) -> None:
    readings, time = part.readings, part.time
    missed = ((readings["naive fit"] - readings["recorded"]) / diagnosis.prepared.noise) ** 2
    channel = int(np.argmax(np.nan_to_num(missed).sum(0)))  # the one that it predicts worst
    name = diagnosis.recording.channels[channel]
    unit = channel_unit(diagnosis.simulator.base, name)
    speed = np.ptp(time) / _played(time)
    pace = "" if abs(speed - 1) < 0.05 else f", {1 / speed:.1f} × slower" if speed < 1 else f", {speed:.1f} × faster"
    for ax, (model, values) in zip(axes, readings.items(), strict=True):
        ax.plot(time, readings["recorded"][:, channel], color=QUIET, linewidth=2, alpha=0.5)
        if model != "recorded":
            ax.plot(time, values[:, channel], color=COLOURS[model], linewidth=1.2, scaley=False)
        ax.set(xlim=(time[0], time[-1]))
        ax.xaxis.set_major_locator(MaxNLocator(2))
    axes[0].set_ylabel(f"{name} ({unit})" if unit else name)
    axes[len(axes) // 2].set_xlabel(f"time in the run (s){pace}")


def _act(tops: list[Axes], bottoms: list[Axes], scenes: dict[str, Scene], step: int, view: View) -> None:
    for ax, below, (name, scene) in zip(tops, bottoms, scenes.items(), strict=True):
        actors: list[tuple[Axes, Artist]] = []
        if name != "recorded":
            actors += draw_moving(ax, scenes["recorded"], step, INK, GHOST, view)
        actors += draw_moving(ax, scene, step, COLOURS[name], 0.85, view)
        actors.append((below, below.axvline(scene.time[step], color=INK, linewidth=1)))
        for stage, actor in actors:
            stage.draw_artist(actor)
            actor.remove()


def draw_moving(ax: Axes, scene: Scene, step: int, colour: str, alpha: float, view: View) -> list[tuple[Axes, Artist]]:
    """Draw what moves at one step, or dots in its place where it is too small to be seen; nothing where it has left."""
    places = scene.position[step][np.ix_(geoms(scene), scene.axes)]
    if np.abs(places - (view.low + view.high) / 2).max() > FAR * view.extent.max():
        return []
    shapes = [shape for geom in geoms(scene) if len(shape := outline(scene, geom, step))]
    middles = np.array([shape.mean(0) for shape in shapes])
    if max(np.ptp(shape, axis=0).max() for shape in shapes) < SMALL * view.extent.max():
        (dots,) = ax.plot(*middles.T, "o", color=colour, alpha=alpha, markersize=7, markeredgewidth=0)
        return [(ax, dots)]
    return [(ax, draw_bodies(ax, scene, step, to_rgb(colour), alpha))]
