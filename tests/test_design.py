"""All methods obey one set of bounds, and the contact-implicit one finds contact where there is none."""

from dataclasses import replace

import numpy as np
import pytest

from fimpact import truth
from fimpact.design import METHODS, POPULATION, Task, best_of_n, contact_blind, evaluate, fisher
from fimpact.reach import contact_free

BUDGET = {
    "criterion": "A",
    "spread": 16,
    "generations": 7,
    "sigma": 0.25,
    "relaxation": [1, 0.5, 0.2, 0],
    "gradients": 2,
}


@pytest.fixture
def task(systems):
    block = systems["block"]
    return Task(block, block.template, np.ones(3), np.eye(3) / 0.09, 0, 5, BUDGET, np.random.default_rng(1))


@pytest.mark.parametrize("method", METHODS)
def test_designs_stay_within_the_bounds(task, method):
    low, high = task.system.inputs.bounds
    design = METHODS[method](task).design
    assert design.shape == low.shape
    assert (design >= low - 1e-12).all() and (design <= high + 1e-12).all()


def test_contact_is_found_from_a_start_that_has_none(task):
    start = contact_free(task, 16)
    steps = [truth.simulate(task.system, task.system.nominal, design)[1] for design in start]
    assert sum(steps) == 0
    assert np.ptp(evaluate(task, start)) < 1e-9  # without relaxation all look alike
    found = fisher(task, start=start)
    assert truth.simulate(task.system, task.system.nominal, found.design)[1] > 0
    assert found.value > evaluate(task, start).max() + 1


def test_fisher_beats_one_uniform_draw_by_its_own_criterion(task):
    draws = task.rng.uniform(*task.system.inputs.bounds, (8, 4))
    assert fisher(task).value > np.median(evaluate(task, draws)) + 1


def test_best_of_n_simulates_what_fisher_may(task):
    limit = BUDGET["spread"] + POPULATION * BUDGET["generations"] + BUDGET["gradients"] * 5
    assert best_of_n(task).candidates == limit


def test_a_contact_blind_throw_is_just_a_draw(task):
    design = contact_blind(task)
    assert np.isclose(design.value, -np.log(3 * 0.09))  # nothing is learned from flight, it believes


def test_multisine_repeats_over_rounds_and_fills_the_range(task):
    phases = [METHODS["multisine"](replace(task, round=r, rng=np.random.default_rng(5))).design for r in range(5)]
    low, high = task.system.inputs.bounds
    assert np.allclose(np.abs((np.array(phases) - (low + high) / 2) / ((high - low) / 2)).max(0), 1)
