"""A mount that tips: along a motion, and simulated, its force is that of two hinges with a spring and a damper."""

import mujoco
import numpy as np
import pytest

from fimpact.effects import EFFECTS
from fimpact.effects.law_inputs import State

COMPLIANCE, SETTLING = 4e-3, 0.03  # rad/(N m), s
STEP = 1e-3
HINGES = """<joint name="base_x" axis="1 0 0" stiffness="{k}" damping="{d}"/>
<joint name="base_y" axis="0 1 0" stiffness="{k}" damping="{d}"/>"""
ARM = """
<mujoco>
  <option timestep="{step}" integrator="RK4"/>
  <worldbody>
    <body name="base" pos="0.2 0 0.3">{hinges}
      <geom type="box" size=".05 .05 .1" mass="2"/>
      <body name="upper" pos="0 0 .1">
        <joint name="yaw" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 .1 0 .2" size=".03" mass="1"/>
        <body name="lower" pos=".1 0 .2">
          <joint name="elbow" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass=".6"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="yaw"/><motor joint="elbow"/></actuator>
</mujoco>
"""


def rigid() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(ARM.format(hinges="", step=STEP))


@pytest.fixture(scope="module")
def moved() -> tuple[np.ndarray, ...]:
    """Positions, speeds, accelerations of yaw and elbow, and their torques, (T, 2) each, on a mount that tips."""
    soft = HINGES.format(k=1 / COMPLIANCE, d=SETTLING / COMPLIANCE)
    model = mujoco.MjModel.from_xml_string(ARM.format(hinges=soft, step=STEP / 10))
    data = mujoco.MjData(model)
    data.qpos[3] = 0.4
    for _ in range(20000):  # until it rests, with the joints held
        mujoco.mj_forward(model, data)
        data.ctrl[:] = data.qfrc_bias[2:] - 5 * data.qvel[2:]
        mujoco.mj_step(model, data)
    held, rows = data.ctrl.copy(), []
    for k in range(9000):
        time = k * STEP / 10
        torque = held + np.array([0.3 * np.sin(9 * time), 0.2 * np.sin(14 * time)])
        data.ctrl[:] = torque
        mujoco.mj_forward(model, data)
        rows.append(np.concatenate([data.qpos[2:], data.qvel[2:], data.qacc[2:], torque]))
        mujoco.mj_step(model, data)
    return tuple(np.split(np.array(rows)[::10], 4, 1))


def along(moved, known: bool, **values) -> np.ndarray:
    """Force, (T, 2), of the law along the motion, whose accelerations are `known` or not."""
    model, memory, out = rigid(), {}, []
    for qpos, qvel, qacc, torque in zip(*moved, strict=True):
        row = (qpos[None], qvel[None], torque[None], np.zeros(1), STEP, memory)
        state = State(model, *row, qacc=qacc[None] if known else None)
        out.append(EFFECTS["base_gives_way"].law(state, "base", **values)[0])
    return np.array(out)


def missing(moved) -> np.ndarray:
    """What a model on a rigid mount needs beside the torques for this motion, (T, 2)."""
    model, out = rigid(), []
    data = mujoco.MjData(model)
    for qpos, qvel, qacc, torque in zip(*moved, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, qacc
        mujoco.mj_inverse(model, data)
        out.append(data.qfrc_inverse - torque)
    return np.array(out)


@pytest.mark.parametrize("known", [True, False])
def test_its_force_is_what_a_rigid_mount_lacks(moved, known):
    """But for what turns with the mount as fast as the joints do."""
    lacks, law = missing(moved), along(moved, known, compliance=COMPLIANCE, settling=SETTLING)
    assert (np.sqrt(np.mean((lacks - law) ** 2, 0)) < 0.25 * np.sqrt(np.mean(lacks**2, 0))).all()
    other = along(moved, known, compliance=COMPLIANCE, settling=3 * SETTLING)
    assert (np.mean((lacks - other) ** 2, 0) > 2 * np.mean((lacks - law) ** 2, 0)).all()


def test_nothing_gives_without_compliance(moved):
    assert not along([own[:5] for own in moved], True, compliance=0.0, settling=1.0).any()


def test_several_sizes_pass_side_by_side(moved):
    """Two mounts at once do what each does alone."""
    own = [part[:50] for part in moved]
    alone = [along(own, True, compliance=c, settling=s) for c, s in ((1e-3, 0.01), (4e-3, 0.1))]
    model, memory, both = rigid(), {}, []
    for qpos, qvel, qacc, torque in zip(*own, strict=True):
        two = [np.tile(part, (2, 1)) for part in (qpos, qvel, torque)]
        state = State(model, *two, np.zeros(2), STEP, memory, qacc=np.tile(qacc, (2, 1)))
        values = {"compliance": np.array([1e-3, 4e-3]), "settling": np.array([0.01, 0.1])}
        both.append(EFFECTS["base_gives_way"].law(state, "base", **values))
    np.testing.assert_allclose(np.array(both), np.stack(alone, 1), atol=1e-12)
