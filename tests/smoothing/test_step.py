"""A step of the numbers: data count as often as stretches of them are independent, and priors hold what data leave."""

from dataclasses import replace

import numpy as np
import pytest

from fimpact.smoothing.parameters import Parameter
from fimpact.smoothing.step import normal

STRETCHES, LENGTH, TRUTH = 200, 20, 0.01
STRETCH = np.repeat(np.arange(STRETCHES), LENGTH)


def number(
    value: float = 0.0, sd: float = 1.0, mean: float = 0.0, log: bool = False, low: float = -np.inf
) -> Parameter:
    return Parameter("friction", "coulomb@pivot", "N m", 0, value, mean, sd, low, np.inf, log, 1.0)


def mass(value: float) -> Parameter:
    """A mass of 0.3 kg, known to a half, that stands at another value."""
    return number(value, 0.15, 0.3, True, np.finfo(float).tiny)


def innovations(repeats: int, seed: int = 0) -> np.ndarray:
    """Data (N, 1) that hold `TRUTH` of a column of ones and noise of unit variance, each of it so often in a row."""
    noise = np.repeat(np.random.default_rng(seed).standard_normal(len(STRETCH) // repeats), repeats)
    return np.stack([TRUTH + noise, np.full(len(STRETCH), -1.0)], 1)[:, None]


def test_white_innovations_count_as_what_they_are():
    data = innovations(1)
    step, chi2, penalty, information, dispersion = normal(data, [number()], STRETCH)
    assert dispersion == pytest.approx(1, abs=0.25)
    assert information[0, 0] == pytest.approx(len(STRETCH) / dispersion + 1)
    mean = data[:, 0, 0].mean()
    assert step[0] == pytest.approx(mean, rel=1e-3)
    assert chi2 == pytest.approx(np.sum((data[:, 0, 0] - step[0]) ** 2))
    assert penalty == pytest.approx(step[0] ** 2)


def test_innovations_that_repeat_one_another_count_less_and_the_prior_more():
    white, repeated = normal(innovations(1), [number()], STRETCH), normal(innovations(LENGTH), [number()], STRETCH)
    assert repeated[4] == pytest.approx(LENGTH, rel=0.3)
    assert repeated[3][0, 0] - 1 == pytest.approx(len(STRETCH) / repeated[4])
    assert repeated[3][0, 0] < 0.1 * white[3][0, 0]
    # The same prior, a hundredth of what one white sample would hold against it: how far either holds the step back.
    held = []
    for repeats in (1, LENGTH):
        data = innovations(repeats)
        held.append(1 - normal(data, [number(sd=0.05)], STRETCH)[0][0] / data[:, 0, 0].mean())
    assert held[1] > 5 * held[0] > 0


def test_what_a_number_explains_is_no_dispersion():
    """Neither what it does more in some stretches than in others, nor what a prior keeps it from in all of them."""
    data = innovations(1)
    data[STRETCH % 2 == 0] *= 3.0
    data[:, 0, 0] = innovations(1)[:, 0, 0] - 5.0 * data[:, 0, 1]
    assert normal(data, [number(sd=10.0)], STRETCH)[4] == pytest.approx(1, abs=0.25)
    held = innovations(1)
    held[:, 0, 0] += 5.0
    step, *_, dispersion = normal(held, [number(sd=1e-4)], STRETCH)
    assert step[0] < 1e-2 and dispersion == pytest.approx(1, abs=0.25)


def test_a_dispersion_is_not_left_at_once():
    data = innovations(LENGTH)
    found = normal(data, [number()], STRETCH)[4]
    assert normal(data, [number()], STRETCH, 1.0)[4] == pytest.approx(np.sqrt(found))


def test_few_stretches_tell_no_dispersion():
    assert normal(innovations(LENGTH), [number()], np.zeros(len(STRETCH), int))[4] == 1.0


def test_nothing_is_stepped_without_numbers_and_nothing_along_what_is_no_number():
    data = innovations(1)
    step, chi2, penalty, *_ = normal(data[:, :, :1], [], STRETCH)
    assert not len(step) and penalty == 0 and chi2 == pytest.approx((data[:, :, 0] ** 2).sum())
    data[3, 0, 1] = np.inf
    assert normal(data, [number()], STRETCH)[1] == np.inf


def test_a_number_stays_within_its_bounds_and_the_others_make_the_best_of_it():
    data = np.random.default_rng(0).standard_normal((len(STRETCH), 1, 3))
    data[:, 0, 2] += data[:, 0, 1]  # much alike
    data[:, 0, 0] = 0.2 * data[:, 0, 1] - 0.5 * data[:, 0, 2]  # minus columns, times values
    np.testing.assert_allclose(normal(data, [number(), number()], STRETCH)[0], [-0.2, 0.5], rtol=1e-2)
    held = normal(data, [number(low=0.0), number()], STRETCH)[0]
    alone = normal(data[:, :, [0, 2]], [number()], STRETCH)[0]
    assert held[0] == pytest.approx(0, abs=1e-9) and held[1] == pytest.approx(alone[0], rel=1e-3)
    assert abs(alone[0] - 0.5) > 0.05


@pytest.mark.parametrize("value", [0.9, 0.3, 0.03, 3e-4, 3e-9])
def test_the_prior_of_what_is_more_than_nothing_is_in_logarithms(value):
    own = mass(value)
    assert own.spread == pytest.approx(0.5)
    assert own.away * own.spread == pytest.approx(np.log(0.3 / value), abs=1e-12)


def test_a_mass_does_not_fall_to_nothing_at_no_cost():
    nothing_told = np.zeros((len(STRETCH), 1, 2))
    costs = [normal(nothing_told, [mass(value)], STRETCH)[2] for value in (0.3, 0.03, 3e-3, 3e-4)]
    assert np.all(np.diff(costs) > 5)  # each tenth of it dearer by far than one sd
    step = normal(nothing_told, [mass(0.29)], STRETCH)[0][0]
    assert mass(0.29).moved(step).value == pytest.approx(0.3)


def test_the_prior_of_a_size_that_may_be_nothing_is_in_itself():
    own = number(0.2, 0.1)
    assert own.spread == 0.1 and own.away == pytest.approx(-2)
    falls = replace(own, log=True, low=1e-6)
    assert falls.spread == pytest.approx(0.5) and falls.away == pytest.approx(-2)
    assert not np.isfinite(number(sd=np.inf).spread) and number(5.0, sd=np.inf).away == 0
