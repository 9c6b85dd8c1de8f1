"""Inverse dynamics of a diagnosis: what its answer leaves of the force that drove a motion."""

import mujoco
import numpy as np
import pytest
from diagnosed import hypotheses
from force_residual import missing_force

from fimpact.mismatch.simulate import Simulator
from fimpact.recordings import Recording, Run, Unknown

ARM = """<mujoco><option timestep="0.005"/><worldbody><body name="link"><joint name="hinge" axis="0 1 0"/>
<geom size="0.05" mass="1" pos="0 0 -0.3"/></body></worldbody><actuator><motor name="drive" joint="hinge"/></actuator>
<sensor><jointpos name="angle" joint="hinge"/></sensor></mujoco>"""
FRICTION = 0.3  # N m


@pytest.fixture(scope="module")
def driven():
    """Simulator of the naive model, and (qpos, qvel, qacc) and commands of one with dry friction."""
    model = mujoco.MjModel.from_xml_string(ARM)
    model.dof_frictionloss[0], data, rows = FRICTION, mujoco.MjData(model), []
    for k in range(200):
        data.ctrl[0] = 2.0 * np.sin(0.1 * k)
        mujoco.mj_forward(model, data)
        rows.append([data.qpos[0], data.qvel[0], data.qacc[0], data.ctrl[0]])
        mujoco.mj_step(model, data)
    rows = np.array(rows)[:, :, None]
    run = Run("driven", rows[:, 3], rows[:, 0], False)
    unknowns = (Unknown("mass", "link"),)
    recording = Recording(ARM, ".", 0.005, ("angle",), (run,), unknowns, np.full(1, np.nan), np.full(2, np.inf), 0.0)
    return Simulator(recording), (rows[:, 0], rows[:, 1], rows[:, 2]), rows[:, 3]


def test_the_answer_leaves_nothing_and_the_naive_fit_its_friction(driven):
    own = {"naive": 1.0, "after": 1.0}
    found = {"of": "coulomb@hinge", "name": "friction", "after": FRICTION}
    tried = hypotheses({"parameters": [own, found]}, 1)
    (naive, driving), (left, _) = (missing_force(driven[0], h, *driven[1:]) for h in tried.values())
    speed = driven[1][1]
    moving = np.abs(speed) > np.abs(speed).max() / 3
    np.testing.assert_allclose(naive[moving], -FRICTION * np.sign(speed)[moving], atol=0.02)
    np.testing.assert_allclose(left, 0, atol=1e-6)
    np.testing.assert_allclose(driving[:, 0], driven[2][:, 0])
