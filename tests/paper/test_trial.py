"""Seeds are reproducible, and every method of a seed meets the same truth, guess and noise."""

import numpy as np
import pytest
from test_design import BUDGET
from test_estimate import SETTINGS

from fimpact.paper.trial import DIAGNOSTICS, TABLE, draw_truth, run_trials

LINES: list[str] = []


@pytest.fixture(scope="module")
def small(config):
    return {**config, "rounds": 2, "design": BUDGET, "estimate": SETTINGS}


@pytest.fixture(scope="module")
def fisher(small):
    return run_trials(small, "block", "fisher", [900, 901], LINES.append)


def test_rows_are_tidy_and_complete(fisher):
    assert list(fisher.table.columns) == TABLE and list(fisher.diagnostics.columns) == DIAGNOSTICS
    assert len(fisher.table) == 2 * 3 * 3  # seeds, rounds with the initial guess, parameters
    assert fisher.designs["designs"].shape == (2, 2, 4)
    assert LINES[-1] == "block fisher: 2 of 2 seeds, 0:00 left"


def test_the_same_seed_twice_and_alone_gives_the_same_rows(small, fisher):
    again = run_trials(small, "block", "fisher", [901], LINES.append).table.drop(columns="seconds")
    first = fisher.table[fisher.table.seed == 901].drop(columns="seconds").reset_index(drop=True)
    assert again.equals(first)


def test_methods_share_truth_and_guess(small, fisher):
    other = run_trials(small, "block", "uniform", [900], LINES.append).table
    mine = fisher.table[(fisher.table.seed == 900)].reset_index(drop=True)
    assert other.truth.equals(mine.truth)
    assert other.estimate[:3].equals(mine.estimate[:3])


def test_information_accumulates_and_error_falls_with_contact(fisher):
    last = fisher.table[fisher.table["round"] == 2]
    assert (last.information_trace > 1e4).all()
    assert last.relative_error.abs().max() < 0.05


def test_the_guess_is_wrong_by_the_prior(systems):
    draws = [draw_truth(systems["arm"], seed) for seed in range(300)]
    error = np.concatenate([guess / rho - 1 for rho, guess in draws])
    assert np.sqrt((error**2).mean()) == pytest.approx(0.3, abs=0.03)
