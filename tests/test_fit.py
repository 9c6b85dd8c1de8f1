"""The fit where things touch: a box that slides on a table, its friction far from the model's."""

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from mujoco.rollout import Rollout

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch import judge
from fimpact.mismatch.coordinates import coordinates
from fimpact.mismatch.explain import explain
from fimpact.mismatch.fit import SETTLED, _descended, fit, negligible
from fimpact.mismatch.judge import bench, calmed, converging, correct, settle
from fimpact.mismatch.leap import leap, leaped
from fimpact.mismatch.offer import offered
from fimpact.mismatch.settle import first_point
from fimpact.mismatch.simulate import Hypothesis
from fimpact.mismatch.tame import WILD, tamed
from fimpact.recordings import Recording, Run, Unknown

BOX = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="table" type="plane" size="1 1 0.1"/>
    <body name="box" pos="0 0 0.05">
      <joint name="along" type="slide" axis="1 0 0"/>
      <joint name="up" type="slide" axis="0 0 1"/>
      <geom name="box" type="box" size="0.05 0.05 0.05" mass="0.4"/>
    </body>
  </worldbody>
  <contact><pair name="box_table" geom1="box" geom2="table"/></contact>
  <sensor><jointpos name="x" joint="along"/><jointpos name="z" joint="up"/></sensor>
