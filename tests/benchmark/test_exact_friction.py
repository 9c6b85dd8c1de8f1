"""Dry friction that is planted follows its exact law: against the speed, and at rest as much as it takes."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from fimpact.benchmark.drawing.motions import draw_motion
from fimpact.benchmark.planting.ground_truth import new_world, play
from fimpact.benchmark.planting.out_of_catalogue import plant
from fimpact.benchmark.rigs.registry import RIGS, Rig

ARM, JOINT, DOF = RIGS["arm_free"], "joint_2", 1
STEPS = 100  # of the reference, in one sample
SAMPLES = 120
LAWS = {  # values, and limits of the friction against forward and backward speed, N m, of the motor's torque
    "coulomb": ({"friction": 0.4}, lambda u: (0.4, 0.4)),
    "direction_dependent_coulomb": ({"forward": 0.5, "backward": 0.2}, lambda u: (0.5, 0.2)),
    "load_dependent_friction": ({"coefficient": 0.3}, lambda u: (0.3 * abs(u), 0.3 * abs(u))),
    "efficiency": (
        {"driving": 0.4, "driven": 0.1},
        lambda u: (abs(u) * (0.4 if u > 0 else 0.1), abs(u) * (0.4 if u < 0 else 0.1)),
    ),
}


class Slider(Rig):
    """One mass of 1 kg on a rail, pushed by a force."""

    xml = """<mujoco><option timestep="0.01"/><worldbody><body><joint name="joint_1" type="slide" axis="1 0 0"/>
    <geom size="0.1" mass="1"/></body></worldbody><actuator><motor joint="joint_1"/></actuator>
    <sensor><jointpos name="place" joint="joint_1"/></sensor></mujoco>"""


SLIDER = Slider(**{f: getattr(ARM, f) for f in ARM.__dataclass_fields__} | {"period": 0.01, "channels": ("place",)})


def slid(speed: float, force: float, time: float, ahead: float, back: float) -> tuple[float, float]:
    """Distance and speed of a mass of 1 kg after `time` s at constant force, in closed form; friction limits in N."""
    level = ahead if speed > 0 else -back
    if speed == 0:
        if -back <= force <= ahead:
            return 0.0, 0.0
        level = ahead if force > 0 else -back
    pace = force - level
    stop = -speed / pace if speed * pace < 0 else np.inf
    if stop >= time:
        return speed * time + pace * time**2 / 2, speed + pace * time
    further, after = slid(0.0, force, time - stop, ahead, back)
    return speed * stop / 2 + further, after


@pytest.mark.parametrize(
    ("name", "values", "limits"),
    [
        ("coulomb", {"friction": 0.5}, (0.5, 0.5)),
        ("direction_dependent_coulomb", {"forward": 0.8, "backward": 0.3}, (0.8, 0.3)),
    ],
)
def test_a_mass_slides_sticks_and_turns_as_in_closed_form(name, values, limits):
    time = np.arange(300) * SLIDER.period
    force = 0.8 * np.sin(7 * time) + 0.2 * np.sin(3 * time)
    world = new_world(replace(SLIDER, unknowns=()), np.zeros(0), fine=True)
    plant(world, name, "joint_1", values)
    states = play(world, np.zeros((1, 2)), force[None, :, None]).states[0]
    expected, place, speed = [], 0.0, 0.0
    for push in force:
        expected.append((place, speed))
        way, speed = slid(speed, push, SLIDER.period, *limits)
        place += way
    expected = np.array(expected)
    assert (expected[:, 1] == 0).mean() > 0.1 and (np.abs(expected[:, 1]) > 0.01).mean() > 0.3
    # A step of 0.5 ms, in which the speed changes by up to 1 mm/s.
    np.testing.assert_allclose(states[:, 1], expected[:, 1], atol=1e-3)
    np.testing.assert_allclose(states[:, 0], expected[:, 0], atol=1e-3)
    still = expected[:, 1] == 0
    assert np.abs(states[still, 1]).max() < 1e-3 * np.abs(expected[:, 1]).max()


def integrated(start: np.ndarray, ctrl: np.ndarray, limits) -> np.ndarray:
    """States (T, 2 nv) of the arm by midpoint steps of our own, friction at joint 2 as an impulse within its limits."""
    model = mujoco.MjModel.from_xml_string(ARM.xml)
    data, h, mass = mujoco.MjData(model), ARM.period / STEPS, np.zeros((3, 3))
    (q, v), states = np.split(start, 2), []

    def pushed(q, v, base, command, time):
        """Speed after `time` from `base`, accelerated as at (q, v)."""
        data.qpos[:], data.qvel[:], data.ctrl[:] = q, v, command
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        inverse, after = np.linalg.inv(mass), base + time * data.qacc
        ahead, back = limits(command[DOF])
        impulse = np.clip(-after[DOF] / inverse[DOF, DOF], -time * ahead, time * back)
        return after + inverse[:, DOF] * impulse

    for command in ctrl:
        states.append(np.r_[q, v])
        for _ in range(STEPS):
            after = pushed(q + h / 2 * v, pushed(q, v, v, command, h / 2), v, command, h)
            q, v = q + h / 2 * (v + after), after
    return np.array(states)


@pytest.mark.parametrize("name", LAWS)
def test_friction_in_an_arm_is_that_of_an_integration_of_our_own(name):
    motion, (values, limits) = draw_motion(ARM, np.random.default_rng(5)), LAWS[name]
    ctrl = 0.5 * motion.ctrl[0, :SAMPLES]
    expected = integrated(motion.start[0], ctrl, limits)
    world = new_world(ARM, np.zeros(len(ARM.unknowns)), fine=True)
    plant(world, name, JOINT, values)
    states = play(world, motion.start[:1], ctrl[None]).states[0]
    error = np.abs(states - expected)
    assert error[:, :3].max() < 0.1 * ARM.noise[0]
    assert error[:, 3:].max() < 0.01 * np.abs(expected[:, 3:]).max()
