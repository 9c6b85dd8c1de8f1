"""Sensitivities against finite differences, information against its definition, and what stays invisible."""

import jax.numpy as jnp
import numpy as np
import pytest
from conftest import CLEAR, TOUCHING

from fimpact.paper.information.fisher import CRITERIA, empirical_information, fisher, identifiability, score
from fimpact.paper.information.programs import programs


def test_forward_sensitivities_through_contact_match_central_differences(system):
    compiled, design, one = programs(system), TOUCHING[system.name], np.ones(len(system.nominal))
    slope = compiled.linearise(system.template, one, design).sensitivity[0]
    h = 1e-6
    both = np.vstack([one + h * np.eye(len(one)), one - h * np.eye(len(one))])
    up, down = np.split(compiled.linearise(system.template, both, design).measurement, 2)
    assert np.abs(slope).max() > 100
    assert np.abs(slope - ((up - down) / (2 * h)).T).max() < 1e-3 * np.abs(slope).max()


def test_no_contact_no_information(system):
    one = np.ones(len(system.nominal))
    slope = programs(system).linearise(system.template, one, CLEAR[system.name]).sensitivity[0]
    assert np.trace(fisher(slope)) < 1e-9


def test_fisher_information_is_the_mean_of_the_papers_empirical_one():
    rng = np.random.default_rng(0)
    slope = jnp.array(rng.normal(size=(30, 3)))
    noise = jnp.array(rng.normal(size=(20_000, 30)))
    mean = sum(empirical_information(slope, e) for e in noise[:2000]) / 2000
    assert score(slope, noise[0]).shape == (30, 3)
    assert np.abs(mean - fisher(slope)).max() < 0.1 * np.trace(fisher(slope))


@pytest.mark.parametrize(
    ("name", "value"), [("trace", np.log(111)), ("A", -np.log(1.11)), ("D", np.log(1000)), ("E", 0.0)]
)
def test_criteria_of_a_known_matrix(name, value):
    known = np.diag([1.0, 10.0, 100.0])
    assert CRITERIA[name](known) == pytest.approx(value, abs=1e-12)
    assert CRITERIA[name](np.stack([known, 2 * known])).shape == (2,)


def test_identifiability_names_the_invisible_direction():
    report = identifiability(np.diag([0.0, 1e4, 20.0]), ("mass", "width", "height"), 0.3)
    assert report.verdict[0] == "+1.00 mass: not visible at all"
    assert "height" in report.verdict[1] and "hardly more than the prior" in report.verdict[1]
    assert report.verdict[2] == "+1.00 width: known to 1 %"
    assert report.standard_errors[0] == pytest.approx(0.3)