</mujoco>
"""
PERIOD, SAMPLES, TRUE, NOISE = 0.01, 30, 0.2, 1e-5


def throw(speed: float, height: float, held_out: bool) -> Run:
    """A box that is let go at a height, m, with a speed along the table, m/s."""
    model = mujoco.MjModel.from_xml_string(BOX)
    model.pair_friction[:, :2], substeps = TRUE, round(PERIOD / model.opt.timestep)
    start = np.array([[0.0, 0.0, height, speed, 0.0]])
    _, sensed = Rollout(nthread=0).rollout(model, mujoco.MjData(model), start, nstep=SAMPLES * substeps)
    noise = NOISE * np.random.default_rng(round(100 * abs(speed))).standard_normal((SAMPLES, 2))
    return Run(f"{speed} {held_out}", np.zeros((SAMPLES, 0)), sensed[0, ::substeps] + noise, held_out)


@pytest.fixture(scope="module")
def sliding():
    runs = [throw(speed, 0.0, held_out) for held_out in (False, True) for speed in (0.8, 1.2, -1.0)]
    unknowns, known = (Unknown("pair_friction", "box_table"),), np.full(2, NOISE)
    return bench(Recording(BOX, ".", PERIOD, ("x", "z"), tuple(runs), unknowns, known, np.full(4, np.inf), 0.0))


def test_finer_steps_do_not_simulate_a_quicker_contact(sliding):
    """MuJoCo slows a contact that its time step cannot follow; half the step would be another model."""
    damped = Placed(EFFECTS["contact_damping"], "box_table", {"change": 70.0})
    hypothesis = Hypothesis(sliding.training.simulator.theta, (damped,))
    made = [s.model(hypothesis) for s in (sliding.training.simulator, *sliding.finer)]
    assert [m.opt.timestep for m in made] == pytest.approx([0.002, 0.001, 0.0005])
    assert [m.pair_solref[0, 0] for m in made] == pytest.approx([0.004] * 3)


def test_what_is_read_at_another_time_is_read_between_steps(sliding):
    """A box lands between two samples; where nothing is commanded, a clock that drifts sees what no sample does."""
    simulator, windows = sliding.training.simulator, sliding.training.windows
    drift = Placed(EFFECTS["clock_drift"], "all", {"rate": 0.05})
    start = np.zeros((len(windows.runs), 2)), np.zeros((len(windows.runs), 2))
    start[0][:, 1] = 0.01
    plain = Hypothesis(simulator.theta)
    path = simulator.motion(plain, windows, *start)[0][0, :, 1]
    step = simulator.base.opt.timestep
    wanted = 0.95 * PERIOD * np.arange(windows.length)
    exact = np.interp(wanted, step * np.arange(len(path) + 1), [0.01, *path])
    sampled = simulator.predict(plain, windows, *start)
    signal = simulator.commands.signal(windows, windows.length, PERIOD)
    coarse = drift.effect.law(sampled, signal, "all", rate=0.05)[0, :, 1]
    fine = simulator.predict(replace(plain, placed=(drift,)), windows, *start)[0, :, 1]
    assert np.abs(fine - exact).max() < 0.2 * np.abs(coarse - exact).max()


def test_long_steps_lead_to_where_a_tangent_through_a_contact_does_not(sliding):
    problem = sliding.training
    free = coordinates(problem.simulator)
    start = first_point(problem, free, Hypothesis(problem.simulator.theta))
    far = leaped(problem, free, start)
    assert far.hypothesis.theta[0] == pytest.approx(TRUE, abs=0.1)
    found = fit(problem, free, start, iterations=4)  # which is too few for anything but a long step
    assert found.point.hypothesis.theta[0] == pytest.approx(TRUE, abs=0.1)
    assert found.point.cost < 0.1 * start.cost


def test_a_leap_begins_windows_anew_where_those_of_the_point_lead_nowhere(sliding):
    """Starts that made up for a wrong friction are no starts for the right one: these lie deep in the table."""
    problem = sliding.training
    free = coordinates(problem.simulator)
    wrong = first_point(problem, free, Hypothesis(problem.simulator.theta))
    sunk = problem.evaluate(wrong.hypothesis, wrong.qpos - [0.0, 0.2], wrong.qvel, free)
    there = leap(problem, free, sunk, 0, TRUE - free.read(wrong.hypothesis)[0])
    assert there.cost < 1e-3 * wrong.cost < sunk.cost


def test_what_cannot_come_below_the_worst_cost_is_not_followed_to_its_end(sliding):
    problem = sliding.training.louder(np.full(3, 30.0))  # near the noise
    free = coordinates(problem.simulator)
    best = fit(problem, free, first_point(problem, free, Hypothesis(np.array([TRUE])))).point
    near = problem.evaluate(Hypothesis(np.array([1.01 * TRUE])), best.qpos, best.qvel, free)
    linear = problem.linearise(near, free)
    whole = fit(problem, free, near, linear=linear)
    among, beside = (fit(problem, free, near, linear=linear, worst=w) for w in (1.01 * whole.point.cost, -1e9))
    assert 1.1 * whole.point.cost < near.cost
    assert among.point.cost == whole.point.cost and among.converged == whole.converged
    assert beside.point is near and beside.linear is linear and not beside.converged
    # Far from the noise one step promises little of what further ones may gain.
    loud = problem.evaluate(Hypothesis(np.array([2 * TRUE])), best.qpos, best.qvel, free)
    linear = problem.linearise(loud, free)
    assert _descended(problem, free, loud, 12, linear, True, worst=-1e9).point.cost < 0.1 * loud.cost


def test_what_one_window_shows_of_nothing_does_not_move_a_friction_that_others_show(sliding):
    """A third window is of a box that somebody pushed: as loud as it is, by least squares it alone decides."""
    problem = copy(sliding.training)
    free = coordinates(problem.simulator)
    windows, pushed = problem.windows, problem.windows.measured.copy()
    pushed[2, :, 0] = pushed[2, 0, 0] - 1.0 * PERIOD * np.arange(SAMPLES)
    problem.windows = replace(windows, measured=pushed)
    fitted = fit(problem, free, first_point(problem, free, Hypothesis(problem.simulator.theta)))
    spoilt = replace(sliding, training=problem)
    plain = replace(explain(fitted, settle(sliding.held_out, fitted.point.hypothesis)), dispersion=2 * WILD)
    friction = tamed(spoilt, plain).fitted.point.hypothesis.theta[0]
    assert abs(friction - TRUE) < 0.1 * abs(fitted.point.hypothesis.theta[0] - TRUE)
    assert tamed(spoilt, replace(plain, dispersion=0.5 * WILD)).fitted is fitted


def test_what_numerics_of_its_own_make_less_likely_is_not_taken(sliding, monkeypatch):
    problem = sliding.training
    free = coordinates(problem.simulator)
    fitted = fit(problem, free, first_point(problem, free, Hypothesis(problem.simulator.theta)))
    found = replace(explain(fitted, settle(sliding.held_out, fitted.point.hypothesis)), dispersion=2 * WILD)
    near = replace(fitted.point, residual=0.1 * fitted.point.residual)
    louder = replace(found, fitted=replace(fitted, point=replace(near, residual=2 * fitted.point.residual)))
    kept = sliding.offsets

    def moved(bench, *_):
        bench.restore((kept[0] + 1.0, kept[1]))
        return louder

    monkeypatch.setattr("fimpact.mismatch.tame._pass", lambda *_: near)
    monkeypatch.setattr("fimpact.mismatch.tame.moved", moved)
    assert tamed(sliding, found) is found
    assert sliding.training.offset is kept[0]


def test_only_far_from_the_noise_a_fit_may_be_rough():
    def of(size):
        residual = np.full((3, 60), size)
        return SimpleNamespace(residual=residual, cost=(residual**2).sum() / 2)

    assert negligible(of(1.0)) == SETTLED
    far = of(100.0)
    assert negligible(far) > 1e-4 * far.cost > SETTLED


def test_a_difference_that_halving_the_step_does_not_shrink_is_not_extrapolated(sliding):
    problem = sliding.training
    first = np.ones_like(problem.windows.measured)
    second = first * np.array([0.6, 0.9, -0.5])[:, None, None]
    assert converging(problem, first, second).ravel().tolist() == [True, False, False]


def test_what_is_extrapolated_stays_so_until_it_clearly_does_not_converge(sliding):
    """Of two alike explanations neither may be judged with the time step's error where the other is without."""
    problem = copy(sliding.training)
    first = np.ones_like(problem.windows.measured)
    second = first * np.array([0.8, 0.8, 1.1])[:, None, None]
    problem.offset = np.zeros_like(first)
    assert converging(problem, first, second).ravel().tolist() == [False, False, False]
    problem.offset = first * np.array([1.0, 0.0, 1.0])[:, None, None]
    assert converging(problem, first, second).ravel().tolist() == [True, False, False]


