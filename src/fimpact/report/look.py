"""How the pictures of a diagnosis look, on paper and in a page that may be dark: colours, type, one column wide."""

import re
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from fimpact.report.plotting.style import STYLE, save

# Okabe-Ito; ink, quiet and paper change places in a dark page.
INK, QUIET, FAINT, PAPER = "#1a1a1a", "#6f6f6f", "#dcdcdc", "#ffffff"
NAIVE, IMPROVED, RIVAL = "#D55E00", "#0072B2", "#9a9a9a"
COLOURS = tuple(colour.lower() for colour in (INK, QUIET, FAINT, PAPER, NAIVE, IMPROVED, RIVAL))
WIDTH = 3.75  # inches: a phone
LOOK: Any = {
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
