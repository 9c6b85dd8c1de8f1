"""Runs that stand for all of them, and time steps that cost no more than their error is worth."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from recorded import BALL, ROD, record, waves

import fimpact.smoothing.time_step as refinement
from fimpact.deciding import TIED
from fimpact.effects.sites import contacts
from fimpact.effects.touching import can_touch
from fimpact.smoothing.dynamics.plant import Plant, plant_of
from fimpact.smoothing.dynamics.response import Response
from fimpact.smoothing.filter.by_run import filtered
from fimpact.smoothing.prepare import Prepared, prepare, spread_out
from fimpact.smoothing.time_step import FINEST


@cache
def tossed(refine: int = 1) -> Prepared:
    """A ball that falls on a floor and bounces."""
    starts = [([0, 0, 0.2, 1, 0, 0, 0], [0.3, 0, 0, 0, 0, 0])]
    seen = tuple(f"place[{i}]" for i in range(3))
    return prepare(record(BALL, seen, [np.zeros((30, 0))], 5e-4, starts=starts, fine=5), refine=refine)


@cache
def driven(refine: int = 1) -> Prepared:
    return prepare(record(ROD, ("angle",), [waves(50, [0.5], 0)], 1e-3), refine=refine)


def plant(made: Prepared) -> tuple[Plant, np.ndarray]:
    still = np.zeros_like(made.begun.qvel)
    return plant_of(made.track, (), made.track.simulator.theta, made.begun, still, still + 1e-3), still


@pytest.mark.parametrize(
    ("most", "kept"),
    [(0, range(9)), (9, range(9)), (20, range(9)), (3, (0, 4, 8)), (2, (0, 8)), (1, (0,)), (5, (0, 2, 4, 6, 8))],
)
def test_runs_are_spread_over_all_of_them(most, kept):
    assert spread_out(tuple("abcdefghi"), most) == tuple("abcdefghi"[i] for i in kept)


def test_as_many_runs_are_fitted_as_the_case_asks_for_and_none_that_judges():
    many = record(ROD, ("angle",), [waves(20, [0.5], i) for i in range(6)], 1e-3)
    names = [[run.name for run in prepare(replace(many, windows=n), refine=1).track.runs] for n in (0, 3)]
    assert names == [[f"run_{i}" for i in range(5)], ["run_0", "run_2", "run_4"]]
    assert [run.name for run in prepare(many, many.held_out, 1).track.runs] == ["run_5"]


def test_half_the_step_takes_the_error_out():
    for made, step in ((tossed(), 0.002), (driven(), 0.005)):
        track = made.track
        assert [model.opt.timestep for model in track.at_steps(track.model)] == pytest.approx([step, step / 2])


def test_what_touches_is_told_with_the_shape_that_a_hypothesis_gives_it():
    track, (own, _) = tossed().track, plant(tossed())
    small = mujoco.MjModel.from_xml_string(BALL)
    small.geom_size[small.geom("ball").id, 0] = 0.01
    assert track.touching(own.around).any() and not track.touching(own.around, small).any()
    assert track.touching(own.around).any()


def test_a_smooth_motion_is_extrapolated():
    own, still = plant(driven())
    found = own.step(own.around, still).after.qvel
    models = []
    for finer in (1, 2, 64):
        model = mujoco.MjModel.from_xml_string(ROD)
        model.opt.timestep /= finer
        models.append(replace(own, models=(model,)).step(own.around, still).after.qvel)
    one, half, truth = models
    np.testing.assert_allclose(found, 2 * half - one, atol=1e-12)
    assert np.abs(found - truth).max() < 0.1 * np.abs(half - truth).max()


@pytest.mark.parametrize("refine", [1, 4])
def test_derivatives_are_simulated_at_the_step_that_the_model_has(refine):
    for made, step in ((tossed(refine), 0.002), (driven(refine), 0.005)):
        own, still = plant(made)
        assert own.coarse.model.opt.timestep == pytest.approx(step)
        assert len(own.coarse.models) == 1
        track, before = made.track, made.track.steps
        response = Response(own, made.begun, still)
        assert len(response.plant.models) == 1
        response.slopes()
        simulated = made.begun.size + track.model.nv + 1  # and where all of them begin
        assert track.steps - before == simulated * track.count * round(track.period / step)


def test_a_step_is_as_fine_as_its_error_asks_for():
    """A rod that swings freely takes a coarse one, a stiff servo a fine one."""
    servo = ROD.replace('<motor name="motor" joint="pivot"/>', '<position name="s" joint="pivot" kp="60" kv="0.3"/>')
    commands = [waves(60, [0.5], 0)]
    made = [prepare(record(xml, ("angle",), commands, 1e-5)) for xml in (ROD, servo)]
    refines = [own.track.simulator.refine for own in made]
    assert refines[0] < refines[1] <= FINEST


@pytest.mark.parametrize(("height", "apart"), [(1.0, True), (0.2, False)])
def test_what_touches_nothing_is_smoothed_apart_and_proved_with_all_that_may_touch(height, apart):
    starts = [([0, 0, height, 1, 0, 0, 0], [0.3, 0, 0, 0, 0, 0])]
    seen = tuple(f"place[{i}]" for i in range(3))
    made = prepare(record(BALL, seen, [np.zeros((30, 0))], 5e-4, starts=starts, fine=5))
    assert made.track.simulator.apart == apart and not made.simulator.apart
    assert can_touch(made.track.model) != apart and can_touch(made.simulator.base)
    assert bool(contacts(made.track.model)) != apart


@pytest.mark.parametrize(("errors", "ends"), [((9, 9, 9, 9, 9, 9), FINEST), ((9, 2, 0.2), 4), ((np.inf, 0.2), 2)])
def test_the_step_is_halved_until_its_error_shows_no_more(monkeypatch, errors, ends):
    given = iter(errors)
    monkeypatch.setattr(refinement, "step_error", lambda fit: next(given))
    made = prepare(record(ROD, ("angle",), [waves(50, [0.5], 0)], 1e-3))
    assert made.track.simulator.refine == ends
    assert made.naive.track is made.track and made.track.steps == 0


def test_the_error_of_the_step_is_that_of_an_effect():
    """As an effect that did what half the step does would be weighed: by noise and missing force together."""
    servo = ROD.replace('<motor name="motor" joint="pivot"/>', '<position name="s" joint="pivot" kp="60" kv="0.3"/>')
    made = prepare(record(servo, ("angle",), [waves(60, [0.5], 0)], 1e-5), refine=1)
    fit = made.naive
    loud = replace(fit, filter=filtered(fit.track, fit.linear, replace(fit.levels, force=30 * fit.levels.force)))
    assert refinement.step_error(fit) > 3 * refinement.step_error(loud) > 0
    assert refinement.step_error(replace(fit, chi2=np.inf)) == np.inf
    finer = refinement.settled(fit, made.begun, made.noise)
    assert finer.track.simulator.refine > 1 and finer.track.quanta > fit.track.quanta  # what was simulated counts on
    assert refinement.step_error(finer) ** 2 < TIED or finer.track.simulator.refine == FINEST
