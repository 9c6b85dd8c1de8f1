"""The scale of an effect is not known: what that costs, against direct integration."""

import numpy as np
import pytest
from scipy import integrate, stats

from fimpact.deciding import NOTHING
from fimpact.smoothing.effect_sizes import of_any_scale


def integrated(sizes, doubts):
    """Logarithm of the evidence of readings `sizes` known to `doubts`, of scales that are even in their logarithm."""

    def at(scale):
        return np.prod(stats.norm.pdf(sizes, 0, np.hypot(doubts, scale)))

    low = np.log(NOTHING)
    whole = integrate.quad(lambda power: at(np.exp(power)), low, 0, points=np.linspace(low, 0, 20)[1:-1])[0] / -low
    return float(np.log(whole / at(1.0)))


@pytest.mark.parametrize(
    ("sizes", "doubts"),
    [([0.01], [1e-3]), ([1.0], [0.1]), ([0.03, 0.05], [1e-3, 1e-2]), ([0.0], [0.2]), ([3.0], [0.5])],
)
def test_every_scale_counts_alike(sizes, doubts):
    told = of_any_scale(["own"] * len(sizes), np.array(sizes), np.array(doubts))
    assert told == pytest.approx(integrated(np.array(sizes), np.array(doubts)), abs=0.15)


def test_what_is_small_is_no_surprise_and_what_is_large_is_a_little_less_expected():
    small, large = (of_any_scale(["own"], np.array([size]), np.array([1e-3])) for size in (0.01, 1.0))
    assert small > 2 and -3 < large < 0


def test_the_amplitudes_of_one_effect_have_one_scale():
    """A small and a large one beside each other are less alike than two small ones."""
    doubts = np.full(2, 1e-3)
    both, apart = (of_any_scale(names, np.array([0.01, 0.01]), doubts) for names in (["a", "a"], ["a", "b"]))
    assert both > apart
    uneven = [of_any_scale(names, np.array([0.01, 1.0]), doubts) for names in (["a", "a"], ["a", "b"])]
    assert uneven[0] < uneven[1]
    assert of_any_scale([], np.array([]), np.array([])) == 0
