"""Readings that are late or early show what happened outside their window, as the same run in one piece does."""

from dataclasses import replace

import numpy as np
import pytest
from planted import ARM, PERIOD, record

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch.simulate import Hypothesis, Simulator
from fimpact.mismatch.windows import cut
from fimpact.recordings import Recording, Run

SPEEDS = '<sensor><jointvel name="speed_1" joint="joint_1"/><jointvel name="speed_2" joint="joint_2"/>'
CHANNELS = ("encoder_1", "encoder_2", "speed_1", "speed_2")
BALL = """<mujoco><option timestep="0.0025" gravity="0 0 -9.8"/><worldbody><body name="ball" pos="0 0 1"><freejoint/>
<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.02 0.025"/><site name="site" pos="0.1 0 0"/></body></worldbody>
<sensor><framepos name="place" objtype="site" objname="site"/><gyro name="turn" site="site"/></sensor></mujoco>"""
CART = """<mujoco><compiler angle="radian"/><option timestep="0.0025" gravity="9.8 0 0"/><worldbody><body>
<joint name="slide" type="slide" axis="1 0 0" range="-9 0.1" limited="true"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody>
<actuator><motor name="motor" joint="slide"/></actuator>
<sensor><jointpos name="place" joint="slide"/></sensor></mujoco>"""
LENGTH = 80


def placed(name: str, site: str, **values: float) -> Placed:
    return Placed(EFFECTS[name], site, values)


def simulated(xml: str, channels: tuple[str, ...], ctrl: np.ndarray) -> Simulator:
    run, count = Run("run", ctrl, np.zeros((len(ctrl), len(channels))), False), len(channels)
    return Simulator(Recording(xml, ".", PERIOD, channels, (run,), (), np.ones(count), np.full(4, np.inf), window=0.4))


@pytest.fixture(scope="module")
def ctrl() -> np.ndarray:
    return record(4, runs=1).runs[0].ctrl


@pytest.fixture(scope="module")
def arm(ctrl) -> Simulator:
    return simulated(ARM.replace("<sensor>", SPEEDS), CHANNELS, ctrl)


def in_windows(simulator: Simulator, acting: tuple, late: tuple) -> tuple[np.ndarray, np.ndarray]:
    """What windows of a run read, each from the state that it truly begins in, and the same of the run in one piece."""
    whole, parts = (cut(simulator.recording.runs, length) for length in (0, LENGTH))
    start = np.array([[0.3, -0.4]]), np.zeros((1, 2))
    truth, read = (simulator.predict(Hypothesis(np.zeros(0), p), whole, *start)[0] for p in (acting, acting + late))
    states = np.split(truth[parts.first, :4], 2, 1)
    found = simulator.predict(Hypothesis(np.zeros(0), acting + late), parts, *states)
    return found, read.reshape(found.shape)


@pytest.mark.parametrize(
    ("acting", "near"),
    [
        ((), 1e-9),
        ((placed("coulomb", "joint_1", friction=0.05), placed("command_delay", "motor_2", delay=0.0113)), 1e-9),
        ((placed("stribeck", "joint_1", coulomb=0.05, excess=0.05, speed=0.1),), 1e-7),
        ((placed("quadratic_drag", "link_2", coefficient=0.05),), 1e-5),  # which is asked half a step ahead
    ],
)
@pytest.mark.parametrize(
    "late",
    [
        (placed("sensor_delay", "encoder_1", delay=0.0363),),
        (placed("clock_drift", "all", rate=0.02),),
        (placed("clock_drift", "all", rate=-0.02),),
    ],
)
def test_windows_read_what_the_run_reads(arm, acting, near, late):
    found, expected = in_windows(arm, acting, late)
    np.testing.assert_allclose(found, expected, atol=near)


