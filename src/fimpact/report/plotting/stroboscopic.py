"""Drawing one experiment with matplotlib: bodies, surfaces, force arrows, and the signal below."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.quiver import Quiver
from matplotlib.ticker import MaxNLocator

from fimpact.report.plotting.scene import Scene, moves, outline, surfaces

FORCE, BODY = "#D55E00", "#4477AA"
CHANNELS = (("#0072B2", "-"), ("#000000", "--"), ("#009E73", ":"), ("#CC79A7", "-."))
REACH = 0.22  # length of the longest force arrow, as a share of the motion's extent
SLAB = 0.03  # drawn thickness of a surface, likewise
SHAPES = (0.7, 1.4)  # least and greatest height of a picture per width


@dataclass(frozen=True)
class View:
    """What pictures side by side share: corners (m), newtons per metre of arrow, and the signal's limits."""

    low: np.ndarray
    high: np.ndarray
    newtons: float
    signal: tuple[float, float]

    @property
    def extent(self) -> np.ndarray:
        """Width and height, m."""
        return self.high - self.low


def common_view(scenes: list[Scene], every: int = 4) -> View:
    """The smallest view of the motion (one step in `every`), the surfaces and the forces of all scenes."""
    seen = [outline(s, g, t) for s in scenes for g in geoms(s) for t in range(0, len(s.time), every)]
    points = np.concatenate([*seen, *(s.pivots for s in scenes)])
    middle = points.mean(0)
    feet = [middle - ((middle - at) @ normal) * normal for at, normal in surfaces(scenes[0])]
    points = np.concatenate([points, np.reshape(feet, (-1, 2))])
    size = np.ptp(points, axis=0).max()
    newtons = max(scene.force.max() for scene in scenes) / (REACH * size) or 1.0
    tails = [step[:, 0] - step[:, 1] / newtons for scene in scenes for step in scene.contacts]
    points = np.concatenate([points, *tails])
    low, high = _widen(points.min(0) - 2 * SLAB * size, points.max(0) + 2 * SLAB * size)
    values = np.concatenate([scene.measurement for scene in scenes])
    margin = 0.06 * np.ptp(values) or 1.0
    return View(low, high, newtons, (values.min() - margin, values.max() + margin))


def geoms(scene: Scene, moving: bool = True) -> list[int]:
    """Numbers of the geoms that move, or of those that do not."""
    return [geom for geom in range(scene.model.ngeom) if moves(scene.model, geom) == moving]


def set_up(view: View, names: Iterable[str], width: float) -> tuple[Figure, list[Axes], list[Axes]]:
    """A figure of `width` inches with a picture and a signal for every name, side by side."""
    names = list(names)
    # The label left of the signals takes its share of the width.
    height = (width - 0.9) / len(names) * view.extent[1] / view.extent[0]
    figure, axes = plt.subplots(
        2,
        len(names),
        figsize=(width, height + 2.2),
        squeeze=False,
        height_ratios=[height, 1.4],
        sharex="row",
        sharey="row",
    )
    for ax, name in zip(axes[0], names, strict=True):
        ax.set(title=name, aspect="equal", xlim=(view.low[0], view.high[0]), ylim=(view.low[1], view.high[1]))
        ax.set_axis_off()
    return figure, list(axes[0]), list(axes[1])


def draw_world(ax: Axes, scene: Scene, view: View) -> None:
    """Surfaces as hatched slabs, fixed geoms in grey, and the pivots that hold the robot."""
    size = view.extent.max()
    for at, normal in surfaces(scene):
        along = 2 * size * np.array([-normal[1], normal[0]])
        start = at + ((view.low + view.high) / 2 - at) @ along / (along @ along) * along
        back = SLAB * size * normal
        ax.add_patch(Polygon([start - along, start + along, start + along - back, start - along - back],
                             facecolor="0.9", edgecolor="0.55", hatch="////", linewidth=0))  # fmt: skip
        ax.plot(*np.transpose([start - along, start + along]), color="0.2", linewidth=1.2, scalex=False, scaley=False)
    ax.add_collection(PolyCollection([outline(scene, g, 0) for g in geoms(scene, False)], facecolor="0.8"))
    ax.plot(*scene.pivots.T, "o", color="black", markersize=4, zorder=4)


def draw_bodies(ax: Axes, scene: Scene, step: int, tint, alpha: float) -> PolyCollection:
    """What moves, at one step."""
    shapes = [outline(scene, geom, step) for geom in geoms(scene)]
    edge = (*np.array(tint[:3]) * 0.6, 1.0)
    face = (*tint[:3], alpha)
    drawn = PolyCollection(shapes, facecolor=face, edgecolor=edge, linewidth=0.5)
    ax.add_collection(drawn)
    return drawn


def draw_forces(ax: Axes, scene: Scene, steps: Iterable[int], view: View) -> Quiver:
    """Contact forces on what moves, as arrows that end where they act; to the scale of `view`."""
    arrows = np.concatenate([np.zeros((0, 2, 2)), *(scene.contacts[step] for step in steps)])
    return ax.quiver(*arrows[:, 0].T, *arrows[:, 1].T, angles="xy", scale_units="xy", scale=view.newtons, pivot="tip",
                     color=FORCE, width=0.006, headwidth=3.5, headlength=4, headaxislength=3.6, zorder=6)  # fmt: skip


def draw_scale(ax: Axes, arrows: Quiver, view: View) -> None:
    """The length of a round force, beside the title."""
    longest = view.newtons * view.extent[0] / 8
    newtons = max(n for n in np.outer(10.0 ** np.arange(-6, 7), (1, 2, 5)).ravel() if n <= longest)
    ax.quiverkey(arrows, 0.86, 1.03, newtons, f"{newtons:g} N", labelpos="W", color=FORCE)


def draw_signal(ax: Axes, channels: Sequence[str], scene: Scene, view: View) -> None:
    """What the sensor shows over time, channel by channel, without noise; contact is shaded."""
    timestep = scene.model.opt.timestep
    spans = [(first * timestep, (last - first) * timestep) for first, last in scene.episodes]
    ax.broken_barh(spans, (0, 1), color="0.88", linewidth=0, transform=ax.get_xaxis_transform())
    for channel, values, (colour, line) in zip(channels, scene.measurement.T, CHANNELS, strict=False):
        ax.plot(scene.time, values, color=colour, linestyle=line, linewidth=1.2, label=channel.replace("_", " "))
    ax.set(xlabel="time (s)", ylim=view.signal, xlim=(0, scene.time[-1] + timestep))
    ax.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))


def _widen(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # Neither a ribbon nor a column: the shorter side grows until the picture has a shape that fits a page.
    width, height = high - low
    grown = np.array([max(width, height / SHAPES[1]), max(height, width * SHAPES[0])])
    middle = (low + high) / 2
    return middle - grown / 2, middle + grown / 2
