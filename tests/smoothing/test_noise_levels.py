"""Noise levels move towards the noise that was put in, and no further in a step than they may."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from recorded import ROD, record, rod, waves

from fimpact.deciding import FALL, TRUSTED
from fimpact.effects import EFFECTS
from fimpact.selection.forward import Search
from fimpact.smoothing import rounds
from fimpact.smoothing.candidates import Candidate, at
from fimpact.smoothing.columns import motion_scales
from fimpact.smoothing.dynamics.dry_friction import Rubbing
from fimpact.smoothing.filter.by_run import variances
from fimpact.smoothing.noise_levels import Levels, Pace, first_levels, moved_by, nearer, resting
from fimpact.smoothing.prepare import Prepared, prepare
from fimpact.smoothing.smoother import Smoothed, smooth
from fimpact.smoothing.states import States
from fimpact.smoothing.step import solve
from fimpact.smoothing.stretches import stretches

TORQUE = 0.1  # N m, new in each sample


@cache
def pushed() -> Smoothed:
    """A rod that swings, pushed by a torque that is new in each sample."""
    hidden = iter(np.repeat(TORQUE * np.random.default_rng(0).standard_normal(200), 5))
    xml = ROD.replace('<actuator><motor name="motor" joint="pivot"/></actuator>', "")

    def pull(model, data):
        return np.array([next(hidden)])

    made = prepare(
        record(xml, ("angle",), [np.zeros((200, 0))], 1e-4, pull=pull, fine=5, starts=[([1.5], [0.0])]), refine=1
    )
    return smooth(made.track, made.begun, made.noise)


@cache
def driven() -> Smoothed:
    """A rod of which nothing is missing."""
    made = prepare(rod(), refine=1)
    return smooth(made.track, made.begun, made.noise)


def moved(found: Smoothed, levels: Levels, noise: np.ndarray, begun: Levels | None = None, steps: int = 1) -> Levels:
    """Levels some steps nearer, as a fit at the same trajectory has them."""
    track, linear, pace = found.track, found.linear, Pace()
    stretch, begun = stretches(track, found.tau), begun or levels
    for _ in range(steps):
        own = solve(track, linear, levels, found.tau, found.numbers, stretch)
        expected = variances(track, linear, own.filter)[:2]
        asked = own.adjoint[:, found.states.size :]
        levels = nearer(levels, begun, asked, own.errors, expected, noise, pace, track)
    return levels


@pytest.mark.parametrize("factor", [0.4, 2.5])
def test_the_noise_of_readings_goes_to_what_was_put_in(factor):
    found, truth = driven(), np.array([1e-3])
    wrong = replace(found.levels, reading=factor * truth)
    off = [np.abs(np.log(moved(found, wrong, truth, steps=n).reading / truth))[0] for n in (0, 1, 4)]
    assert off[1] < 0.4 * off[0] and off[2] < 0.08


@pytest.mark.parametrize("factor", [0.4, 2.5])
def test_the_missing_force_goes_to_what_was_put_in(factor):
    found = pushed()
    wrong = replace(found.levels, force=np.full_like(found.levels.force, factor * TORQUE))
    off = [abs(np.log(moved(found, wrong, np.array([1e-4]), steps=n).force[0, 0] / TORQUE)) for n in (0, 1, 8)]
    assert off[1] < 0.4 * off[0] and off[2] < 0.2


def test_a_force_goes_a_factor_at_most_from_where_it_began():
    found = pushed()
    for factor in (1e-2, 1e2):
        wrong = replace(found.levels, force=np.full_like(found.levels.force, factor * TORQUE))
        ends = moved(found, wrong, np.array([1e-4]), steps=6)
        assert ends.force[0, 0] == pytest.approx(FALL ** -np.sign(np.log(factor)) * factor * TORQUE)


def test_noise_is_not_trusted_to_be_far_from_what_the_samples_show():
    found, noise = driven(), np.array([1e-3])
    for shown, end in ((100 * noise, TRUSTED[0]), (1e-2 * noise, TRUSTED[1])):
        wrong = replace(found.levels, reading=shown)
        assert moved(found, wrong, shown, steps=6).reading == pytest.approx(end * shown)


def test_a_missing_force_is_no_less_than_the_least():
    found = driven()
    levels = replace(found.levels, force=np.full((1, 1), 1e-2), least=np.array([9e-3]))
    assert moved(found, levels, np.array([1e-3]), steps=6).force[0, 0] == 9e-3


def test_what_is_annealed_keeps_its_noise():
    found = driven()
    wrong = replace(found.levels, reading=np.array([5e-4]), louder=np.array([2.0]))
    assert moved(found, wrong, np.array([1e-3])).reading[0] == 5e-4


def test_the_pace_doubles_while_it_goes_the_same_way():
    pace, up = Pace(), np.array([0.1, 0.1])
    np.testing.assert_allclose(pace(up), [0.1, 0.1])
    np.testing.assert_allclose(pace(up * [1, -1]), [0.2, -0.1])
    np.testing.assert_allclose(pace(up * [1, -1]), [0.4, -0.2])
    for _ in range(3):
        last = pace(up)
    assert last[0] == pytest.approx(0.8)
    np.testing.assert_allclose(pace(1e3 * up), np.log(FALL))
    np.testing.assert_allclose(pace(-up), -up)  # as far as at first, where it has gone too far


def test_levels_that_the_likelihood_does_not_feel_do_not_count_as_moving():
    force, none = np.array([[1.0, 0.5]]), np.zeros(2)
    still = np.zeros(3, int), np.zeros((3, 2), bool)
    levels = Levels(force, none, *still, np.ones(1), np.ones(1), np.array([[-3.0, 0.5]]))
    assert moved_by(replace(levels, force=force * [1.0, 3.0]), levels) == 0
    assert moved_by(replace(levels, force=force * [2.0, 3.0]), levels) == pytest.approx(np.log(2))


@cache
def held() -> tuple[Prepared, Smoothed, Candidate]:
    """A rod whose friction its motor overcomes in short spells only, its naive fit, and that friction."""

    def hide(model):
        model.dof_frictionloss[:] = 0.5

    made = prepare(record(ROD, ("angle",), [waves(400, [0.5], i) for i in range(3)], 1e-3, hide))
    naive = smooth(made.track, made.begun, made.noise)
    return made, naive, at(EFFECTS["coulomb"], "pivot", made.track.model, motion_scales(naive))[0]


def rubbed(like: Smoothed) -> Smoothed:
    """The fit with that friction, begun like another."""
    made, _, own = held()
    return smooth(made.track, made.begun, made.noise, [own.placed([0.5])], [own.priors], like)


def test_what_friction_holds_at_rest_does_not_hide_what_is_missing_of_the_motion():
    """What it holds meanwhile is no noise of the spells in which it moves."""
    naive = held()[1]
    fit = rubbed(naive)
    assert 0.2 < fit.levels.rests.mean() < 0.95
    moves, rests = fit.levels.force[:, 0]
    assert moves < 0.3 * rests
    quick = np.abs(fit.states.qvel[:, 0]) > 1.0
    assert not fit.levels.rests[quick].any() and not naive.levels.rests.any()  # without friction nothing is held


def test_a_fit_is_as_likely_however_it_was_begun():
    """Where signs of speeds flip back and forth, they are held on the way, but not in what is compared."""
    naive = held()[1]
    losses = [rubbed(begun).loss() for begun in (naive, replace(naive, doubt=naive.doubt / 10))]
    assert losses[0] == pytest.approx(losses[1], abs=20)


def test_a_fit_that_is_done_again_explains_as_much():
    """Samples that rest at the end, and did not on the way, are not explained by the levels of others."""
    made = prepare(rod(0.15))
    state = Search(made.track, made.begun, made.noise, [EFFECTS["coulomb"]], lambda line: None)
    assert state.round()
    fit = state.current
    for _ in range(4):
        assert fit.chi2 == pytest.approx(fit.count, rel=0.05)
        fit = smooth(made.track, made.begun, made.noise, fit.placed, fit.priors, fit)


def test_what_rests_is_told_anew_once_a_fit_stands():
    """It was begun where little was known of the speeds: there more of them may be none."""
    made = prepare(rod(0.15))
    state = Search(made.track, made.begun, made.noise, [EFFECTS["coulomb"]], lambda line: None)
    assert state.round()
    before = state.current.levels.rests.sum()
    assert not state.round()
    assert 0 < state.current.levels.rests.sum() < before


def test_what_comes_to_rest_on_the_way_rests_too(monkeypatch):
    """What is taken to move is not found at rest at once: friction without a slope moves it."""
    asked = []

    def blinded(*parts):
        found = resting(*parts)
        asked.append(found.rests)
        blind = np.arange(len(found.rests)) % 2 == (len(asked) > 1)  # half of it, and later the other half
        return replace(found, rests=found.rests & ~blind[:, None])

    monkeypatch.setattr(rounds, "resting", blinded)
    fit = rubbed(held()[1])
    both = asked[0] & asked[1]
    assert both.sum() > 100 and fit.levels.rests[both].all()


def test_what_reverses_within_a_sample_does_not_rest():
    """Its speeds are known at both ends; only what stands between two samples is held."""
    track = prepare(record(ROD, ("angle",), [waves(50, [0.5], 0)], 1e-3), refine=1).track
    speed = np.where(np.arange(track.count) < 20, 0.5, -0.5)
    speed[30:] = 0.0
    states = States(np.zeros((track.count, 1)), speed[:, None], np.zeros((track.count, 0)))
    doubt = np.full((track.count, 1), 0.01)
    rub = Rubbing(np.ones((track.count, 1)), *np.zeros((2, track.count, 1)))
    none = first_levels(track, states, np.ones((track.count, 1)), np.ones(1))
    rests = resting(track, states, doubt, rub, none).rests[:, 0]
    assert not rests[:29].any() and rests[30:].all()
    still = resting(track, states, np.full_like(doubt, 0.4), rub, none).rests[:, 0]
    assert still[19]  # where speeds are not known so well, it may


def test_squares_are_summed_by_contact_mode():
    modes, none = np.array([0, 2, 2, 0]), np.zeros((6, 2))
    levels = Levels(none, np.zeros(2), modes, np.zeros((4, 2), bool), np.ones(1), np.ones(1), none)
    squares = np.arange(8.0).reshape(4, 2)
    np.testing.assert_array_equal(levels.summed(squares), [[6, 8], [0, 0], [6, 8]])


def test_every_sample_has_the_level_of_its_contact_and_of_its_rest():
    force, mode = np.arange(12.0).reshape(6, 2), np.array([0, 1, 2])
    rests = np.array([[False, True], [True, False], [False, False]])
    levels = Levels(force, np.zeros(2), mode, rests, np.ones(1), np.ones(1), np.zeros((6, 2)))
    np.testing.assert_array_equal(levels.forces, [[0, 7], [8, 3], [4, 5]])
    assert sum(own.sum() for own in levels.rows) == 6
