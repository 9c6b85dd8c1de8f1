"""No stamps are true to the microsecond: how late each run's readings are is told by nobody, and asks for nothing."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from recorded import BALL, ROD, record

from fimpact.deciding import STAMPED
from fimpact.recordings import Recording, Unknown
from fimpact.smoothing.dynamics import linear
from fimpact.smoothing.prepare import prepare

NOISE = 1e-5
LATE = (0.9, -0.6)  # of what stamps may be late, by run


def rod(late: tuple[float, ...] = (0.0, 0.0)) -> Recording:
    """A rod under a motor whose mass is asked for, with readings that are so late."""
    runs = [np.random.default_rng(i).uniform(-0.5, 0.5, (40, 1)).repeat(5, 0) for i in range(2)]  # torques that jump
    own = record(ROD, ("angle",), runs, NOISE, unknowns=(Unknown("mass", "rod", 0.3),))
    clocks = zip(own.runs, late, strict=True)
    shown = [replace(r, measured=r.measured - by * STAMPED * np.gradient(r.measured, axis=0)) for r, by in clocks]
    return replace(own, runs=tuple(replace(run, held_out=False) for run in shown))


def missing(recording: Recording) -> float:
    """Level of the missing force, N m."""
    return float(prepare(recording).naive.levels.forces.max())


def test_a_late_clock_leaves_no_force_missing():
    told = missing(rod(LATE))
    with patch.object(linear, "rates", lambda track, base: None):
        untold = missing(rod(LATE))
    assert untold > 20 * told


def test_what_a_late_clock_reads_is_how_fast_readings_move():
    found = prepare(rod()).naive
    rate, read = found.linear.reads[:, 0, -2], found.linear.base.readings[:, 0]
    inner = ~found.track.last
    assert rate[inner] == pytest.approx(STAMPED * np.diff(read, append=0.0)[inner])
    assert np.all(found.linear.advance[:, -1, -2] == 1.0) and not found.linear.advance[:, :-1, -2].any()
    assert found.states.size == 2  # nothing is moved by it


def test_where_nothing_is_commanded_no_clock_is_late():
    starts = [(np.array([0, 0, 0.3, 1, 0, 0, 0.0]), np.zeros(6))]
    own = record(BALL, ("place[0]", "place[2]"), [np.zeros((60, 0))], 1e-3, starts=starts)
    found = prepare(own).naive
    assert found.linear.advance.shape[1] == found.states.size
