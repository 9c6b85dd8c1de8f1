"""A motion linearised step by step says what any small force does to it."""

from dataclasses import replace

import numpy as np
import pytest
from planted import record

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch import pulses
from fimpact.mismatch.colour import colour
from fimpact.mismatch.coordinates import NOTHING
from fimpact.mismatch.disturbance import Disturbance
from fimpact.mismatch.fit import fit
from fimpact.mismatch.judge import bench
from fimpact.mismatch.score import _Secant
from fimpact.mismatch.settle import first_point
from fimpact.mismatch.simulate import Hypothesis
from fimpact.mismatch.tangent import has_tangent, tangent

CABLE = {"stiffness": 0.1, "anchor_x": 0.2, "anchor_y": -0.1, "anchor_z": 0.0}


@pytest.fixture(scope="module")
def moving():
    problem = bench(record(3, runs=3)).training
    return problem, first_point(problem, NOTHING, Hypothesis(problem.simulator.theta))


def test_the_response_to_a_force_is_the_slope_of_the_simulation(moving):
    problem, point = moving
    found, (count, nv) = tangent(problem, point), point.qvel.shape
    force = np.random.default_rng(0).normal(size=(count, len(found.passed), nv))
    where = point.hypothesis, problem.windows, point.qpos, point.qvel
    moved = [problem.simulator.predict(*where, push=size * force) for size in (0.0, 1e-4)]
    np.testing.assert_allclose(found.response(force[..., None])[..., 0], (moved[1] - moved[0]) / 1e-4, atol=1e-4)


LAWS = [
    ("cable_pull", "link_2", CABLE),
    ("payload", "link_2", {"mass": 0.01, "place": 0.1}),  # no force: it is simulated in its turn
    ("quadratic_drag", "link_2", {"coefficient": 0.01}),
    ("dahl", "joint_1", {"friction": 0.001, "displacement": 0.05}),  # a law that remembers
]


def test_the_slope_of_a_force_law_needs_no_simulation_of_its_own(moving, monkeypatch):
    problem, point = moving
    placed, linear = [Placed(EFFECTS[name], *rest) for name, *rest in LAWS], problem.linearise(point, NOTHING)
    fitted = type("Fitted", (), {"point": point, "linear": linear})
    along = list(_Secant(problem, fitted).each(placed))
    monkeypatch.setattr("fimpact.mismatch.score.has_tangent", lambda *_: False)
    for slope, beside in zip(along, _Secant(problem, fitted).each(placed), strict=True):
        assert np.abs(beside).max() > 1e-3
        np.testing.assert_allclose(slope, beside, atol=0.02 * np.abs(beside).max())


def test_a_linearised_motion_that_diverges_still_has_a_colour(moving, monkeypatch):
    problem, point = moving
    wild = tangent(problem, point)
    wild.move[:, 0] *= 1e9
    monkeypatch.setattr(pulses, "tangent", lambda *_: wild)
    shade = colour(pulses.pulses(problem, fit(problem, NOTHING, point, 1)), Disturbance(np.array([20.0, 10.0]), 1.0))
    assert np.isfinite(shade.louder).all() and np.isfinite(shade.directions).all()


def test_a_law_that_depends_on_the_state_has_no_tangent(moving):
    problem, point = moving
    cable = Placed(EFFECTS["cable_pull"], "link_2", CABLE)
    assert has_tangent(problem.simulator, point)
    assert not has_tangent(problem.simulator, replace(point, hypothesis=Hypothesis(point.hypothesis.theta, (cable,))))
