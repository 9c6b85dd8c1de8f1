"""Disturbances that outlast a window, on a linear problem: a mass of one degree of freedom, of which the position is
read."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch.calibrate import Carried, adjusted, background, carried
from fimpact.mismatch.colour import coloured
from fimpact.mismatch.coordinates import NOTHING
from fimpact.mismatch.disturbance import Disturbance
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.problem import Linear, Point
from fimpact.mismatch.pulses import BINS, Pulses
from fimpact.mismatch.score import score, two_sided
from fimpact.mismatch.step import family_p

SAMPLES, RUNS, EACH = 40, 6, 3  # of a window, and windows of a run
SD = 4.0  # of the force, of which one held for a window shows in its last sample as 2 SD
NAMES = "torque_offset", "spring", "coulomb", "viscous", "payload"


@cache
def response() -> np.ndarray:
    """Position, (SAMPLES, BINS), after a unit force in each bin, in standard deviations of the sensor."""
    force = np.repeat(np.eye(BINS), SAMPLES // BINS, 0)
    return 4 * np.cumsum(np.cumsum(force, 0), 0) / SAMPLES**2


def problem(first: np.ndarray, run: np.ndarray) -> tuple[Fit, Pulses]:
    """A fit without coordinates and the pulses, in windows that begin at `first`, in windows, of each `run`, (w,)."""
    w, none = len(first), np.zeros((len(first), SAMPLES, 0))
    moving = np.stack([np.ones(SAMPLES), np.arange(SAMPLES)], 1)
    basis, triangle = (np.repeat(part[None], w, 0) for part in np.linalg.qr(moving))
    point = Point(None, np.zeros((w, 1)), np.zeros((w, 1)), np.zeros((w, SAMPLES)), 0.0)
    fitted = Fit(point, Linear(basis, triangle, none, none), NOTHING, *([np.zeros(0)] * 3), True)
    clocks = 1e-9 * np.equal.outer(run, np.unique(run))[:, None] * np.ones((1, SAMPLES, 1))
    time = first[:, None] + (np.arange(BINS) + 0.5) / BINS
    columns = np.repeat(response()[None], w, 0)
    return replace(fitted, precision=np.zeros((0, 0))), Pulses(
        columns, clocks, ("joint",), time, *([np.zeros((w, BINS, 1))] * 3), None, None, (0,)
    )


def regular(runs: int = RUNS, each: int = EACH) -> tuple[Fit, Pulses]:
    return problem(np.tile(np.arange(each, dtype=float), runs), np.repeat(np.arange(runs), each))


def candidates(fitted: Fit, found: Pulses) -> list:
    """Constant, slow and quick forces under names of the catalogue."""
    time = found.time + 0.7 * found.runs[:, None]
    waves = (np.cos(rate * time) for rate in (0.0, 1.0, 2.0, 5.0, 9.0))
    placed = (Placed(EFFECTS[name], "joint", {}) for name in NAMES)
    return [score(fitted, own, found.along(0, wave)) for own, wave in zip(placed, waves, strict=True)]


def forces(rng: np.random.Generator, found: Pulses, memory: float, count: int = 1) -> np.ndarray:
    """Random forces, (count, w, BINS), that go on through gaps within a run; `memory` in bins."""
    time, run = found.time.ravel() * BINS, np.repeat(found.runs, BINS)
    kept = np.equal.outer(run, run) * np.exp(-np.abs(np.subtract.outer(time, time)) / memory)
    root = np.linalg.cholesky(kept + 1e-9 * np.eye(len(kept)))
    return SD * (rng.standard_normal((count, len(root))) @ root.T).reshape(count, *found.time.shape)


def disturbed(rng: np.random.Generator, fitted: Fit, found: Pulses, force: np.ndarray) -> Fit:
    """`fitted` with sensor noise and a `force`, (w, BINS), in its residual."""
    residual = rng.standard_normal(fitted.point.residual.shape) + found.along(0, force)
    return replace(fitted, point=replace(fitted.point, residual=residual))


def under(fitted: Fit, found: Pulses, memory: float, sd: float = SD) -> Fit:
    """`fitted` in units in which such a disturbance is white within a window."""
    return coloured(fitted, found, Disturbance(np.array([sd]), memory))


def p_of(shaded: Fit, found: Pulses) -> np.ndarray:
    return family_p(found, shaded, candidates(shaded, found), shaded)


def stacked(screened: list) -> np.ndarray:
    return np.stack([c.column.ravel() for c in screened], 1)


@pytest.mark.parametrize(("each", "memory"), [(3, 16.0), (9, 16.0), (9, 64.0)])
def test_a_disturbance_that_goes_on_from_window_to_window_is_given_no_name(each, memory):
    rng, (fitted, found) = np.random.default_rng(0), regular(18 // each, each)
    shaded = under(fitted, found, memory)
    drawn = [disturbed(rng, shaded, found, force) for force in forces(rng, found, memory, 60)]
    least = np.array([p_of(own, found).min() for own in drawn])
    assert np.mean(least <= 0.05) <= 0.1
    assert np.mean(least <= 0.005) <= 0.02


def test_what_is_carried_is_the_variance_of_scores_also_through_gaps():
    first, run = np.array([4.0, 0.0, 1.0, 0.5, 2.0, 3.0]), np.array([0, 0, 0, 1, 1, 1])
    rng, (fitted, found) = np.random.default_rng(1), problem(first, run)
    shaded = under(fitted, found, 12.0)
    columns = stacked(candidates(shaded, found))
    own = columns.reshape(len(first), SAMPLES, -1)
    left = shaded.linear.off(found.columns)
    pushed = np.einsum("nwb,wmb,wmc->nc", forces(rng, found, 12.0, 20000), left, own, optimize=True)
    noise = (shaded.linear.off(np.repeat(np.eye(SAMPLES)[None], len(first), 0)).transpose(0, 2, 1) @ own) ** 2
    share = carried(shaded, found, columns, shaded).share
    assert share.max() > 0.5
    wanted = (pushed.var(0) + noise.sum((0, 1))) / (columns**2).sum(0)
    np.testing.assert_allclose(1 + share, np.maximum(wanted, 1.0), rtol=0.05)


@pytest.mark.parametrize(("memory", "sd", "most"), [(1.0, SD, 0.15), (2.0, SD, 0.3), (16.0, 0.0, 0.0)])
def test_a_quick_disturbance_or_none_leaves_p_as_it_was(memory, sd, most):
    rng, (fitted, found) = np.random.default_rng(2), regular()
    shaded = disturbed(rng, under(fitted, found, memory, sd), found, sd / SD * forces(rng, found, memory)[0])
    screened = candidates(shaded, found)
    z, both = np.array([c.z for c in screened]), np.array([two_sided(c.placed.effect) for c in screened])
    before = adjusted(z, stacked(screened), both, background(shaded, found))
    assert np.abs(np.log10(p_of(shaded, found) / before)).max() <= most


def test_a_constant_force_is_found_beside_a_quick_disturbance():
    rng, (fitted, found) = np.random.default_rng(3), regular()
    shaded = disturbed(rng, under(fitted, found, 1.0), found, forces(rng, found, 1.0)[0] + 2 * SD)
    assert p_of(shaded, found)[0] <= 0.005


@pytest.mark.parametrize("each", [1, 2])
def test_few_windows_carry_little_or_nothing(each):
    rng, (fitted, found) = np.random.default_rng(4), regular(1, each)
    shaded = disturbed(rng, under(fitted, found, 16.0), found, forces(rng, found, 16.0)[0])
    assert (p_of(shaded, found) > 0.005).all()
    assert (carried(shaded, found, stacked(candidates(shaded, found)), shaded).share.max() > 0) == (each > 1)


def test_few_pieces_say_little_of_the_size_of_what_they_carry():
    assert Carried().freedom(50.0) == pytest.approx(50.0)
    assert Carried(share=4.0, pieces=2.0).freedom(1e9) == pytest.approx(25 / 16)


def test_a_window_in_which_nothing_moves_is_a_run_by_itself():
    found = regular(2, 2)[1]
    still = replace(found, clocks=found.clocks * np.array([1, 0, 1, 1])[:, None, None])
    np.testing.assert_array_equal(still.runs, [0, -2, 1, 1])
