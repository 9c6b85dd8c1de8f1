"""Torque limits of servos: tried from what the motion needed, not from what a naive servo would give."""

from functools import cache

import numpy as np
import pytest
from recorded import record, waves

from fimpact.effects import EFFECTS
from fimpact.recordings import Recording
from fimpact.selection.explanation import explain
from fimpact.smoothing.candidates import at, needed_of_motors
from fimpact.smoothing.columns import motion_scales
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth

HELD = """<mujoco><option timestep="0.002"/><worldbody><body name="link"><joint name="j1" axis="0 1 0" damping="0.05"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.015" mass="0.5" contype="0" conaffinity="0"/></body></worldbody>
<actuator><position name="s1" joint="j1" kp="25" kv="0.6" forcerange="-4 4"/></actuator>
<sensor><jointpos name="q" joint="j1"/></sensor></mujoco>"""


@cache
def limited(limit: float) -> Recording:
    """A servo whose targets jump every sample, and that gives no more than `limit`, N m."""

    def hide(model):
        model.actuator_forcerange[0] = -limit, limit

    targets = waves(400, [0.7], 1)
    return record(HELD, ("q",), [targets], 2e-4, hide=hide, starts=[(targets[0], [0.0])])


@pytest.mark.parametrize("limit", [0.6, 0.9, 1.2])
def test_a_servo_that_gives_no_more_than_a_limit_is_told_with_it(limit):
    made = prepare(limited(limit))
    known = [EFFECTS[name] for name in ("saturation", "gain", "inertia", "gravity_scale", "servo_kp")]
    found = explain(made.track, made.begun, made.noise, known).final
    assert [law.name for law in found.placed] == ["saturation@s1"]
    assert found.placed[0].values["limit"] == pytest.approx(limit, rel=0.03)


def test_limits_are_tried_from_what_the_motion_needed_to_what_the_servo_would_give():
    made = prepare(limited(0.8))
    naive = smooth(made.track, made.begun, made.noise)
    scales, model = motion_scales(naive), made.track.model
    limits = [own.shapes["limit"] for own in at(EFFECTS["saturation"], "s1", model, scales)]
    assert limits == sorted(limits) and len(set(limits)) == 5 and limits[-1] < scales.summit[0]
    np.testing.assert_allclose(limits[0], scales.needed[0])


def test_the_short_peak_of_a_target_that_jumps_is_not_needed():
    made = prepare(limited(4.0))
    naive = smooth(made.track, made.begun, made.noise)
    own = needed_of_motors(made.track, made.track.model, made.track.ctrl[:, 0], naive.states, naive.tau)
    states, ctrl = naive.states, made.track.ctrl[:, 0, 0]
    at_once = np.quantile(np.abs(25 * (ctrl - states.qpos[:, 0]) - 0.6 * states.qvel[:, 0]), 0.99)
    assert 0.3 < own[0] < 0.8 * at_once
