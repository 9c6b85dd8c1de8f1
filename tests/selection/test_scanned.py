"""Values of a law that has no slope: all that differ are looked at, and chance counts them."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from recorded import record, waves

from fimpact.effects import EFFECTS
from fimpact.recordings import Recording
from fimpact.selection.forward import Search
from fimpact.selection.options import options
from fimpact.selection.scanned import scanned
from fimpact.smoothing.candidates import Candidate, candidates
from fimpact.smoothing.columns import motion_scales
from fimpact.smoothing.prepare import prepare

PERIOD = 0.02
XML = """<mujoco><option timestep="0.002"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
<body name="link"><joint name="pivot" axis="0 1 0" damping="0.3" armature="0.03"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.3"/></body></worldbody>
<actuator><position name="servo" joint="pivot" kp="100" kv="1"/></actuator>
<sensor><jointpos name="angle" joint="pivot"/></sensor></mujoco>"""


@cache
def rounded(step: float) -> Recording:
    """A servo that rounds its targets to steps, rad, of which the log knows nothing."""
    targets = waves(300, [0.4], 1, PERIOD)
    taken = step * np.round(targets / step) if step else targets
    found = record(XML, ["angle"], [taken], 3e-4, period=PERIOD, fine=100, starts=[(taken[0], np.zeros(1))])
    return replace(found, runs=(replace(found.runs[0], ctrl=targets),))


def search_of(recording: Recording) -> Search:
    made = prepare(recording)
    return Search(made.track, made.begun, made.noise, [EFFECTS["target_resolution"]], lambda line: None)


@pytest.mark.parametrize("step", [0.0037, 0.0123])
def test_a_step_of_targets_that_nobody_listed_is_found(step):
    search = search_of(rounded(step))
    (own,) = (c for c in search.candidates if c.among > 1)
    assert own.shapes["step"] == pytest.approx(step, rel=1e-2)
    assert search.round()
    (law,) = search.current.placed
    assert law.values["step"] == pytest.approx(step, rel=2e-3)


def test_the_best_of_many_steps_is_nothing_where_none_is_missing():
    search = search_of(rounded(0.0))
    assert [c for c in search.candidates if c.among > 1] and not search.round()


def test_the_steps_that_are_looked_at_are_as_many_as_differ():
    values = EFFECTS["target_resolution"].scan(0.002, 0.8)
    assert values[0] == pytest.approx(0.8) and values[-1] == pytest.approx(0.002, rel=1e-2)
    np.testing.assert_allclose(np.diff(0.8 / values), 0.25)  # of a step, at the farthest target


def test_what_readings_cannot_show_is_not_scanned():
    made = prepare(rounded(0.0))
    track, naive = made.track, made.naive
    listed = candidates([EFFECTS["target_resolution"]], track, motion_scales(naive))
    loud = replace(naive, levels=replace(naive.levels, reading=np.array([1.0])))
    assert scanned(naive, listed) and not scanned(loud, listed)


def test_quiet_readings_do_not_make_a_scan_endless():
    naive = prepare(rounded(0.0)).naive
    listed = candidates([EFFECTS["target_resolution"]], naive.track, motion_scales(naive))
    quiet = replace(naive, levels=replace(naive.levels, reading=np.array([1e-9])))
    assert scanned(quiet, listed)[0].among < 10_000


def test_the_best_of_many_is_no_member_of_a_class():
    """What fits best of many at each of two servos fits nothing by being two."""
    second = '<body name="next"><joint name="turn" axis="0 1 0"/><geom size="0.02" mass="0.1"/></body></worldbody>'
    servo = '<position name="other" joint="turn" kp="100" kv="1"/></actuator>'
    model = mujoco.MjModel.from_xml_string(XML.replace("</worldbody>", second, 1).replace("</actuator>", servo, 1))
    effect = EFFECTS["target_resolution"]
    listed = [
        Candidate(effect, site, {"step": 0.01}, ("step",), (1.0,), (True,), {}, {}, {}) for site in ("servo", "other")
    ]
    many = [replace(own, among=1000) for own in listed]
    found = [option.members for option in options(model, ["angle"], [*listed, *many])]
    assert (0, 1) in found
    assert [members for members in found if {2, 3} & set(members)] == [(2,), (3,)]
