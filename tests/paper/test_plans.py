"""What plans are compared with: MuJoCo's own force on the same robot under the same inputs."""

import numpy as np
import pytest
from conftest import TOUCHING

from fimpact.paper import plans, reference_simulator
from fimpact.paper.contact_implicit.plan import planner
from fimpact.paper.task import Task

BUDGET = {"transcription": {"intervals": 1000, "eps": [1e-2], "iterations": 1}}


@pytest.fixture
def played(system):
    """A task, and the plan of one that touches, which one iteration leaves as good as it was."""
    p = len(system.nominal)
    task = Task(system, np.ones((1, p)), np.eye(p), 0, 1, BUDGET, np.random.default_rng(0))
    return task, planner(system, 1000).plan(np.ones(p), TOUCHING[system.name], [1e-2], 1)


def test_simulated_forces_are_those_of_the_sensor(systems):
    arm = systems["arm"]
    force = plans.simulate(arm, arm.nominal, TOUCHING["arm"])
    measured, _ = reference_simulator.simulate(arm, arm.nominal, TOUCHING["arm"])
    assert np.allclose(force, np.stack([-measured[:, 1], measured[:, 0]], 1))


def test_planned_and_simulated_forces_share_their_steps_and_their_impulse(system, played):
    task, plan = played
    planned, simulated = plans.forces(task, plan)
    assert planned.shape == simulated.shape == (len(plan.after), 2)
    assert (planned[:, 0] > 0).all() and (simulated[:, 0] >= 0).all()
    alike, _, ratio = plans.compare(planned, simulated)
    assert 0 < alike < 1
    assert 0.5 < ratio < 2  # a block is thrown back by its soft mat, and not by a rigid one


def test_a_plan_without_contact_is_compared_with_nothing(system, played):
    task, plan = played
    planned, _ = plans.forces(task, plan)
    alike, off, ratio = plans.compare(0 * planned, 0 * planned)
    assert np.isnan(alike) and np.isnan(ratio) and off == 0


def test_a_row_says_what_the_plan_found(config, system):
    least = {"design": {**config["design"], "transcription": BUDGET["transcription"]}, "reach": {"planned": [200]}}
    table, forces = plans.run_plans({**config, **least}, system.name, lambda line: None)
    assert list(table) == plans.COLUMNS and list(forces) == plans.FORCES
    (row,) = table.itertuples()
    assert row.start_contact_steps == 0 and row.residual == pytest.approx(1e-2, rel=0.1)
    assert len(forces) == 2 * len(planner(system, 1000).affine.controls)
