"""What sensors read between two samples: forces jump with commands, and a late reading is of what came before."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from mujoco.rollout import Rollout
from recorded import record, waves

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.recordings import Recording
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import Simulator
from fimpact.simulation.windows import cut
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth

PERIOD, FINE, LATE = 0.01, 20, 3  # s, steps in a sample, and as many of them late
CART = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><body name="cart">
<joint name="rail" type="slide" axis="1 0 0" damping="0.5"/><geom size="0.1" mass="1" contype="0" conaffinity="0"/>
<site name="imu"/></body></worldbody><actuator><motor name="motor" joint="rail"/></actuator>
<sensor><jointpos name="place" joint="rail"/><accelerometer name="felt" site="imu"/></sensor></mujoco>"""
DELAY = LATE / FINE * PERIOD


@cache
def late() -> Recording:
    """A cart whose accelerometer is read a little late, two runs."""
    commands = [waves(200, [3.0], i, PERIOD) for i in range(2)]
    found = record(CART, ("place", "felt[0]"), commands, (1e-6, 0.02), period=PERIOD, fine=FINE)
    truth, runs = mujoco.MjModel.from_xml_string(CART), []
    truth.opt.timestep, rng = PERIOD / FINE, np.random.default_rng(1)
    for run in found.runs:
        held = np.repeat(run.ctrl, FINE, 0)[None]
        sensed = Rollout(nthread=0).rollout(truth, mujoco.MjData(truth), np.zeros((1, 3)), held)[1][0, :, 1]
        before = np.concatenate([np.full(LATE, sensed[0]), sensed])[: len(sensed) : FINE]
        measured = run.measured.copy()
        measured[:, 1] = before + 0.02 * rng.standard_normal(len(before))
        runs.append(replace(run, measured=measured, held_out=False))
    return replace(found, runs=tuple(runs))


def placed(delay: float) -> Placed:
    return Placed(EFFECTS["sensor_delay"], "felt", {"delay": delay}, ranges={"delay": (0.0, 1.0)})


def test_a_delay_of_a_part_of_a_sample_shows_in_what_jumps_with_commands():
    made = prepare(late())
    plain = smooth(made.track, made.begun, made.noise)
    found = smooth(made.track, made.begun, made.noise, [placed(0.3 * PERIOD)], [{"delay": PERIOD}], plain)
    assert found.converged and found.loss() < plain.loss() - 100
    assert found.numbers[-1].value == pytest.approx(DELAY, rel=0.5)
    assert found.levels.reading.ravel()[1] < 2 * made.noise[1]


def test_a_prediction_reads_what_a_late_sensor_felt_before_the_command_came():
    given = late()
    simulator, windows = Simulator(given), cut(given.runs, 0)
    start = np.zeros((2, 1)), np.zeros((2, 1))
    read = simulator.predict(Hypothesis(simulator.theta, (placed(DELAY),)), windows, *start)[:, :, 1]
    measured = np.array([run.measured[:, 1] for run in given.runs])
    error, plain = (np.sqrt(np.mean((own - measured)[:, 1:] ** 2)) for own in (read, read * 0))
    at_once = simulator.predict(Hypothesis(simulator.theta), windows, *start)[:, :, 1]
    assert error < 0.025 < 0.1 * plain and np.sqrt(np.mean((at_once - measured)[:, 1:] ** 2)) > 0.1


@pytest.mark.parametrize(
    ("delay", "expected"),
    [(0.5, [-0.5 * 10 / 4, 3.5, 13.5]), (1.0, [-10 / 4, 3.0, 13.0]), (4.0, [-10.0, 0.0, 10.0])],
)
def test_no_line_leads_from_one_sample_to_the_next(delay, expected):
    """Samples of four steps, that begin at 0, 10 and 20 and rise by one a step."""
    signal = Simulator(late()).commands.signal(cut(late().runs[:1], 0), 12, 1.0)
    rows = (10 * np.repeat(np.arange(3), 4) + np.tile(np.arange(4), 3))[None, :, None] * np.ones(2)
    read = EFFECTS["sensor_delay"].law(rows, replace(signal, parts=4), "felt", delay=delay)
    np.testing.assert_allclose(read[0, ::4, 1], expected, atol=1e-9)
    np.testing.assert_array_equal(read[..., 0], rows[..., 0])


LATES = {
    "command_delay": {"delay": 0.002 * PERIOD},
    "actuator_lag": {"time": 0.002 * PERIOD},
}


@pytest.mark.parametrize("late_by", LATES)
def test_a_command_that_is_late_however_little_is_felt_after_the_sample(late_by):
    """What an accelerometer reads at the very moment of a command is what the last one did."""
    track = prepare(late()).track
    law = Placed(EFFECTS[late_by], "motor", LATES[late_by])
    given = track.commands([law])
    inner = np.flatnonzero(track.run_of == np.roll(track.run_of, 1))
    np.testing.assert_allclose(given.instant[inner], track.ctrl[inner - 1, 0], atol=1e-6)
    assert track.commands().instant is None
    none = track.commands([Placed(EFFECTS[late_by], "motor", EFFECTS[late_by].neutral)])
    np.testing.assert_allclose(none.instant, track.ctrl[:, 0], atol=1e-9)


def test_a_late_command_shows_its_last_in_an_accelerometer_and_in_no_encoder():
    made = prepare(late())
    plain = smooth(made.track, made.begun, made.noise)
    shown = [
        made.track.ahead(plain.linear.plant.models, plain.states, made.track.commands(laws), plain.tau).readings
        for laws in ([], [Placed(EFFECTS["command_delay"], "motor", {"delay": 1e-5})])
    ]
    np.testing.assert_array_equal(shown[0][:, 0], shown[1][:, 0])
    changes = np.diff(made.track.ctrl[:, 0, 0])
    assert (
        np.abs((shown[1] - shown[0])[1:, 1] + changes)[made.track.run_of[1:] == 0][:-1].max()
        < 0.02 * np.abs(changes).max()
    )
