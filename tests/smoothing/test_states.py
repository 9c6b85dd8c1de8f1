"""Steps between states are those of MuJoCo, turns of ball and free joints included."""

import mujoco
import numpy as np
import pytest

from fimpact.smoothing.states import States, tangent

XML = """<mujoco><worldbody>
<body name="base"><freejoint/><geom size="0.1" mass="1"/>
<body pos="0 0 0.3"><joint name="hinge" axis="0 1 0"/><geom size="0.1" mass="1"/>
<body pos="0 0 0.3"><joint name="ball" type="ball"/><geom size="0.1" mass="1"/></body></body></body>
<body pos="2 0 0"><joint name="slide" type="slide"/><geom size="0.1" mass="1"/></body></worldbody>
<actuator><position name="servo" joint="hinge" kp="1" timeconst="0.1"/></actuator></mujoco>"""


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_string(XML)


def random_states(model: mujoco.MjModel, count: int, seed: int) -> States:
    rng = np.random.default_rng(seed)
    qpos = rng.standard_normal((count, model.nq))
    for row in qpos:
        mujoco.mj_normalizeQuat(model, row)
    return States(qpos, rng.standard_normal((count, model.nv)), rng.standard_normal((count, model.na)))


def test_a_step_is_that_of_mujoco(model):
    space, start = tangent(model), random_states(model, 20, 0)
    step = np.random.default_rng(1).standard_normal((20, start.size))
    step[0] = 0.0
    step[1] *= 1e-14
    end = space.plus(start, step)
    expected = start.qpos.copy()
    for row, own in zip(expected, step, strict=True):
        mujoco.mj_integratePos(model, row, own[: model.nv].copy(), 1.0)
    np.testing.assert_allclose(end.qpos, expected, atol=1e-12)
    np.testing.assert_allclose(end.qvel, start.qvel + step[:, model.nv : 2 * model.nv], atol=1e-15)
    np.testing.assert_allclose(end.act, start.act + step[:, 2 * model.nv :], atol=1e-15)


def test_a_difference_is_that_of_mujoco(model):
    space, start, end = tangent(model), random_states(model, 20, 2), random_states(model, 20, 3)
    end.qpos[0], end.qpos[1] = start.qpos[0], start.qpos[1]
    end.qpos[1, 3:7] *= -1  # the same turn
    expected = np.empty((20, model.nv))
    for row, one, other in zip(expected, start.qpos, end.qpos, strict=True):
        mujoco.mj_differentiatePos(model, row, 1.0, one, other)
    np.testing.assert_allclose(space.minus(end, start)[:, : model.nv], expected, atol=1e-7)


def test_a_difference_undoes_a_step(model):
    space, start = tangent(model), random_states(model, 50, 4)
    for size in (1.0, 1e-6, 1e-10):
        step = size * np.random.default_rng(5).uniform(-1, 1, (50, start.size))
        np.testing.assert_allclose(space.minus(space.plus(start, step), start), step, atol=3e-15 + 1e-9 * size)


def test_coordinates_are_counted_with_the_states_of_actuators(model):
    assert random_states(model, 1, 0).size == 2 * model.nv + 1
