"""By how much what is left is louder than noise, and what windows that are quieter have to do with it."""

from types import SimpleNamespace

import numpy as np
import pytest

from fimpact.mismatch.weigh import dispersion

SAMPLES, WINDOWS = 200, 400


@pytest.fixture
def noise():
    return np.random.default_rng(0).chisquare(SAMPLES, WINDOWS)


def dispersed(squares, louder=1.0):
    part = SimpleNamespace(point=SimpleNamespace(samples=np.full(len(squares), SAMPLES)))
    return dispersion([part], [squares], louder)


def test_noise_is_not_dispersed(noise):
    assert dispersed(noise) == pytest.approx(1.0, abs=0.2)
    assert dispersed(3 * noise) == pytest.approx(3.0, rel=0.2)


def test_windows_that_are_louder_disperse(noise):
    assert dispersed(noise * np.where(np.arange(WINDOWS) % 4, 1.0, 1.5)) > 4.0


def test_windows_that_are_quieter_than_the_sensors_do_not(noise):
    """A coarse encoder that stands still reads one number, and the noise that it is given is not there. Where what is
    white is louder than the sensors, those that are quieter than that are not alike."""
    some = noise * np.where(np.arange(WINDOWS) % 4, 1.0, 0.5)
    assert dispersed(some) == pytest.approx(1.0, abs=0.2)
    assert dispersed(some, louder=2.0) > 4.0
