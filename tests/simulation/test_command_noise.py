"""Torques that currents tell are noisy: a lag leaves the noise as it is, and of clean commands nothing is noise."""

from dataclasses import replace

import numpy as np
import pytest
from recorded import rod

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.selection.explanation import explain
from fimpact.simulation.inputs import noise_in
from fimpact.smoothing.prepare import prepare

TIME = np.arange(600) * 0.004
SMOOTH = np.array([np.sin(7 * TIME), np.cos(3 * TIME) + 0.4 * np.sin(19 * TIME)])
LAG = Placed(EFFECTS["actuator_lag"], "motor", {"time": 0.05})


def test_noise_is_told_from_the_torque_that_it_stands_on():
    noise = 0.05 * np.random.default_rng(0).standard_normal(SMOOTH.shape)
    left = noise_in(SMOOTH + noise) - noise
    assert np.sqrt(np.mean(left**2)) < 0.4 * 0.05


@pytest.mark.parametrize("clean", [SMOOTH, np.sign(SMOOTH), np.zeros_like(SMOOTH)])
def test_of_smooth_torques_and_of_steps_nothing_is_noise(clean):
    assert not noise_in(clean).any()


def noisy(size: float):
    """The rod, whose log tells its torques with noise of this standard deviation, N m."""
    rng, recording = np.random.default_rng(3), rod()
    runs = [replace(run, ctrl=run.ctrl + size * rng.standard_normal(run.ctrl.shape)) for run in recording.runs]
    return replace(recording, runs=tuple(runs))


def late(recording) -> np.ndarray:
    """Commands behind a lag, (N,), the mean over each sample."""
    return prepare(recording, refine=1).track.commands((LAG,)).values.mean(1)[:, 0]


def test_a_lag_smooths_what_the_motor_was_told_and_not_what_the_log_says_wrongly():
    clean, dirty = late(rod()), late(noisy(0.1))
    given, told = (np.concatenate([run.ctrl[:, 0] for run in own.training]) for own in (rod(), noisy(0.1)))
    error, noise = dirty - clean, told - given
    assert np.std(clean - given) > 0.05  # it is late
    assert np.std(error) > 0.9 * np.std(noise) and np.corrcoef(error, noise)[0, 1] > 0.9


def test_noise_of_the_log_is_no_lag():
    made = prepare(noisy(0.4))
    asked = [EFFECTS[name] for name in ("actuator_lag", "command_delay", "viscous", "gain")]
    assert explain(made.track, made.begun, made.noise, asked).final.placed == ()
