"""The film of a diagnosis: recorded, naive and improved motion side by side, drawn without a graphics card."""

from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from fimpact.gif import write_gif
from fimpact.mismatch.diagnose import Diagnosis
from fimpact.motion import configurations, readings_of, scene_of, stretch, undrawable
from fimpact.report_figures import shown_run, worst_channels
from fimpact.report_look import FAINT, IMPROVED, INK, LOOK, NAIVE, QUIET
from fimpact.scene import Scene, outline
from fimpact.stage import View, common_view, draw_bodies, draw_world, geoms, set_up
from fimpact.units import channel_unit

FRAMES = 60
PLAYED = (3.0, 6.0)  # s: slower or faster than it was, if need be
SIZE = (4.8, 135)  # inches, dots per inch: type that can be read on a phone
MOST = 1_500_000  # bytes, which a page carries a third more of
GHOST = 0.18  # opacity of what was recorded behind a model
SMALL = 0.03  # share of the picture below which a body is marked by a dot
FAR = 5.0  # pictures away, where nothing is drawn any more
COLOURS = {"recorded": QUIET, "naive fit": NAIVE, "improved": IMPROVED}


def draw_film(diagnosis: Diagnosis, path: Path | str) -> str:
    """Write the film of one held-out stretch as a GIF.

    Returns:
        Why there is none, in one sentence; empty where it was written.
    """
    simulator, recording = diagnosis.bench.held_out.simulator, diagnosis.recording
    if reason := undrawable(simulator.base, recording.channels):
        return reason
    readings, time = _readings(diagnosis)
    scenes = _scenes(diagnosis, readings, time)
    with plt.rc_context(LOOK):
        shots = list(_shots(diagnosis, scenes, readings, time))
    write_gif(shots, [INK, *COLOURS.values()], FRAMES / _played(time), path, MOST)
    return ""


def _readings(diagnosis: Diagnosis) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """What was recorded and what the models say of it, (T, ny) by name, and the time in the run, (T,) s."""
    part, naming = stretch(diagnosis, shown_run(diagnosis)), diagnosis.naming
    rows = slice(part.first, part.first + part.samples)
    models = {"naive fit": naming.naive} | ({"improved": naming.best} if naming.best.placed else {})
    found = {"recorded": diagnosis.recording.held_out[part.run].measured[rows]}
    found |= {name: readings_of(diagnosis, explanation, part) for name, explanation in models.items()}
    return found, np.arange(part.first, part.first + part.samples) * diagnosis.recording.period


def _scenes(diagnosis: Diagnosis, readings: dict[str, np.ndarray], time: np.ndarray) -> dict[str, Scene]:
    simulator, channels = diagnosis.bench.held_out.simulator, diagnosis.recording.channels
    points = {"naive fit": diagnosis.naming.naive, "improved": diagnosis.naming.best}
    shown, axes, scenes = _shown(time), None, {}
    for name, values in readings.items():
        model = simulator.model(points[name].judged.point.hypothesis) if name in points else simulator.base
        qpos = configurations(model, channels, values)[shown]
        scenes[name] = scene_of(model, qpos, time[shown], axes)
        axes = scenes[name].axes
    return scenes


def _shown(time: np.ndarray) -> np.ndarray:
    return np.unique(np.linspace(0, len(time) - 1, min(FRAMES, len(time))).astype(int))


def _played(time: np.ndarray) -> float:
    return float(np.clip(np.ptp(time), *PLAYED))


def _shots(diagnosis: Diagnosis, scenes: dict[str, Scene], readings, time) -> Iterator[np.ndarray]:
    view = common_view([scenes["recorded"]], every=1)
    figure, tops, bottoms = set_up(view, list(scenes), SIZE[0])
    figure.set_dpi(SIZE[1])
    for ax, scene in zip(tops, scenes.values(), strict=True):
        draw_world(ax, scene, view)
        ax.add_patch(Rectangle((0, 0), 1, 1, transform=ax.transAxes, fill=False, edgecolor=FAINT))
    _signals(diagnosis, bottoms, readings, time)
    figure.canvas.draw()
    figure.set_layout_engine("none")
    still = figure.canvas.copy_from_bbox(figure.bbox)
    for step in range(len(scenes["recorded"].time)):
        figure.canvas.restore_region(still)
        _act(tops, bottoms, scenes, step, view)
        yield np.asarray(figure.canvas.buffer_rgba())[:, :, :3].copy()
    plt.close(figure)


def _signals(diagnosis: Diagnosis, axes: list[Axes], readings: dict[str, np.ndarray], time: np.ndarray) -> None:
    channel = worst_channels(diagnosis)[0]
    name = diagnosis.recording.channels[channel]
    unit = channel_unit(diagnosis.bench.training.simulator.base, name)
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
            actors += _bodies(ax, scenes["recorded"], step, INK, GHOST, view)
        actors += _bodies(ax, scene, step, COLOURS[name], 0.85, view)
        actors.append((below, below.axvline(scene.time[step], color=INK, linewidth=1)))
        for stage, actor in actors:
            stage.draw_artist(actor)
            actor.remove()


def _bodies(ax: Axes, scene: Scene, step: int, colour: str, alpha: float, view: View) -> list[tuple[Axes, Artist]]:
    """What moves at one step, or dots in its place where it is too small to be seen; nothing where it has left."""
    places = scene.position[step][np.ix_(geoms(scene), scene.axes)]
    if np.abs(places - (view.low + view.high) / 2).max() > FAR * view.extent.max():
        return []
    shapes = [shape for geom in geoms(scene) if len(shape := outline(scene, geom, step))]
    middles = np.array([shape.mean(0) for shape in shapes])
    if max(np.ptp(shape, axis=0).max() for shape in shapes) < SMALL * view.extent.max():
        (dots,) = ax.plot(*middles.T, "o", color=colour, alpha=alpha, markersize=7, markeredgewidth=0)
        return [(ax, dots)]
    return [(ax, draw_bodies(ax, scene, step, to_rgb(colour), alpha))]