def test_a_body_that_turns_freely_was_somewhere_before():
    channels = tuple(f"{name}[{i}]" for name in ("place", "turn") for i in range(3))
    simulator = simulated(BALL, channels, np.zeros((90, 0)))
    whole, parts = (cut(simulator.recording.runs, length) for length in (0, 30))
    start = np.array([[0, 0, 1, 1, 0, 0, 0.0]]), np.array([[1, 0.2, 3, 4, 8, 5.0]])
    plain = Hypothesis(np.zeros(0))
    late = replace(plain, placed=(placed("sensor_delay", "place", delay=0.0363),))
    after, begins = simulator.motion(plain, whole, *start), parts.first * simulator.substeps
    states = [np.concatenate([own, path[0]])[begins] for own, path in zip(start, after, strict=True)]
    found = simulator.predict(late, parts, *states)
    np.testing.assert_allclose(found.reshape(90, 6), simulator.predict(late, whole, *start)[0], atol=1e-9)


def test_a_past_in_which_something_struck_is_a_straight_line():
    """The cart has rebounded from the end of its track, less than two samples ago; how it came there, who knows."""
    simulator = simulated(CART, ("place",), np.zeros((160, 1)))
    part = cut(simulator.recording.runs, LENGTH).part(np.array([1]))
    late = Hypothesis(np.zeros(0), (placed("sensor_delay", "place", delay=4 * PERIOD),))
    found = simulator.predict(late, part, np.array([[0.0999]]), np.zeros((1, 1)))[0, :, 0]
    np.testing.assert_allclose(np.diff(found[:5], 2), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.diff(found[3:6], 2), 9.8 * PERIOD**2, rtol=1e-6)


def test_what_damps_out_fast_has_no_past(ctrl):
    """Backwards it grows: the speed would have to be known to a hundred digits."""
    stiff = ARM.replace('damping="0.05"', 'damping="50"').replace("<sensor>", SPEEDS)
    simulator = simulated(stiff, CHANNELS, ctrl)
    part = cut(simulator.recording.runs, LENGTH).part(np.array([1]))
    late = Hypothesis(np.zeros(0), (placed("sensor_delay", "encoder_1", delay=0.04),))
    found = simulator.predict(late, part, np.zeros((1, 2)), np.full((1, 2), 0.1))[0, :8, 0]
    np.testing.assert_allclose(np.diff(found[:6], 2), 0.0, atol=1e-12)
    assert np.abs(found).max() < 0.1


def test_the_past_is_found_once_for_all_channels_and_never_in_vain(arm, monkeypatch):
    parts, asked, stepper = cut(arm.recording.runs, LENGTH), [], arm.late._stepper
    states = np.full((len(parts.runs), 2), 0.1), np.full((len(parts.runs), 2), 0.5)
    monkeypatch.setattr(arm.late, "_stepper", lambda *a: asked.append(1) or stepper(*a))

    def read(*late: Placed) -> np.ndarray:
        return arm.predict(Hypothesis(np.zeros(0), late), parts, *states)

    plain = read()
    np.testing.assert_allclose(read(placed("sensor_delay", "encoder_1", delay=1e-13)), plain, atol=1e-12)
    assert not asked
    for channel in CHANNELS:
        assert np.abs(read(placed("sensor_delay", channel, delay=0.2 * PERIOD)) - plain).max() > 1e-5
    assert len(asked) == 1
    np.testing.assert_array_equal(read(), plain)


def test_a_delay_may_pass_a_whole_number_of_samples(arm):
    """Further back is looked at, and nothing jumps."""
    parts = cut(arm.recording.runs, LENGTH)
    states = np.full((len(parts.runs), 2), 0.1), np.full((len(parts.runs), 2), 0.5)
    delays = np.array([0.0, 1e-9, 5 * PERIOD - 1e-9, 5 * PERIOD, 5 * PERIOD + 1e-9])
    late = [Hypothesis(np.zeros(0), (placed("sensor_delay", "all", delay=delay),)) for delay in delays]
    read = [arm.predict(hypothesis, parts, *states) for hypothesis in late]
    assert arm.late.reach(late[2], parts)[0] < arm.late.reach(late[4], parts)[0]
    for one, other in ((0, 1), (2, 3), (3, 4)):
        np.testing.assert_allclose(read[one], read[other], atol=1e-7)