def test_what_numerics_make_of_a_window_in_one_explanation_they_make_of_it_in_all(sliding):
    problem = copy(sliding.training)
    right, wrong = np.zeros_like(problem.offset), np.zeros_like(problem.offset)
    wrong[1, 10:] = 50 * NOISE
    fits = []
    for problem.offset in (right, wrong):
        start = first_point(problem, coordinates(problem.simulator), Hypothesis(np.array([TRUE])))
        fits.append(settle(problem, start.hypothesis, start))
    before, ((one, _), (other, offset)) = fits[0].point.squares, offered(problem, fits, [right, wrong])
    assert fits[1].point.squares[1] > 5 * before[1]
    assert other.point.squares[1] < 1.01 * before[1]
    assert not offset[1].any() and wrong[1].any()
    assert (one.point.squares <= before + 1e-6).all()


def test_what_the_time_step_is_blamed_for_is_dropped_where_it_cannot_be(sliding):
    """One held-out window has 50 standard deviations too much, which at this start nothing says it has."""
    problem = copy(sliding.held_out)
    start = first_point(problem, coordinates(problem.simulator), Hypothesis(np.array([TRUE])))
    before = settle(problem, start.hypothesis, start).point.squares
    problem.offset = np.zeros_like(problem.offset)
    problem.offset[1, 10:] = 50 * NOISE
    spoiled = settle(problem, start.hypothesis, start)
    mended = calmed(sliding, problem, spoiled).point
    assert not problem.offset.any() and spoiled.point.squares[1] > 5 * before[1]
    assert (mended.squares <= 1.01 * before).all()


def test_numerics_are_followed_by_each_window_before_what_they_share(sliding, monkeypatch):
    """Of all squares together what one window has to gain may be next to nothing, and the fit then leaves it there."""
    problem = copy(sliding.held_out)
    problem.offset = np.zeros_like(problem.offset)
    start = first_point(problem, coordinates(problem.simulator), Hypothesis(np.array([TRUE])))
    best = settle(problem, start.hypothesis, start)
    off = best.point.qvel + np.array([[4e-4, 0.0], [0.0, 0.0], [0.0, 0.0]])
    point = problem.evaluate(best.point.hypothesis, best.point.qpos, off, best.coordinates)
    monkeypatch.setattr(judge, "fit", lambda problem, coordinates, start, *_, **__: replace(best, point=start))
    found = judge._continued(problem, replace(best, point=point)).point
    assert point.squares[0] > 1.5 * best.point.squares[0]
    assert found.squares[0] < 1.01 * best.point.squares[0]


def test_the_error_of_the_time_step_is_that_of_where_the_fit_now_is():
    runs = [throw(1.0, height, held_out) for held_out in (False, True) for height in (0.05, 0.1)]
    nothing = (), np.full(2, NOISE), np.full(4, np.inf), 0.0
    made = bench(Recording(BOX, ".", PERIOD, ("x", "z"), tuple(runs), *nothing))
    problem, free = made.training, coordinates(made.training.simulator)
    struck = first_point(problem, free, Hypothesis(problem.simulator.theta))
    correct(made, problem, struck)
    noise = problem.noise
    # So far above the table that it flies on.
    above = problem.evaluate(struck.hypothesis, struck.qpos + np.array([0.0, 5.0]), struck.qvel, free)
    correct(made, problem, above)
    assert np.abs(problem.offset[:, :, 0]).max() < NOISE
    assert problem.noise is noise
