"""Where a refit begins."""

import pytest

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.selection.refit_start import in_midst


def _rubbed(sizes, carried):
    placed = [Placed(EFFECTS["viscous"], f"joint_{i}", {"damping": size}) for i, size in enumerate(sizes)]
    moved = in_midst(placed, [{"damping": load} for load in carried])
    return [law.values["damping"] for law in moved]


@pytest.mark.parametrize(
    ("sizes", "carried", "moved"),
    [
        ((1.0, 1.2, 0.01), (1, 1, 1), (1.0, 1.2, 1.0)),  # alike joints: one has an optimum of its own, far below
        ((200.0, 220.0, 12.0), (100, 100, 6), (200.0, 220.0, 12.0)),  # a wrist has a smaller gear, and carries less
        ((1.0, 1.2, 5.0), (1, 1, 1), (1.0, 1.2, 5.0)),  # far above is no optimum of a light joint
        ((1.0, 1.2, 0.8), (1, 1, 10), (1.0, 1.2, 0.8)),  # as it is, it is like the others
        (
            (1.0, 1.2, 1.1, 0.1, 0.11),
            (1,) * 5,
            (1.0, 1.2, 1.1, 0.1, 0.11),
        ),  # two that are alike have a gear of their own
        ((1.0, 1.2, 1.1, 1e-5, 1e-5), (1,) * 5, (1.0, 1.2, 1.1, 1.0, 1.0)),  # two that are nothing are nothing alike
    ],
)
def test_what_is_far_below_its_like_begins_in_their_midst(sizes, carried, moved):
    assert _rubbed(sizes, carried) == list(moved)
