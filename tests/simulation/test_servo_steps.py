import mujoco
import numpy as np
import pytest

from fimpact.simulation.servo_steps import IMPLICIT, held_by_servos

PERIOD = 0.008
MODEL = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><body>
  <joint name="wrist" axis="0 0 1" damping="{damping}" armature="{inertia}"/>
  <geom size="0.01" mass="1e-6"/></body></worldbody>
  <actuator><position name="wrist" joint="wrist" kp="{kp}" kv="{kv}"/></actuator></mujoco>"""


def _wrist(kp=3000.0, inertia=1e-4, damping=0.0, kv=0.0) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL.format(kp=kp, inertia=inertia, damping=damping, kv=kv))


def _followed(model: mujoco.MjModel, samples: int = 20) -> float:
    """How far from its target, 0.1 rad away, a joint ends that began at rest."""
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.1
    with held_by_servos([model], PERIOD):
        mujoco.mj_step(model, data, round(samples * PERIOD / model.opt.timestep))
    return abs(float(data.qpos[0]) - 0.1)


def test_a_servo_that_no_log_sees_swing_holds_its_joint():
    assert _followed(_wrist()) < 1e-6


@pytest.mark.parametrize("step", [0.002, 0.0005, 0.000125])
def test_it_follows_within_a_sample_at_any_time_step(step):
    model = _wrist(inertia=0.002)
    model.opt.timestep = step
    assert _followed(model, samples=2) < 0.1 * np.exp(-3)


@pytest.mark.parametrize("more", [{"damping": 0.05}, {"kv": 3.0}], ids=str)
def test_a_stiff_servo_that_something_brakes_stays_finite(more):
    assert _followed(_wrist(**more), samples=200) < 1e-3


@pytest.mark.parametrize(
    "kept", [{"inertia": 0.1}, {"inertia": 0.1, "kv": 10.0}, {"inertia": 0.1, "damping": 11.0}], ids=str
)
def test_a_servo_that_steps_follow_is_left_to_them(kept):
    model = _wrist(**kept)
    before = model.opt.integrator, model.dof_damping.copy()
    with held_by_servos([model], PERIOD):
        assert model.opt.integrator == before[0]
        np.testing.assert_array_equal(model.dof_damping, before[1])


def test_a_joint_that_is_said_to_be_braked_is_believed():
    """It swings faster than the samples show, and dies away as the model says."""
    model = _wrist(inertia=0.01, damping=0.5)
    model.opt.timestep = 0.0005
    with held_by_servos([model], PERIOD):
        assert model.dof_damping[0] == 0.5


def test_the_model_is_as_it_was_afterwards():
    model = _wrist()
    with held_by_servos([model], PERIOD):
        assert model.opt.integrator == IMPLICIT
        assert model.dof_damping[0] > 0
    assert model.opt.integrator != IMPLICIT
    assert model.dof_damping[0] == 0
