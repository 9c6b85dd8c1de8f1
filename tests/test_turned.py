"""Where joints have turned before a window, and friction that remembers it."""

from dataclasses import replace

import numpy as np
import pytest
from planted import ARM, record

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch.simulate import Hypothesis, Simulator
from fimpact.mismatch.turned import measured_turns, smooth, turns
from fimpact.mismatch.windows import cut

WAY = np.array([0.0, 1.0, 2.0, 1.95, 3.0, 1.0, 0.0, 0.5, 2.0])
SPEEDS = '<sensor><jointvel name="speed_1" joint="joint_1"/><jointvel name="speed_2" joint="joint_2"/>'
NOISE = np.full(2, 1e-5)
DAHL = Placed(EFFECTS["dahl"], "joint_2", {"friction": 0.05, "displacement": 0.1})


def told(first: int, least: float = 0.1) -> list[float]:
    return turns({1: [WAY]}, np.array([0]), np.array([first]), {1: least}, 2)[0, :, 1].tolist()


def test_a_joint_has_turned_where_it_goes_back_by_more_than_noise():
    assert told(8) == [0.0, 3.0, 0.0, 2.0]
    assert told(8, 0.01) == [0.0, 2.0, 1.95, 3.0, 0.0, 2.0]
    assert told(5) == [0.0, 3.0, 1.0]
    assert told(0) == [0.0, 0.0]


def test_windows_that_turned_less_often_stay_where_they_are():
    found = turns({1: [WAY]}, np.zeros(2, int), np.array([1, 8]), {1: 0.1}, 2)
    assert found[0, :, 1].tolist() == [0.0, 1.0, 1.0, 1.0]
    assert np.isnan(found[:, :, 0]).all()  # nothing measures that one


@pytest.mark.parametrize("gap", [slice(0, 0), slice(100, 120)])
def test_noise_makes_no_turns(gap):
    clean = np.sin(np.arange(400) * 0.02)
    noisy = clean + 1e-2 * np.random.default_rng(0).standard_normal(400)
    noisy[gap] = np.nan
    found = turns({0: [smooth(noisy, 1e-2)]}, np.array([0]), np.array([399]), {0: 0.03}, 1)[0, :, 0]
    np.testing.assert_allclose(found, [0.0, 1.0, -1.0, clean[399]], atol=0.02)
    assert np.isnan(smooth(np.full(9, np.nan), 1.0)).all()


def test_friction_remembers_what_was_before_a_window():
    recording = replace(record(4, runs=1), unknowns=())
    simulator, run, start = Simulator(recording), recording.runs[0], (np.array([[0.3, -0.4]]), np.zeros((1, 2)))
    whole, parts, rubbing = cut([run], 0), cut([run], 60), Hypothesis(np.zeros(0), (DAHL,))
    expected = simulator.predict(rubbing, whole, *start)[0]
    seen = replace(run, measured=expected)
    known = replace(parts, turned=measured_turns(simulator.base, recording, [seen], parts, NOISE))
    speeds = Simulator(replace(recording, xml=ARM.replace("<sensor>", SPEEDS), channels=("speed_1", "speed_2")))
    states = expected[parts.first], speeds.predict(rubbing, whole, *start)[0][parts.first]
    off = [np.abs(simulator.predict(rubbing, own, *states).reshape(-1, 2) - expected).max() for own in (known, parts)]
    assert off[0] < 2e-3 < 2e-2 < off[1]
