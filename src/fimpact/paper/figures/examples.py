"""One designed experiment beside a random one: a stroboscopic picture with contact forces, and a film."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from fimpact.paper.figures.replay import replay
from fimpact.paper.systems import System, make_system
from fimpact.report.plotting.gif import write_gif
from fimpact.report.plotting.scene import Scene
from fimpact.report.plotting.stroboscopic import (
    BODY,
    CHANNELS,
    FORCE,
    View,
    common_view,
    draw_bodies,
    draw_forces,
    draw_scale,
    draw_signal,
    draw_world,
    set_up,
)
from fimpact.report.plotting.style import STYLE, WIDTH, save

POSES, PEAKS, ARROWS = 9, 2, 8  # drawn of one experiment in a stroboscopic picture
FRAMES, RATE = 80, 20  # of the film, and per second
FILM = (6.4, 100)  # inches, dots per inch


def draw(config: dict, system: str, designed: Path | str, random: Path | str, outputs: dict[str, Path | str]) -> None:
    """Draw one designed experiment of `system` beside the random one of the same seed and round.

    Args:
        config: a configuration with the table of `system` under `systems`.
        designed, random: NPZ files with `designs` (seeds, rounds, d), `seeds` (seeds,) and `truth` (seeds, p); of the
            first seed, the round is taken in which the designed experiment stays in contact longest.
        outputs: files to write by format: svg, png, gif.
    """
    made = make_system(system, config["systems"][system])
    scenes = choose(made, designed, random)
    for kind, path in outputs.items():
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        with plt.rc_context(STYLE):
            film(made, scenes, path) if kind == "gif" else picture(made, scenes, path)


def choose(system: System, designed: Path | str, random: Path | str) -> dict[str, Scene]:
    """The two scenes to show, by the name to show them under."""
    with np.load(designed) as ours, np.load(random) as theirs:
        theta, seed = ours["truth"][0], ours["seeds"][0]
        others = theirs["designs"][list(theirs["seeds"]).index(seed)]
        scenes = [replay(system, theta, design) for design in ours["designs"][0]]
    longest = int(np.argmax([scene.touching.sum() for scene in scenes]))
    about = f"seed {seed}, experiment {longest + 1}"
    return {
        f"designed: {about}": scenes[longest],
        f"uniform random: {about}": replay(system, theta, others[longest]),
    }


def picture(system: System, scenes: dict[str, Scene], path: Path | str) -> None:
    """Write the stroboscopic picture: dark is late, arrows are contact forces, dots below mark the poses in time."""
    view, figure, tops, bottoms = _set_up(system, scenes, WIDTH)
    for ax, below, scene in zip(tops, bottoms, scenes.values(), strict=True):
        _strobe(ax, below, scene)
        draw_forces(ax, scene, _thin(np.flatnonzero(scene.touching), ARROWS), view)
    save(figure, path)
    plt.close(figure)


def film(system: System, scenes: dict[str, Scene], path: Path | str) -> None:
    """Write both scenes side by side as a GIF, slowed down to four seconds."""
    inks = ["black", BODY, FORCE, *(colour for colour, _ in CHANNELS)]
    write_gif(_shots(system, scenes), inks, RATE, path)


def _strobe(ax: Axes, below: Axes, scene: Scene) -> None:
    steps = _moments(scene)
    tints = plt.colormaps["viridis_r"](np.linspace(0.12, 1.0, len(scene.time)))
    for step in steps:
        draw_bodies(ax, scene, step, tints[step], 0.55)
    below.scatter(scene.time[steps], np.zeros(len(steps)), c=tints[steps], s=24, zorder=5, clip_on=False,
                  transform=below.get_xaxis_transform(), edgecolors="0.3", linewidths=0.4)  # fmt: skip


def _moments(scene: Scene) -> np.ndarray:
    # Evenly spaced in time, so that distance shows speed, and the peaks of the hardest contacts.
    even = np.linspace(0, len(scene.time) - 1, POSES).astype(int)
    peaks = [first + np.argmax(scene.force[first:last]) for first, last in scene.episodes]
    hardest = sorted(peaks, key=lambda step: -scene.force[step])[:PEAKS]
    return np.unique(np.r_[even, np.array(hardest, int)])


def _thin(steps: np.ndarray, most: int) -> np.ndarray:
    return steps[np.unique(np.linspace(0, len(steps) - 1, min(most, len(steps))).astype(int))]


def _set_up(system: System, scenes: dict[str, Scene], width: float) -> tuple[View, Figure, list[Axes], list[Axes]]:
    # What picture and film share: everything that does not move.
    view = common_view(list(scenes.values()))
    titles = [f"{name}\n{s.touching.sum()} of {len(s.time)} steps in contact" for name, s in scenes.items()]
    figure, tops, bottoms = set_up(view, titles, width)
    for ax, below, scene in zip(tops, bottoms, scenes.values(), strict=True):
        draw_world(ax, scene, view)
        draw_scale(ax, draw_forces(ax, scene, [], view), view)
        draw_signal(below, system.sensor.channels, scene, view)
    bottoms[0].set_ylabel(f"{system.sensor.name}\n({system.sensor.unit.replace('^2', '²')})")
    bottoms[0].legend(frameon=False, fontsize=8, handlelength=1.8)
    return view, figure, tops, bottoms


def _shots(system: System, scenes: dict[str, Scene]) -> Iterator[np.ndarray]:
    view, figure, tops, bottoms = _set_up(system, scenes, FILM[0])
    both = list(scenes.values())
    figure.set_dpi(FILM[1])
    for below, scene in zip(bottoms, both, strict=True):
        below.set_xlabel(f"time (s), shown {len(_beats(both)) / RATE / scene.time[-1]:.2g} × slower")
    for step in _beats(both):
        yield _shoot(figure, tops, bottoms, both, step, view)
    plt.close(figure)


def _beats(scenes: list[Scene]) -> list[int]:
    # Of the steps that fall to one frame, the one with the strongest force: no impact is missed between frames.
    force = np.sum([scene.force for scene in scenes], axis=0)
    return [int(beat[np.argmax(force[beat])]) for beat in np.array_split(np.arange(len(force)), FRAMES) if len(beat)]


def _shoot(figure: Figure, tops, bottoms, scenes: list[Scene], step: int, view: View) -> np.ndarray:
    actors = []
    for ax, below, scene in zip(tops, bottoms, scenes, strict=True):
        actors.append(draw_bodies(ax, scene, step, to_rgb(BODY), 1.0))
        actors.append(draw_forces(ax, scene, [step], view))
        actors.append(below.axvline(scene.time[step], color="black", linewidth=1))
    canvas: Any = figure.canvas  # of Agg
    canvas.draw()
    figure.set_layout_engine("none")
    shot = np.asarray(canvas.buffer_rgba())[:, :, :3].copy()
    for actor in actors:
        actor.remove()
    return shot
