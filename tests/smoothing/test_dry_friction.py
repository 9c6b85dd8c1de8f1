"""Dry friction in a fit is the expected sign of the speed, with a slope that no time step overshoots."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from recorded import rod

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.smoothing.dynamics.dry_friction import STEEP, Rubbing, rubbing
from fimpact.smoothing.dynamics.laws import middle
from fimpact.smoothing.prepare import Prepared, prepare

FRICTION = 0.1


@cache
def prepared() -> Prepared:
    return prepare(rod(FRICTION), refine=1)


def rubbed(doubt: float, sign=None, added: float = FRICTION, laws=()) -> tuple[Rubbing, np.ndarray]:
    """Dry friction where speeds are known to `doubt`, and the speeds half a sample later, (N,)."""
    made = prepared()
    track, states = made.track, made.begun
    still = np.zeros_like(states.qvel)
    found = rubbing(track, track.model, np.array([added]), laws, states, still, still + doubt, sign)
    return found, middle(track, states)[1][:, 0]


def test_friction_is_against_a_speed_that_is_known():
    found, speed = rubbed(1e-3)
    quick = np.abs(speed) > 1.0
    np.testing.assert_allclose(found.sign[quick, 0], np.sign(speed[quick]), atol=1e-3)
    np.testing.assert_allclose(found.force[quick, 0], -FRICTION * np.sign(speed[quick]), atol=1e-3 * FRICTION)


@pytest.mark.parametrize("doubt", [0.3, 1.0])
def test_the_slope_is_that_of_the_force_by_the_speed(doubt):
    made, step = prepared(), 1e-4
    track, states = made.track, made.begun
    faster = type(states)(states.qpos, states.qvel + step, states.act)
    tau, spread = np.zeros_like(states.qvel), np.full_like(states.qvel, doubt)
    one, other = (rubbing(track, track.model, np.array([FRICTION]), (), own, tau, spread) for own in (states, faster))
    assert (one.slope < 0).any() and (one.slope <= 0).all()
    np.testing.assert_allclose(one.slope, (other.force - one.force) / step, atol=1e-3 * np.abs(one.slope).max())


def test_a_sign_that_is_frozen_gives_no_slope():
    sign = np.linspace(-1, 1, prepared().track.count)[:, None]
    found, _ = rubbed(0.5, sign)
    assert not found.slope.any()
    np.testing.assert_array_equal(found.sign, sign)
    np.testing.assert_allclose(found.force, -FRICTION * sign)


def test_no_slope_is_steeper_than_what_stops_a_joint_within_a_sample():
    track = prepared().track
    steepest = STEEP / (track.model.dof_invweight0[0] * track.period)
    found, _ = rubbed(1e-6, added=100.0)
    assert found.slope.min() == pytest.approx(-steepest)
    gentle, _ = rubbed(1.0)
    assert gentle.slope.min() > -steepest


def test_friction_that_differs_with_the_direction_is_that_of_the_sign():
    def law(state, site, forward, backward):
        return np.full(1, forward), np.full(1, backward)

    effect = replace(EFFECTS["stribeck"], law=law, neutral={"forward": 0.0, "backward": 0.0})
    placed = Placed(effect, "pivot", {"forward": 0.1, "backward": 0.03})
    ones = np.ones((prepared().track.count, 1))
    forward, backward, neither = (rubbed(0.1, s * ones, 0.0, (placed,))[0].force[0, 0] for s in (1.0, -1.0, 0.0))
    assert (forward, backward) == pytest.approx((-0.1, 0.03))
    assert neither == pytest.approx((forward + backward) / 2)


def test_friction_of_the_model_and_of_a_law_add_up():
    placed = Placed(EFFECTS["stribeck"], "pivot", {"coulomb": 0.05, "excess": 0.0, "speed": 0.3})
    ones = np.ones((prepared().track.count, 1))
    both = rubbed(0.1, ones, FRICTION, (placed,))[0].force
    np.testing.assert_allclose(both, -FRICTION - 0.05)
