"""What coefficients cost: much where the data have chosen them, next to nothing where they say nothing of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch.price import STATED, price
from fimpact.mismatch.step import plainer
from fimpact.mismatch.weigh import _paid

SAMPLES = 1000
ONE = np.log(SAMPLES)


def fitted(effect, values, sd, sizes=None, free=None):
    """A fit of one effect alone whose coefficients are known to within `sd`, each."""
    names = [name for name in values if free is None or name in free]
    return SimpleNamespace(
        point=SimpleNamespace(
            residual=np.ones((2, SAMPLES // 2)),
            hypothesis=SimpleNamespace(placed=(Placed(EFFECTS[effect], "joint", values, sizes or {}),)),
        ),
        coordinates=SimpleNamespace(unknowns=1, values=tuple((0, name) for name in names)),
        linear=SimpleNamespace(projected=np.ones((2, SAMPLES // 2, 1 + len(names)))),
        covariance=np.diag([1.0, *(sd[name] ** 2 for name in names)]),
    )


def alike(sd):
    return fitted("direction_dependent_coulomb", {"forward": 0.3, "backward": 0.4}, {"forward": sd, "backward": sd})


def test_a_second_amplitude_costs_what_the_data_know_of_it():
    assert price((alike(0.05),)) == pytest.approx((ONE + np.log(1 + 10**2), 0.0))
    assert price((alike(50.0),)) == pytest.approx((ONE, 0.0), abs=1e-3)
    assert price((alike(1e-9),)) == pytest.approx((2 * ONE, 0.0))


def test_one_amplitude_costs_as_in_schwarz_s_criterion():
    alone = fitted("coulomb", {"friction": 0.3}, {"friction": 0.01})
    assert price((alone, alone)) == pytest.approx((np.log(2 * SAMPLES), 0.0))


def test_a_shape_costs_what_the_data_know_of_it_among_its_probes():
    values, sizes = {"friction": 0.3, "displacement": 0.02}, {"friction": 0.1, "displacement": 0.1}
    known = fitted("dahl", values, {"friction": 0.01, "displacement": 0.05}, sizes)
    assert price((known,)) == pytest.approx((ONE, np.log(1 + 2**2)))
    better = np.diag([1.0, 1e-4, 1e-4])
    assert price((known,), better) == pytest.approx((ONE, np.log(1 + 10**2)))


def test_what_does_nothing_costs_nothing():
    values = {"friction": 0.3, "displacement": 0.02}
    silent = fitted("dahl", values, {"friction": 0.01, "displacement": 0.0}, {"friction": 0.1, "displacement": 0.1})
    assert price((silent,)) == pytest.approx((ONE, 0.0))


def test_a_shape_as_it_was_stated_costs_little():
    values = {"friction": 0.3, "displacement": 0.02}
    stated = fitted("dahl", values, {"friction": 0.01}, {"friction": 0.1, "displacement": 0.1}, free=["friction"])
    assert price((stated,)) == pytest.approx((ONE, STATED))


def test_dispersed_data_know_less_of_a_shape():
    values, sizes = {"friction": 0.3, "displacement": 0.02}, {"friction": 0.1, "displacement": 0.1}
    known = fitted("dahl", values, {"friction": 0.01, "displacement": 0.05}, sizes)
    rival, optimum = SimpleNamespace(parts=(known,)), SimpleNamespace(covariance=known.covariance)
    assert _paid([rival], [optimum], 16.0) == pytest.approx(np.array([[ONE, np.log(1 + 0.5**2)]]))


@pytest.mark.parametrize(
    ("shown", "weight", "leads"), [(0.0, 0.4, "coulomb"), (1.0, 0.4, "stribeck"), (0.0, 0.001, "stribeck")]
)
def test_an_effect_whose_shape_means_nothing_does_not_lead_over_the_one_without_it(shown, weight, leads):
    """But for one that the data refute: then the shape was needed on the way."""

    def rival(effect, weight, values, precision):
        found = fitted(effect, values, dict.fromkeys(values, 0.01))
        found.precision, found.scale = np.diag([1.0, *precision]), np.ones(1 + len(precision))
        return SimpleNamespace(placed=found.point.hypothesis.placed, fitted=found, weight=weight)

    at_rest = rival("stribeck", 0.6, {"coulomb": 0.2, "excess": 0.0, "speed": 0.01}, [1.0, 0.0, shown])
    rivals = [
        at_rest,
        rival("viscous", 0.5, {"damping": 0.1}, [1.0]),
        rival("coulomb", weight, {"friction": 0.2}, [1.0]),
    ]
    assert plainer(at_rest, rivals).placed[0].effect.name == leads
