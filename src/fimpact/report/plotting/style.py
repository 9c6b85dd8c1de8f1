"""How every picture looks: colours, type, axes in percent, labels at the end of lines, and stable files."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator, NullLocator

# Okabe-Ito colours; line style and marker tell the methods apart in black and white.
METHODS = {
    "fisher": ("designed (fisher)", "#0072B2", "-", "o"),
    "contact_implicit": ("contact-implicit (IPOPT)", "#882255", (0, (5, 1)), "P"),
    "uniform": ("uniform random", "#D55E00", "--", "s"),
    "contact_blind": ("contact-blind design", "#CC79A7", "-.", "v"),
    "best_of_n": ("best of n random", "#009E73", ":", "D"),
    "multisine": ("multisine", "#56B4E9", (0, (1, 1)), "^"),
}
STYLE: Any = {  # a dict of matplotlib's rcParams
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.6,
    "lines.markersize": 4.5,
    "hatch.linewidth": 0.5,
    "savefig.dpi": 200,
    "svg.hashsalt": "fimpact",
    "figure.constrained_layout.use": True,
}
WIDTH = 7.2  # inches: the text width of a page
LINE = 0.085  # height of a line of text as a share of a small panel


def save(figure: Figure, path: Path | str) -> None:
    """Write `figure` in the format of the suffix, the same bytes each time."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None} if str(path).endswith(".svg") else None)


def write(figure: Figure, stem: Path | str) -> None:
    """Write `figure` as `stem`.svg and `stem`.png, and close it."""
    for suffix in (".svg", ".png"):
        save(figure, f"{stem}{suffix}")
    plt.close(figure)


def log_ticks(axis: Axis, low: float, high: float, label) -> None:
    """Round ticks on a logarithmic axis, written by `label`."""
    set_ticks(axis, log_places(low, high), label)


def log_places(low: float, high: float, most: int = 7) -> list[float]:
    """Round multiples of powers of ten between `low` and `high`, the finest set that has no more than `most`; where
    that is none or one, round numbers."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    fine = 1, 1.1, 1.2, 1.3, 1.4, 1.5, 1.7, 2, 3, 5, 7
    for factors in (fine, (1, 1.5, 2, 3, 5, 7), (1, 2, 5), (1,)):
        places = [float(place) for place in np.outer(decades, factors).ravel() if low <= place <= high]
        if len(places) <= most:
            break
    if len(places) < 2:
        return [float(place) for place in MaxNLocator(4).tick_values(low, high) if low <= place <= high]
    return places


def set_ticks(axis: Axis, places: list[float], label) -> None:
    """Exactly these ticks, written by `label`."""
    axis.set_major_locator(FixedLocator(places))
    axis.set_major_formatter(FixedFormatter([label(place) for place in places]))
    axis.set_minor_locator(NullLocator())


def in_percent(share: float) -> str:
    """A tick's share in percent, with no more digits than it has."""
    return f"{100 * share:.4g} %".replace("-", "−")


def power(value: float) -> str:
    """A tick as a multiple of a power of ten."""
    exponent = np.floor(np.log10(value * 1.0001))
    factor = round(value / 10**exponent, 1)
    return rf"${factor:g} \times 10^{{{exponent:.0f}}}$" if factor > 1 else f"$10^{{{exponent:.0f}}}$"


def label_ends(ax: Axes, ends: list[tuple[float, float, str, str]]) -> None:
    """Write (x, y, text, colour) right of the axes at the height of each line's end, pushed apart where they meet.

    The limits of the axes must be final.
    """
    ax.get_ylim()  # autoscaling is lazy; the transforms below do not trigger it
    scale = ax.transScale + ax.transLimits
    placed = sorted((float(scale.transform((x, y))[1]), text, colour) for x, y, text, colour in ends)
    height = -np.inf
    for wanted, text, colour in placed:
        height = max(wanted, height + LINE)
        place: dict[str, Any] = {
            "xy": (1.0, height),
            "xycoords": "axes fraction",
            "xytext": (4, 0),
            "textcoords": "offset points",
        }
        ax.annotate(text, color=colour, va="center", annotation_clip=False, **place)
