"""The estimator recovers a known truth from MuJoCo C, with honest intervals and a status."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from conftest import CLEAR, TOUCHING
from scipy.optimize import OptimizeResult

from fimpact.paper import reference_simulator
from fimpact.paper.estimate import FAR, beliefs, estimate, mode_of
from fimpact.paper.search import Campaign, Mode, posterior_cost, prior_mode

NEARLY = np.array([0.3, 0.5, -2.65, 2.0])  # touches if the block is somewhat larger than nominal

SETTINGS = {
    "screen": 64,
    "starts": 4,
    "iterations": 6,
    "population": 32,
    "stages": [
        {"blur": 0.06, "temper": 100, "generations": 5},
        {"blur": 0.02, "temper": 5, "generations": 5},
        {"blur": 0, "temper": 1, "generations": 5},
    ],
    "polish": 2,
    "evaluations": 20,
    "retries": 1,
}


def campaign(system, rho, designs, guess):
    rng = np.random.default_rng(0)
    shape = (system.steps, len(system.sensor.channels))
    runs = tuple(reference_simulator.run(system, rho * system.nominal, d, rng.standard_normal(shape)) for d in designs)
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


def test_after_silence_only_what_would_have_been_silent_is_believed(systems):
    # A block as large as first guessed would have touched.
    block, guess = systems["block"], np.array([1.0, 1.2, 1.2])
    silent = campaign(block, np.array([1.0, 0.8, 0.8]), [NEARLY], guess)
    assert silent.recordings[0].contact_steps == 0
    found = estimate(silent, SETTINGS, [prior_mode(silent)], np.random.default_rng(1))
    before, after = (beliefs(c, found, 8, np.random.default_rng(2)) for c in (replace(silent, recordings=()), silent))

    def touching(rho):
        return sum(reference_simulator.simulate(block, row * block.nominal, NEARLY)[1] > 0 for row in rho)

    assert touching(before) > 0 and touching(after) == 0


def test_a_fit_far_above_the_noise_is_not_believed(systems, landed):
    _, known, found = landed
    wild = known.recordings[0].measurement + 50 * np.random.default_rng(3).standard_normal((160, 2))
    wrong = replace(known, recordings=(replace(known.recordings[0], measurement=wild),))
    status = estimate(wrong, SETTINGS, found.carried, np.random.default_rng(1)).status
    assert status == FAR
    draws = beliefs(known, replace(found, status=FAR), 64, np.random.default_rng(4))
    assert 0.2 < draws.std() < 0.4  # the prior again
    assert len(beliefs(known, found, 64, np.random.default_rng(4))) == 1  # a narrow posterior is its estimate


def test_a_draw_that_diverged_costs_infinity_without_a_warning(systems, landed, monkeypatch):
    _, known, _ = landed
    wild = lambda campaign, rho: np.full((2 * len(rho), 320), 1e200)  # noqa: E731
    monkeypatch.setattr("fimpact.paper.search.whitened_errors", wild)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cost = posterior_cost(known, np.ones((3, 3)), blur=0.02)
    assert np.isinf(cost).all()


def test_what_cannot_be_simulated_is_a_status_and_not_a_crash(systems, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warning to a file
    block, guess = systems["block"], np.ones(3)
    known = campaign(block, np.ones(3), [TOUCHING["block"] * np.nan], guess)
    found = estimate(known, SETTINGS, [Mode(guess, 0.3 * np.eye(len(guess)))], np.random.default_rng(1))
    assert found.status.startswith("failed") and np.isnan(found.rho).all()


def test_information_beyond_round_off_still_gives_a_covariance():
    slope = np.array([[1e9, 0.0], [1e9, 1e-9]])
    mode = mode_of(OptimizeResult(x=np.ones(2), jac=slope))
    assert np.isfinite(mode.spread).all()
