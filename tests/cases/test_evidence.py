"""Units that values tell, where only one fits."""

import numpy as np
import pytest

from fimpact.cases.drafting.evidence import alike, position_unit, share_unit, time_unit

WAVE = np.sin(np.linspace(0, 7, 500))
NARROW, WIDE = (-0.6, 0.6), (-2.8, 2.8)  # rad
POSITIONS = {  # amplitude and range of each joint -> unit
    "radians": ([(0.5, NARROW), (2.0, WIDE)], "rad"),
    "degrees, beyond 100": ([(30, NARROW), (150, WIDE)], "deg"),
    "a share, beyond what the narrow joint has in degrees": ([(90, NARROW), (90, WIDE)], "-100..100"),
    "degrees or a share": ([(30, NARROW), (90, WIDE)], "?"),
    "radians or degrees of joints that hardly move": ([(0.01, NARROW), (0.01, WIDE)], "?"),
    "nothing": ([(400, NARROW), (400, WIDE)], "?"),
    "joints without a range": ([(0.5, None)], "?"),
}


@pytest.mark.parametrize("name", POSITIONS)
def test_the_unit_of_positions_is_the_one_that_fits_ranges(name):
    joints, expected = POSITIONS[name]
    assert position_unit([(size * WAVE, limits) for size, limits in joints], "rad")[0] == expected


def test_a_gripper_is_open_by_percent_where_degrees_leave_its_range():
    opening = 50 * (1 + WAVE)
    assert share_unit([(opening, (0.0, 1.0))], "rad")[0] == "0..100"
    assert share_unit([(opening, (0.0, 1.8))], "rad")[0] == "?"


@pytest.mark.parametrize(
    ("first", "step", "expected"),
    [(0, 0.02, "s"), (0, 20, "ms"), (5e5, 1e3, "us"), (0, 1e6, "ns"), (0, 1, "?"), (0, 0, "?"), (1.764e12, 20, "ms")],
)
def test_the_unit_of_a_time_is_told_by_its_steps(first, step, expected):
    assert time_unit(first + step * np.arange(1000.0))[0] == expected


def test_a_joint_that_follows_the_command_of_another_is_told():
    times = np.arange(500.0)
    other = np.cos(np.linspace(0, 17, 500))
    commands = {"a": (times - 0.5, WAVE), "b": (times - 0.5, other)}
    own, better = alike(commands, {"a": (times, WAVE), "b": (times, other)})
    assert min(own.values()) > 0.99 and not better
    assert alike(commands, {"a": (times, other), "b": (times, WAVE)})[1] == {"a": "b", "b": "a"}
