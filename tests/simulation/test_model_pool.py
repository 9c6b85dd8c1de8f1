"""Models of windows follow the model that they are of; finer steps of it are the same model."""

import copy

import mujoco
import numpy as np
import pytest

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.recordings import Recording, Run, Unknown
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.model_pool import ModelPool
from fimpact.simulation.simulator import Simulator
from fimpact.simulation.windows import cut

XML = """<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="ball"><freejoint/><geom name="ball" size="0.1"/></body>
  </worldbody>
  <contact><pair name="touch" geom1="floor" geom2="ball"/></contact>
</mujoco>"""
BOX = """<mujoco><option timestep="0.002"/><worldbody><geom name="table" type="plane" size="1 1 0.1"/>
<body name="box" pos="0 0 0.05"><joint name="up" type="slide" axis="0 0 1"/>
<geom name="box" type="box" size="0.05 0.05 0.05" mass="0.4"/></body></worldbody>
<contact><pair name="box_table" geom1="box" geom2="table"/></contact>
<sensor><jointpos name="z" joint="up"/></sensor></mujoco>"""
PERIOD, SAMPLES = 0.01, 30


def test_models_follow_the_one_they_are_of():
    first, pool = mujoco.MjModel.from_xml_string(XML), ModelPool()
    second = copy.copy(first)
    second.body_mass[1], second.pair_friction[0, 0], second.opt.gravity[0] = 2.0, 0.3, 1.0
    second.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    second.stat.meaninertia = 5.0
    mujoco.mj_setConst(second, mujoco.MjData(second))
    old = pool.for_windows(first, 2)
    found = pool.for_windows(second, 3)
    assert found[:2] == old and pool.for_windows(second, 1) == found[:1]
    for own in found:
        assert own.body_mass[1] == 2.0 and own.pair_friction[0, 0] == 0.3 and own.opt.gravity[0] == 1.0
        assert own.opt.disableflags == second.opt.disableflags != first.opt.disableflags
        assert own.stat.meaninertia == 5.0 != first.stat.meaninertia
        np.testing.assert_array_equal(own.body_invweight0, second.body_invweight0)
    assert pool.for_windows(first, 1)[0].body_mass[1] == first.body_mass[1]


@pytest.fixture(scope="module")
def boxed() -> Recording:
    run = Run("run", np.zeros((SAMPLES, 0)), np.zeros((SAMPLES, 1)), False)
    unknowns = (Unknown("pair_friction", "box_table"),)
    return Recording(BOX, ".", PERIOD, ("z",), (run,), unknowns, np.ones(1), np.full(2, np.inf), 0.0)


def test_finer_steps_do_not_simulate_a_quicker_contact(boxed):
    """MuJoCo slows a contact that its time step cannot follow; half the step would be another model."""
    made = []
    for refine in (1, 2, 4):
        simulator = Simulator(boxed, refine)
        damped = Placed(EFFECTS["contact_damping"], "box_table", {"change": 70.0})
        made.append(simulator.model(Hypothesis(simulator.theta, (damped,))))
    assert [m.opt.timestep for m in made] == pytest.approx([0.002, 0.001, 0.0005])
    assert [m.pair_solref[0, 0] for m in made] == pytest.approx([0.004] * 3)


def test_what_is_read_at_another_time_is_read_between_steps(boxed):
    """A box lands between two samples; where nothing is commanded, a clock that drifts sees what no sample does."""
    simulator, windows = Simulator(boxed), cut(boxed.runs, 0)
    drift = Placed(EFFECTS["clock_drift"], "all", {"rate": 0.05})
    start = np.array([[0.01]]), np.zeros((1, 1))
    plain = Hypothesis(simulator.theta)
    model, path = simulator.model(plain), []
    data = mujoco.MjData(model)
    data.qpos[:] = 0.01
    for _ in range(SAMPLES * simulator.substeps):
        path.append(data.qpos[0])
        mujoco.mj_step(model, data)
    step = simulator.base.opt.timestep
    exact = np.interp(0.95 * PERIOD * np.arange(SAMPLES), step * np.arange(len(path)), path)
    signal = simulator.commands.signal(windows, windows.length, PERIOD)
    coarse = drift.effect.law(simulator.predict(plain, windows, *start), signal, "all", rate=0.05)[0, :, 0]
    fine = simulator.predict(Hypothesis(simulator.theta, (drift,)), windows, *start)[0, :, 0]
    assert np.abs(fine - exact).max() < 0.3 * np.abs(coarse - exact).max()
