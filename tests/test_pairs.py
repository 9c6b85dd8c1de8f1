"""Two effects that hide each other are found together, and only where their strengths are possible."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch.merge import merged
from fimpact.mismatch.pairs import gains, pairs
from fimpact.mismatch.score import Candidate

FREE, DRY, OFFSET = ("torque_offset", "motor_1"), ("coulomb", "joint_1"), ("sensor_bias", "encoder_1")


def candidate(what, column, residual):
    """A candidate with the projected sensitivity `column` (m,) against `residual` (m,)."""
    effect, site = what
    column, information = np.array([column], float), float(np.dot(column, column))
    score = float(column[0] @ residual)
    placed = Placed(EFFECTS[effect], site, dict(EFFECTS[effect].neutral))
    return Candidate(placed, np.array([score]), information, score / information, 0.0, 0.0, column, column)


def three(residual):
    columns = [1, 0, 0.0], [0.9, 0.6, 0.0], [0, 0, 1.0]
    return [candidate(*given, np.array(residual)) for given in zip((FREE, DRY, OFFSET), columns, strict=True)]


def test_a_pair_gains_what_neither_gains_alone():
    given = three([0.0, 10.0, 0.0])  # the first alone explains nothing
    gain, strength = gains(given)
    assert given[0].gain == 0
    assert given[1].gain < 0.5 * gain[0, 1]
    assert gain[0, 1] == pytest.approx(100.0)
    assert (strength[0, 1], strength[1, 0]) == pytest.approx((-15.0, 10 / 0.6))


def test_each_begins_at_its_strength_beside_the_other():
    best = pairs(three([0.0, 10.0, 0.0]), 1)
    assert [c.placed.effect.name for c in best[0]] == ["torque_offset", "coulomb"]
    assert [c.strength for c in best[0]] == pytest.approx([-15.0, 10 / 0.6])


@pytest.mark.parametrize("residual", [[0.0, -10.0, 0.0], [0.0, 1e4, 0.0]])
def test_no_pair_needs_a_negative_friction_or_a_strength_beyond_belief(residual):
    assert gains(three(residual))[0][0, 1] == 0


def test_two_probes_of_one_effect_are_no_pair():
    one, other, _ = three([1.0, 10.0, 0.0])
    same = SimpleNamespace(**{**vars(other), "placed": one.placed})
    assert gains([one, same])[0].max() == 0


def tilted(values, column, residual):
    found = candidate(("gravity_tilt", "world"), column, residual)
    return replace(found, placed=replace(found.placed, values=values))


def beside_nothing(residual):
    """A fit without coordinates or initial states."""
    linear = SimpleNamespace(off=lambda columns: columns, projected=np.zeros((1, len(residual), 0)), colour=None)
    point = SimpleNamespace(residual=residual[None])
    return SimpleNamespace(linear=linear, point=point, covariance=np.zeros((0, 0)), pull=np.zeros(0))


def test_what_leans_between_two_axes_counts_whole():
    residual, still = np.array([3.0, -4.0, 0.0]), {"tilt_z": 0.0}
    about_x = tilted({"tilt_x": 0.01, "tilt_y": 0.0, **still}, [1.0, 0, 0], residual)
    about_y = tilted({"tilt_x": 0.0, "tilt_y": 0.01, **still}, [0, 1.0, 0], residual)
    (found,) = merged(beside_nothing(residual), [about_x, about_y, candidate(DRY, [0.9, 0.6, 0], residual)])
    assert (about_x.gain, about_y.gain) == pytest.approx((9.0, 16.0)) and found.gain == pytest.approx(25.0)
    assert found.start().values == pytest.approx({"tilt_x": 0.03, "tilt_y": -0.04, **still})


@pytest.mark.parametrize(("residual", "mixed"), [((3.0, -4.0), []), ((3.0, 4.0), [{"forward": 0.3, "backward": 0.4}])])
def test_what_bounds_forbid_is_not_mixed(residual, mixed):
    kind, both = ("direction_dependent_coulomb", "joint_1"), {"forward": 0.0, "backward": 0.0}
    ways = [candidate(kind, column, np.array(residual)) for column in ([1.0, 0.0], [0.0, 1.0])]
    ways = [replace(w, placed=replace(w.placed, values=both | {n: 0.1})) for w, n in zip(ways, both, strict=True)]
    found = merged(beside_nothing(np.array(residual)), ways)
    assert [c.start().values for c in found] == [pytest.approx(values) for values in mixed]
