"""Pictures that belong to whoever asked for them."""

from collections.abc import Callable
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from fimpact.report.look import draw


def drawn(picture: Callable[..., Figure], *args: Any) -> Figure:
    """A picture in the style of the page, apart from those of pyplot: a notebook shows it once, as what a cell returns.

    Args:
        args: of the picture.
    """
    figure = draw(picture, *args)
    plt.close(figure)
    return figure
