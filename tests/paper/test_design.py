"""All methods obey one set of bounds, and the contact-implicit one finds contact where there is none."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import TOUCHING

from fimpact.paper import reference_simulator
from fimpact.paper.config import SEEN
from fimpact.paper.design import METHODS, best_of_n, contact_blind, evaluate, fisher, transcribe, unknown_directions
from fimpact.paper.estimate import beliefs, untried
from fimpact.paper.reach import contact_free
from fimpact.paper.search import Campaign
from fimpact.paper.systems import make_system
from fimpact.paper.task import Task
from fimpact.paper.trial import design_next

BUDGET = {
    "criterion": "A",
    "draws": 2,
    "spread": 16,
    "approach": 6,
    "generations": 7,
    "sigma": 0.25,
    "gradients": 2,
    "transcription": {"intervals": 20, "eps": [0.1, 1e-3], "iterations": 5},
}
BELIEFS = np.array([[1.0, 1.0, 1.0], [1.2, 0.9, 1.1]])


@pytest.fixture
def task(systems):
    block = systems["block"]
    return Task(block, np.ones((1, 3)), np.eye(3) / 0.09, 0, 5, BUDGET, np.random.default_rng(1))


@pytest.mark.parametrize("method", METHODS)
def test_designs_stay_within_the_bounds(task, method):
    low, high = task.system.inputs.bounds
    design = METHODS[method](task).design
    assert design.shape == low.shape
    assert (design >= low - 1e-12).all() and (design <= high + 1e-12).all()


def test_contact_is_found_from_a_start_that_has_none(task):
    start = contact_free(task, task.beliefs, 16)
    steps = [reference_simulator.simulate(task.system, task.system.nominal, design)[1] for design in start]
    assert sum(steps) == 0
    assert np.ptp(evaluate(task, start)) < 1e-9  # by information all look alike
    found = fisher(task, start=start)
    assert reference_simulator.simulate(task.system, task.system.nominal, found.design)[1] > 0
    assert found.value > evaluate(task, start).max() + 1


def test_only_a_start_that_does_not_touch_has_to_approach(task, monkeypatch):
    approached = []
    monkeypatch.setattr("fimpact.paper.design.approach", lambda task, start: approached.append(1) or start[0])
    clear = contact_free(task, task.beliefs, 16)
    fisher(task, start=np.vstack([clear[1:], TOUCHING["block"]]))
    assert not approached
    fisher(task, start=clear)
    assert approached


def test_the_criterion_is_its_mean_over_what_is_believed(task):
    throws = task.rng.uniform(*task.system.inputs.bounds, (4, 4))
    each = [evaluate(replace(task, beliefs=rho[None]), throws) for rho in BELIEFS]
    assert np.allclose(evaluate(replace(task, beliefs=BELIEFS), throws), np.mean(each, 0))


def test_a_guess_that_cannot_touch_does_not_keep_the_arm_from_the_wall(systems):
    # The guess is an arm of 0.52 m for a wall at 0.65 m: at the guess alone all torques look alike.
    arm, guess = systems["arm"], np.array([1.0, 1.0, 1.0, 0.6, 0.55, 0.58])
    nothing = Campaign(arm, arm.template, (), guess, 0.3)
    rng = np.random.default_rng(1)
    sure = Task(arm, guess[None], np.eye(6) / 0.09, 0, 5, BUDGET, rng)
    assert np.ptp(evaluate(sure, rng.uniform(*arm.inputs.bounds, (32, 24)))) < 1e-9
    robust = replace(sure, beliefs=beliefs(nothing, untried(nothing), 4, rng))
    assert reference_simulator.simulate(arm, arm.nominal, fisher(robust).design)[1] > 0


def test_fisher_beats_one_uniform_draw_by_its_own_criterion(task):
    draws = task.rng.uniform(*task.system.inputs.bounds, (8, 4))
    assert fisher(task).value > np.median(evaluate(task, draws)) + 1


@pytest.mark.parametrize("believed", [BELIEFS[:1], BELIEFS])
def test_best_of_n_simulates_what_fisher_may(task, monkeypatch, believed):
    counts = []

    def counted(task, candidates, blind=False):
        counts.append(len(candidates))
        return evaluate(task, candidates, blind)

    monkeypatch.setattr("fimpact.paper.design.evaluate", counted)
    fair = [replace(task, beliefs=believed, rng=np.random.default_rng(1)) for _ in range(2)]
    one = fisher(fair[0])
    assert sum(counts) <= one.candidates
    counts.clear()
    assert best_of_n(fair[1]).candidates == one.candidates == sum(counts)


def test_a_contact_blind_throw_is_just_a_draw(task):
    design = contact_blind(task)
    assert np.isclose(design.value, -np.log(3 * 0.09))  # nothing is learned from flight, it believes


def test_a_thrown_multisine_goes_on_from_round_to_round_and_fills_the_range(task):
    campaign = Campaign(task.system, task.system.template, (), task.beliefs[0], 0.3)
    found, config = untried(campaign), {"design": BUDGET}
    throws = [design_next(config, campaign, found, "multisine", 3, round_, 5).design for round_ in range(5)]
    low, high = task.system.inputs.bounds
    assert np.allclose(np.abs((np.array(throws) - (low + high) / 2) / ((high - low) / 2)).max(0), 1)


def test_where_every_start_touches_there_is_a_word_and_no_endless_search(systems, task):
    near = make_system("block", {**systems["block"].settings, "surface": -0.02})
    with pytest.raises(ValueError, match=r"move systems\.block\.surface away"):
        contact_free(replace(task, system=near), task.beliefs, 16)


def test_where_the_estimate_cannot_touch_what_else_is_believed_is_tried(systems):
    # The estimate is an arm of 0.52 m for a wall at 0.65 m; one of the beliefs is long enough.
    arm, short = systems["arm"], np.array([1.0, 1.0, 1.0, 0.6, 0.55, 0.58])
    believed, rng = np.array([[1.0, 1.0, 1.0, 1.2, 1.2, 1.2]]), np.random.default_rng(1)
    budget = BUDGET | {"transcription": {"intervals": 50, "eps": [1e-4], "iterations": 3}}
    task = Task(arm, believed, np.eye(6) / 0.09, 0, 5, budget, rng, short)
    plan = transcribe(task, TOUCHING["arm"])
    assert np.array_equal(plan.rho, believed[0])
    assert transcribe(replace(task, estimate=believed[0]), TOUCHING["arm"]).iterations < plan.iterations


def test_a_system_without_rigid_body_terms_is_told_so(task):
    own = replace(task.system, name="cart")
    with pytest.raises(ValueError, match=r"no rigid-body terms of system 'cart', only of arm, block"):
        METHODS["contact_implicit"](replace(task, system=own))


@pytest.mark.parametrize("method", METHODS)
def test_a_method_looks_at_no_key_but_those_that_rerun_it(task, method):
    METHODS[method](replace(task, budget={key: BUDGET[key] for key in SEEN[method]}))


def test_a_refined_design_is_no_worse(task):
    without = fisher(replace(task, budget=BUDGET | {"gradients": 0}, rng=np.random.default_rng(1)))
    assert fisher(task).value >= without.value


def test_the_units_are_what_is_not_known():
    known = np.array([[4.0, 1.0], [1.0, 100.0]])
    units = unknown_directions(known)
    assert np.allclose(units @ units.T, np.linalg.inv(known) * np.linalg.eigvalsh(known).min())
    assert np.allclose(unknown_directions(np.eye(3) / 0.09) @ unknown_directions(np.eye(3) / 0.09).T, np.eye(3))


def test_a_plan_that_does_not_touch_is_tried_again_from_another_start(task, monkeypatch):
    def planned() -> tuple[int, np.ndarray]:
        plan = transcribe(replace(task, rng=np.random.default_rng(1)))
        return plan.iterations, plan.designs

    monkeypatch.setattr("fimpact.paper.design.touches", lambda task, values: True)
    once, first = planned()
    monkeypatch.setattr("fimpact.paper.design.touches", lambda task, values: False)
    twice, best = planned()
    assert twice > once and evaluate(task, best).max() >= evaluate(task, first).max()


def test_what_cannot_be_simulated_is_worth_less_than_nothing(task, monkeypatch):
    class Wild:
        def linearise(self, rho, design, blind):
            return None, np.stack([np.full((2, 3), size) for size in (np.nan, 1e200, 1e12, 0.0)])

    monkeypatch.setattr("fimpact.paper.design.forecaster", lambda system: Wild())
    lost, endless, chaotic, silent = evaluate(task, np.zeros((4, 4)))
    nothing = -np.log(3 * 0.09)
    assert silent == pytest.approx(nothing) and lost == endless == pytest.approx(nothing - 1)
    assert np.isfinite(chaotic)
