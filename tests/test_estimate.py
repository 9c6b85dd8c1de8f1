"""The estimator recovers a known truth from MuJoCo C, with honest intervals and a status."""

import numpy as np
import pytest
from conftest import CLEAR, TOUCHING
from scipy.optimize import OptimizeResult

from fimpact import truth
from fimpact.estimate import _mode, estimate
from fimpact.search import Campaign, Mode

SETTINGS = {
    "screen": 64,
    "stages": [
        {"blur": 0.06, "temper": 100, "starts": 4, "iterations": 4},
        {"blur": 0, "temper": 1, "starts": 3, "iterations": 6},
    ],
    "polish": 2,
    "evaluations": 20,
    "retries": 1,
}


def campaign(system, rho, designs, guess):
    rng = np.random.default_rng(0)
    shape = (system.steps, len(system.sensor.channels))
    runs = tuple(truth.run(system, rho * system.nominal, d, rng.standard_normal(shape)) for d in designs)
    return Campaign(system, system.template, runs, guess, 0.3)


@pytest.fixture(scope="module")
def landed(systems):
    rho, guess = np.array([1.1, 0.95, 1.05]), np.array([0.9, 1.1, 0.9])
    throws = [TOUCHING["block"], np.array([-0.4, 1.0, -2.95, -5.0])]
    known = campaign(systems["block"], rho, throws, guess)
    return rho, known, estimate(known, SETTINGS, [Mode(guess, 0.3 * np.eye(len(guess)))], np.random.default_rng(1))


def test_a_known_truth_is_recovered(landed):
    rho, _, found = landed
    assert np.abs(found.rho / rho - 1).max() < 0.01
    assert found.status == "converged"


def test_the_truth_lies_within_the_stated_uncertainty(landed):
    rho, known, found = landed
    z = (found.rho - rho) / np.sqrt(np.diag(found.covariance))
    assert np.abs(z).max() < 4
    assert found.cost == pytest.approx(known.measured.size / 2, rel=0.3)


def test_without_contact_the_prior_remains(systems):
    block, guess = systems["block"], np.array([0.9, 1.1, 0.9])
    found = estimate(
        campaign(block, np.ones(3), [CLEAR["block"]], guess),
        SETTINGS,
        [Mode(guess, 0.3 * np.eye(len(guess)))],
        np.random.default_rng(1),
    )
    assert np.allclose(found.rho, guess, atol=1e-3)
    assert np.allclose(np.sqrt(np.diag(found.covariance)), 0.3, rtol=1e-3)


def test_what_cannot_be_simulated_is_a_status_and_not_a_crash(systems, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warning to a file
    block, guess = systems["block"], np.ones(3)
    known = campaign(block, np.ones(3), [TOUCHING["block"] * np.nan], guess)
    found = estimate(known, SETTINGS, [Mode(guess, 0.3 * np.eye(len(guess)))], np.random.default_rng(1))
    assert found.status.startswith("failed") and np.isnan(found.rho).all()


def test_information_beyond_round_off_still_gives_a_covariance():
    slope = np.array([[1e9, 0.0], [1e9, 1e-9]])
    mode = _mode(OptimizeResult(x=np.ones(2), jac=slope))
    assert np.isfinite(mode.spread).all()
