"""What intervals are worth where little was recorded, or where disturbances dragged the parameters."""

from types import SimpleNamespace

import numpy as np
import pytest

from fimpact.mismatch.colour import Colour
from fimpact.mismatch.disturbance import Disturbance
from fimpact.mismatch.evidence import _interval, _of_few
from fimpact.mismatch.weigh import _ordinary, widened


@pytest.mark.parametrize("windows", [2, 3, 6, 18])
def test_few_windows_seldom_show_an_improvement_that_is_not_there(windows):
    rng, found = np.random.default_rng(0), []
    for _ in range(2000):
        before = 50 * rng.gamma(4, 1, windows)
        found.append(_of_few(np.full(windows, 50), before, before + rng.normal(0, 10, windows), 0.0)[0] > 0)
    assert np.mean(found) < 0.045


def test_one_window_shows_what_is_beyond_its_noise_and_no_more():
    rng, shape, found = np.random.default_rng(0), np.sin(np.arange(100) / 9), []
    for _ in range(1000):
        noise = rng.standard_normal(100)
        both = (noise + 0.5 * shape, noise - 0.5 * shape)  # two models that are equally wrong
        squares = [np.array([(part**2).sum()]) for part in both]
        found.append(_of_few(np.array([100]), *squares, (shape**2).sum())[0] > 0)
    assert 0.01 < np.mean(found) < 0.04
    squares = np.array([1e4]), np.array([100.0])
    assert _interval(np.zeros(1), np.array([100]), *squares, 9900.0)[0] > 0.7
    squares = np.array([100.0]), np.array([99.9])
    low, high = _interval(np.zeros(1), np.array([100]), *squares, 0.1)
    assert low < 0 < high


def dragged(rng) -> tuple:
    """A fit, a disturbance that does what its first coordinate does, and its colour."""
    seen, push = rng.standard_normal((10, 40, 2)), rng.standard_normal((10, 40, 3))
    push[:, :, 0] += seen[:, :, 0]
    directions, size, _ = np.linalg.svd(9 * push, full_matrices=False)
    shade = Colour(directions, np.sqrt(1 + size**2), np.zeros((10, 40, 0)), Disturbance(np.zeros(1), 1.0))
    fitted = SimpleNamespace(
        linear=SimpleNamespace(projected=seen), coordinates=SimpleNamespace(sd=np.full(2, np.inf)), scale=np.ones(2)
    )
    return fitted, push, shade


def test_what_disturbances_dragged_is_as_uncertain_as_that():
    rng, errors = np.random.default_rng(0), []
    fitted, push, shade = dragged(rng)
    flat = fitted.linear.projected.reshape(-1, 2)
    for _ in range(2000):
        noise = rng.standard_normal((10, 40)) + 9 * np.einsum("wmp,wp->wm", push, rng.standard_normal((10, 3)))
        errors.append(np.linalg.lstsq(flat, noise.ravel(), rcond=None)[0])
    np.testing.assert_allclose(np.std(errors, axis=0), np.sqrt(np.diag(_ordinary(fitted, shade))), rtol=0.06)


@pytest.mark.parametrize("step", [0.0, 0.9, 1.1])
def test_only_what_was_left_by_ordinary_squares_counts_as_dragged(step, monkeypatch):
    fitted, _, shade = dragged(np.random.default_rng(0))
    optimum = SimpleNamespace(deviances=[], step=np.array([0.0, 2 * step]), covariance=np.eye(2))
    monkeypatch.setattr("fimpact.mismatch.weigh.generalised", lambda parts, shades: optimum)
    monkeypatch.setattr("fimpact.mismatch.weigh.dispersion", lambda parts, sums, noise: 4.0)
    spread, covariance = widened([fitted], [shade])
    expected = 3 * np.eye(2) + _ordinary(fitted, shade) if step > 1 else 4 * np.eye(2)
    np.testing.assert_allclose(covariance, expected)
    assert spread == 4.0
