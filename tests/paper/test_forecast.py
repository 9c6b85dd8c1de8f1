"""MuJoCo C with the estimator's own parameters: the truth's motion, MJX's sensitivities, and no trace of the past."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import CLEAR, TOUCHING

from fimpact.paper import reference_simulator
from fimpact.paper.forecast import AWAY, ENCODER_NOISE, STEP, forecaster
from fimpact.paper.information.programs import programs
from fimpact.paper.systems import make_system


def robots(system, count: int = 3) -> np.ndarray:
    return np.random.default_rng(5).uniform(0.9, 1.1, (count, len(system.nominal)))


def rows(system, count: int = 3) -> np.ndarray:
    return np.tile(TOUCHING[system.name], (count, 1))


def test_a_forecast_is_the_truth_of_the_same_robot(system):
    seen = forecaster(system).forecast(robots(system), rows(system))
    for rho, measured in zip(robots(system), seen.measurement, strict=True):
        expected = reference_simulator.simulate(system, rho * system.nominal, TOUCHING[system.name])[0].ravel()
        assert np.abs(measured * system.sensor.noise - expected).max() < 1e-9 * np.abs(expected).max()


def test_sensitivities_are_mjxs(system):
    measurement, slope = forecaster(system).linearise(robots(system), rows(system))
    exact = programs(system).linearise(system.template, robots(system), rows(system))
    assert np.abs(measurement - exact.measurement).max() < 1e-6 * np.abs(exact.measurement).max()
    assert np.abs(slope - exact.sensitivity).max() < 1e-4 * np.abs(exact.sensitivity).max()


def test_silence_is_not_differentiated_and_all_else_is_as_ever(systems, monkeypatch):
    """The arm's sensor reads nothing without contact; every derivative is the plain difference, to the last bit."""
    arm, p = systems["arm"], len(systems["arm"].nominal)
    made, rho = forecaster(arm), robots(arm, 4)
    designs = np.stack([TOUCHING["arm"], CLEAR["arm"], TOUCHING["arm"], CLEAR["arm"]])
    simulated, plain = [], made.forecast
    monkeypatch.setattr(made, "forecast", lambda *args: simulated.append(len(args[0])) or plain(*args))
    measurement, slope = made.linearise(rho, designs)
    assert simulated == [4, 2 * p]
    moved = (rho[:, None] + STEP * np.eye(p)).reshape(-1, p)
    each = plain(moved, np.repeat(designs, p, 0)).measurement.reshape(4, p, -1)
    assert np.array_equal(slope, ((each - measurement[:, None]) / STEP).transpose(0, 2, 1))
    assert slope[0].any() and not slope[1].any()


def test_a_near_miss_is_differentiated(systems, monkeypatch):
    made, asked = forecaster(systems["arm"]), []
    near = made.forecast(np.ones((1, 6)), CLEAR["arm"][None])._replace(closest=np.array([AWAY / 2]))

    def forecast(rho, *others):
        asked.append(len(rho))
        return type(near)(*(np.repeat(part, len(rho), 0) for part in near))

    monkeypatch.setattr(made, "forecast", forecast)
    made.linearise(np.ones((1, 6)), CLEAR["arm"][None])
    assert asked == [1, 6]


def test_the_gap_is_negative_in_contact_alone(system):
    designs = np.stack([TOUCHING[system.name], CLEAR[system.name]])
    seen = forecaster(system).forecast(np.ones((2, len(system.nominal))), designs)
    assert seen.closest[0] < 0 < seen.closest[1] and (seen.first > 0).all()


def test_the_blind_feel_nothing_and_see_the_motion(system):
    made = forecaster(system)
    blind = made.forecast(robots(system), rows(system), blind=True)
    assert np.abs(blind.measurement).max() < 1e-6
    assert (np.abs(made.forecast(robots(system), rows(system)).measurement).max(1) > 10).all()
    _, slope = made.linearise(robots(system), rows(system), blind=True)
    assert slope.shape == (3, system.steps * 3, len(system.nominal)) and np.isfinite(slope).all()
    assert blind.motion.shape == (3, system.steps * 3)
    qpos = np.asarray(system.launch(system, TOUCHING[system.name])[0])
    assert np.allclose(blind.motion[:, :3] * ENCODER_NOISE, qpos)


def test_a_row_does_not_depend_on_its_neighbours_or_on_what_was_simulated_before(system):
    made = forecaster(system)
    alone = made.forecast(robots(system)[:1], rows(system, 1)).measurement
    made.forecast(robots(system, 80) * 1.05, rows(system, 80), blind=True)
    among = made.forecast(robots(system, 80)[:70], rows(system, 70)).measurement
    assert np.array_equal(alone[0], among[0])


@pytest.mark.filterwarnings("ignore")
def test_what_diverges_is_not_a_number(systems):
    wild = make_system("arm", systems["arm"].settings | {"timestep": 0.2})
    seen = forecaster(wild).forecast(np.ones((1, 6)), np.full((1, 24), 2.0))
    assert np.isnan(seen.measurement).all() and np.isnan(seen.closest).all()


def test_a_moved_surface_is_a_forecaster_of_its_own(systems):
    block = systems["block"]
    near = make_system("block", block.settings | {"surface": -0.5})
    assert forecaster(near) is not forecaster(block)
    one = np.ones((1, 3))
    first = [forecaster(s).forecast(one, CLEAR["block"][None]).first[0] for s in (near, replace(block))]
    assert first[1] - first[0] == pytest.approx(1.4)
