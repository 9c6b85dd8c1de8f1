"""Shots of a film written as a GIF, in few colours and, where asked, in few bytes."""

from collections.abc import Iterable, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image

SHADES = 12  # of each ink, down to white
PAUSE = 1500  # ms at the end
FEWEST = 10  # frames, below which a film is none


def write_gif(
    shots: Iterable[np.ndarray], inks: Sequence[str], rate: float, path: Path | str, most: int | None = None
) -> None:
    """Write `shots`, (height, width, 3) in 8 bits each, as a GIF that loops.

    Args:
        inks: the colours that were drawn with; each fades to white. At most 21.
        rate: shots per second.
        most: bytes; every other shot is left out until the file is no larger, as long as `FEWEST` are left.
    """
    palette = _palette(inks)
    frames = [Image.fromarray(shot).quantize(palette=palette, dither=Image.Dither.NONE) for shot in shots]
    content = _encoded(frames, 1000 / rate)
    while most and len(content) > most and len(frames) >= 2 * FEWEST:
        frames, rate = frames[::2], rate / 2
        content = _encoded(frames, 1000 / rate)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_bytes(content)


def _encoded(frames: list[Image.Image], pause: float) -> bytes:
    out, pauses = BytesIO(), [round(pause)] * (len(frames) - 1) + [PAUSE]
    frames[0].save(out, format="GIF", save_all=True, append_images=frames[1:], duration=pauses, loop=0, optimize=False)
    return out.getvalue()


def _palette(inks: Sequence[str]) -> Image.Image:
    # One found by counting pixels would lose what is thin, such as arrows.
    fades = [1 - (1 - np.array(to_rgb(ink))) * share for ink in inks for share in np.linspace(0, 1, SHADES)]
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.rint(255 * np.array(fades)).astype(int).ravel().tolist())
    return palette
