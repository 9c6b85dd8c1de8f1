"""Models of windows, and windows that are simulated at once: quicker, and never another answer."""

import copy

import mujoco
import numpy as np
import pytest
from planted import record

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch import problem
from fimpact.mismatch.coordinates import NOTHING
from fimpact.mismatch.copies import Copies
from fimpact.mismatch.judge import bench
from fimpact.mismatch.simulate import Hypothesis

XML = """<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="ball"><freejoint/><geom name="ball" size="0.1"/></body>
  </worldbody>
  <contact><pair name="touch" geom1="floor" geom2="ball"/></contact>
</mujoco>"""


def test_copies_follow_the_model_they_are_of():
    first, made = mujoco.MjModel.from_xml_string(XML), Copies()
    second = copy.copy(first)
    second.body_mass[1], second.pair_friction[0, 0], second.opt.gravity[0] = 2.0, 0.3, 1.0
    second.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    second.stat.meaninertia = 5.0
    mujoco.mj_setConst(second, mujoco.MjData(second))
    old = made.of(first, 2)
    found = made.of(second, 3)
    assert found[:2] == old and made.of(second, 1) == found[:1]
    for own in found:
        assert own.body_mass[1] == 2.0 and own.pair_friction[0, 0] == 0.3 and own.opt.gravity[0] == 1.0
        assert own.opt.disableflags == second.opt.disableflags != first.opt.disableflags
        assert own.stat.meaninertia == 5.0 != first.stat.meaninertia
        np.testing.assert_array_equal(own.body_invweight0, second.body_invweight0)
    assert made.of(first, 1)[0].body_mass[1] == first.body_mass[1]


@pytest.fixture(scope="module")
def training():
    return bench(record(3, lambda model: None)).training


@pytest.mark.parametrize("name", [None, "stribeck", "backlash", "quadratic_drag"])
def test_windows_that_begin_together_are_those_that_begin_alone(training, name, monkeypatch):
    simulator, placed = training.simulator, ()
    if name:
        effect = EFFECTS[name]
        site = effect.sites(simulator.base, simulator.recording.channels)[-1]
        some = {c.name: 0.01 for c in effect.coefficients}
        placed = (Placed(effect, site, some),)
    found = []
    for theta in (simulator.theta, 1.1 * simulator.theta):  # the second finds models as the first has left them
        for together in (1, 256):
            monkeypatch.setattr(problem, "TOGETHER", together)
            point = training.evaluate(Hypothesis(theta, placed), *training.starts, NOTHING)
            found.append(training.starts_at(point)[1])
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[2], found[3])
    assert not np.array_equal(found[0], found[2])
