"""The column of a hypothesis is the difference that it makes to what is predicted."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from recorded import arm, rod

from fimpact.effects import EFFECTS
from fimpact.selection.regression import Regression
from fimpact.smoothing.candidates import at
from fimpact.smoothing.columns import SMALL, changes, columns, motion_scales
from fimpact.smoothing.dynamics.linear import linearise
from fimpact.smoothing.dynamics.response import heavier
from fimpact.smoothing.filter.by_run import swept
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth


@cache
def naive(friction: float = 0.0):
    """The smoothed arm, nothing missing, or the rod with dry friction that its model lacks."""
    prepared = prepare(rod(friction) if friction else replace(arm(), unknowns=()))
    return smooth(prepared.track, prepared.begun, prepared.noise)


def candidate(smoothed, effect: str, site: str, choice: int = 0):
    return at(EFFECTS[effect], site, smoothed.track.model, motion_scales(smoothed))[choice]


def unit_of(smoothed, own):
    """What a unit of the prior of a linear effect does."""
    return changes(smoothed, [own.placed([SMALL * sd for sd in own.sd])])[0].scaled(1 / SMALL)


def innovations_with(smoothed, placed) -> np.ndarray:
    """Innovations of the data, (N, ny), under a model that has `placed`, along the same trajectory."""
    track, model = smoothed.track, smoothed.linear.plant.model
    laws = (placed,) if placed else ()
    tau = smoothed.tau * heavier(track.model_of(laws, smoothed.theta), model)
    linear = linearise(track, [], laws, smoothed.states, tau, smoothed.doubt, smoothed.theta)
    same = replace(linear, advance=smoothed.linear.advance, reads=smoothed.linear.reads)
    return swept(track, same, smoothed.filter, -smoothed.tau[:, :, None])[0][:, :, 0]


@pytest.mark.parametrize(
    ("effect", "site", "amplitude"),
    [
        ("viscous", "elbow", 0),
        ("viscous", "shoulder", 0),
        ("coulomb", "shoulder", 0),
        ("rotor_inertia", "elbow", 0),
        ("gravity_scale", "world", 0),
        ("sensor_bias", "q2", 0),
        ("gain", "m1", 0),
        ("command_delay", "m2", 0),
        ("com_shift", "lower", 1),
        ("quadratic_damping", "shoulder", 0),
        ("dahl", "elbow", 0),
    ],
)
def test_a_column_is_the_difference_of_predictions(effect, site, amplitude):
    smoothed = naive()
    own = candidate(smoothed, effect, site)
    share = SMALL if own.effect.linear else 1.0
    values = np.zeros(len(own.names))
    values[amplitude] = share * own.sd[amplitude]
    column = columns(smoothed, [own]).innovations[:, :, 1 + amplitude]
    change = (innovations_with(smoothed, None) - innovations_with(smoothed, own.placed(values))) / share
    assert np.abs(column).max() > 0
    # A column is taken at the plain time step, predictions with its error extrapolated away: the size differs by that.
    np.testing.assert_allclose(column, change, atol=0.25 * np.abs(column).max())
    # The force of an edit is held over a sample, in which a quick arm turns by a tenth of a radian and more.
    assert np.corrcoef(column.ravel(), change.ravel())[0, 1] > 0.98


def test_data_come_first_and_are_what_the_model_leaves():
    smoothed = naive()
    found = columns(smoothed, [])
    np.testing.assert_allclose(found.innovations[:, :, 0], innovations_with(smoothed, None), atol=1e-6)
    np.testing.assert_allclose(found.forces[:, :, 0], smoothed.tau, atol=0.02 * smoothed.levels.force.max())


def test_the_missing_force_that_a_column_stands_for_is_that_of_its_law():
    smoothed = naive(0.15)
    own = candidate(smoothed, "coulomb", "pivot")
    found = columns(smoothed, [own])
    missing, column = found.forces[:, 0, 0], found.forces[:, 0, 1]
    assert own.sd[0] * (missing @ column) / (column @ column) == pytest.approx(0.15, rel=0.05)
    assert np.mean((missing - 0.15 / own.sd[0] * column) ** 2) < 0.4 * np.mean(missing**2)


def test_the_column_of_a_gain_is_the_torque_that_the_model_needs():
    """The applied torque holds what friction took of it: with a column of that, a gain would explain all friction."""
    smoothed = naive(0.15)
    track, own = smoothed.track, candidate(smoothed, "gain", "motor")
    change = unit_of(smoothed, own)
    force = change.force[:, 0] / own.sd[0]
    needed, applied = track.ctrl[:, 0, 0] + smoothed.tau[:, 0], track.ctrl[:, 0, 0]
    rows = ~track.last
    assert np.abs(smoothed.tau).mean() > 0.05
    np.testing.assert_allclose(force[rows], needed[rows], atol=0.01 * np.abs(needed).max())
    assert np.abs(force - applied)[rows].mean() > 0.05
    assert not change.after.any() and not change.readings.any()


def test_what_a_limit_would_not_have_let_happen_has_no_column():
    smoothed = naive(0.15)
    scales = motion_scales(smoothed)
    offered = at(EFFECTS["saturation"], "motor", smoothed.track.model, replace(scales, needed=0.5 * scales.needed))
    limits = [own.shapes["limit"] for own in offered]
    needed = np.quantile(np.abs(smoothed.track.ctrl[:, 0, 0] + smoothed.tau[:, 0]), 0.99)
    kept = {limits[owner] for owner, _ in columns(smoothed, offered).owners}
    assert any(1.1 * limit < needed for limit in limits)
    assert kept == {limit for limit in limits if 1.1 * limit > needed}


def test_what_nothing_shows_has_no_column():
    smoothed = naive()
    other = candidate(smoothed, "viscous", "elbow")
    found = columns(smoothed, [replace(other, sd=(0.0,)), other])
    assert found.of(0) == [] and found.of(1) == [0]


def test_a_regression_on_a_column_returns_what_was_planted():
    """In units of the prior's sd, on data that have the column so many times in them."""
    smoothed = naive()
    found = columns(smoothed, [candidate(smoothed, "viscous", "elbow")])
    planted = replace(found, innovations=found.innovations.copy())
    planted.innovations[:, :, 0] += 0.3 * found.innovations[:, :, 1]
    before, after = (Regression(smoothed, own).solve([0], 1.0).values[0] for own in (found, planted))
    assert after - before == pytest.approx(0.3, rel=0.01)
