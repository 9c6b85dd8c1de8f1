"""Trajectory, missing force and parameters together, of rigs whose truth is known."""

import copy
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from recorded import ARM, PERIOD, ROD, arm, record, rod, waves

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.recordings import Recording, Unknown
from fimpact.selection.regression import Regression
from fimpact.smoothing import smoother
from fimpact.smoothing.candidates import at, candidates
from fimpact.smoothing.columns import columns, motion_scales
from fimpact.smoothing.dynamics.response import heavier
from fimpact.smoothing.noise_levels import CHANGE, FLIGHT, STANCE
from fimpact.smoothing.parameters import parameters
from fimpact.smoothing.prepare import Prepared, prepare
from fimpact.smoothing.simulated_laws import Simulated
from fimpact.smoothing.smoother import Smoothed, smooth
from fimpact.smoothing.step import Solved

MOTOR = '<motor name="motor" joint="pivot"/>'
BALL = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="2 2 0.1"/>
<body name="ball" pos="0 0 0.3"><freejoint name="free"/><geom name="ball" size="0.05" mass="0.3"/></body></worldbody>
<sensor><framepos name="place" objtype="xbody" objname="ball"/>
<framequat name="turn" objtype="xbody" objname="ball"/></sensor></mujoco>"""
SEEN = tuple(f"place[{i}]" for i in range(3)) + tuple(f"turn[{i}]" for i in range(4))


def smoothed(recording: Recording) -> Smoothed:
    made = prepare(recording)
    return smooth(made.track, made.begun, made.noise)


def number(found: Smoothed, of: str) -> float:
    return next(n.value for n in found.numbers if n.of == of)


@pytest.mark.parametrize("recording", [rod(), arm()], ids=["rod", "arm"])
def test_where_nothing_is_missing_noise_is_all_that_is_left(recording):
    found = smoothed(recording)
    assert found.converged
    assert found.chi2 / found.count == pytest.approx(1, abs=0.06)
    assert found.levels.reading == pytest.approx(recording.noise, rel=0.06)
    applied = np.sqrt(np.mean(found.track.ctrl**2, (0, 1)))
    assert (np.sqrt(np.mean(found.tau**2, 0)) < 0.01 * applied).all()


def test_the_missing_force_is_the_friction_that_is_missing():
    found = smoothed(rod(0.15))
    quick = np.abs(found.states.qvel[:, 0]) > 1.0
    against = -np.sign(found.states.qvel[quick, 0])
    assert found.converged
    assert np.mean(found.tau[quick, 0] * against) == pytest.approx(0.15, rel=0.1)
    assert 0.1 < found.levels.force[0, 0] < 0.4


@pytest.mark.parametrize("friction", [0.05, 0.15])
def test_dry_friction_that_is_added_takes_the_missing_force_away(friction):
    made, naive = prepare(rod(friction)), smoothed(rod(friction))
    placed = Placed(EFFECTS["coulomb"], "pivot", {"friction": 0.08})
    found = smooth(made.track, made.begun, made.noise, (placed,), ({"friction": 0.5},), naive, rounds=20)
    assert number(found, "coulomb@pivot") == pytest.approx(friction, rel=0.01)
    assert found.loss() < naive.loss() - 100
    assert np.mean(found.tau**2) < 0.02 * np.mean(naive.tau**2)
    assert found.converged  # through every reversal


def test_a_mass_is_found_without_bias():
    found = smoothed(rod(mass=1.3, free=True))
    assert number(found, "mass@rod") == pytest.approx(0.39, rel=0.005)
    assert number(found, "damping@pivot") == pytest.approx(0.02, rel=0.1)


def test_dry_friction_that_is_missing_does_not_move_a_mass():
    found = smoothed(rod(0.05, 1.3, True))
    assert number(found, "mass@rod") == pytest.approx(0.39, rel=0.03)


def swinging(seed: int) -> Recording:
    """A rod that nothing drives, and a random torque, new in each sample, that the model lacks."""
    hidden = iter(np.repeat(0.1 * np.random.default_rng(seed).standard_normal(300), 5))
    xml = ROD.replace("<actuator>" + MOTOR + "</actuator>", "")
    return record(
        xml, ("angle",), [np.zeros((300, 0))], 1e-4, pull=lambda model, data: np.array([next(hidden)]), fine=5,
        starts=[([1.5], [0.0])], unknowns=(Unknown("mass", "rod", 0.5),), seed=seed,
    )  # fmt: skip


def test_forces_that_nobody_knows_make_nothing_lighter(monkeypatch):
    """Least squares of forces that are all unknown has the solution that nothing weighs anything (`linear.heavier`)."""
    made = prepare(swinging(0))
    mass = number(smooth(made.track, made.begun, made.noise), "mass@rod")
    assert mass == pytest.approx(0.3, rel=0.1)
    for place in ("dynamics.response", "rounds"):
        monkeypatch.setattr(f"fimpact.smoothing.{place}.heavier", lambda after, before: np.ones(after.nv))
    assert number(smooth(made.track, made.begun, made.noise), "mass@rod") < 0.5 * mass


def test_a_fit_that_goes_astray_ends_with_its_best(monkeypatch):
    made, truly, rounds = prepare(swinging(0)), smoother.solve, iter(range(20))

    def worse_and_worse(*args):
        found = truly(*args)
        return replace(found, cost=found.cost + 1e6 * next(rounds)) if len(args) == 7 else found

    first = smooth(made.track, made.begun, made.noise, rounds=1)
    monkeypatch.setattr(smoother, "solve", worse_and_worse)
    found = smooth(made.track, made.begun, made.noise, patience=1)
    assert not found.converged and found.rounds == 2
    np.testing.assert_array_equal(found.states.qpos, first.states.qpos)
    assert number(found, "mass@rod") == number(first, "mass@rod")


def test_an_unknown_that_does_nothing_costs_nothing():
    own = rod()
    named = own.xml.replace("<geom type", '<geom name="bar" type')
    made = prepare(replace(own, xml=named, unknowns=(Unknown("mass", "rod", 0.3), Unknown("friction", "bar", 0.3))))
    fit = smooth(made.track, made.begun, made.noise)
    alone = prepare(replace(own, xml=named, unknowns=(Unknown("mass", "rod", 0.3),)))
    assert fit.loss() == pytest.approx(smooth(alone.track, alone.begun, alone.noise).loss(), abs=0.1)


@pytest.mark.parametrize("xml", [ROD, ROD.replace("<actuator>" + MOTOR + "</actuator>", "")], ids=["driven", "free"])
def test_unknown_forces_grow_with_the_inertia_where_nothing_applied_is_known(xml):
    model, twice = (mujoco.MjModel.from_xml_string(xml) for _ in range(2))
    twice.body_mass[1:] *= 2
    twice.body_inertia[1:] *= 2
    mujoco.mj_setConst(twice, mujoco.MjData(twice))
    np.testing.assert_allclose(heavier(twice, model), 1.0 if model.nu else 2.0)


@pytest.mark.parametrize(
    ("motor", "na"),
    [
        ('<general name="lag" joint="pivot" dyntype="filter" dynprm="0.05"/>', 1),
        ('<position name="servo" joint="pivot" kp="6" kv="0.3"/>', 0),
        ('<position name="servo" joint="pivot" kp="6" kv="0.3" timeconst="0.05"/>', 1),
    ],
    ids=["filter", "servo", "filtered servo"],
)
def test_servos_and_states_of_actuators_are_part_of_the_trajectory(motor, na):
    commands = [waves(300, [0.5], i) for i in range(2)]
    found = smoothed(record(ROD.replace(MOTOR, motor), ("angle",), commands, 1e-3))
    assert found.converged and found.states.act.shape == (300, na)
    assert found.chi2 / found.count == pytest.approx(1, abs=0.1)
    assert np.sqrt(np.mean(found.tau**2)) < 0.02


def test_gaps_are_bridged_by_the_model():
    whole = arm()
    run = whole.runs[0]
    gaps = run.measured.copy()
    gaps[100:130], gaps[::3, 1] = np.nan, np.nan
    broken = replace(whole, runs=(replace(run, measured=gaps),), unknowns=())
    found, full = smoothed(broken), smoothed(replace(broken, runs=(run,)))
    assert found.converged and found.count == np.isfinite(gaps).sum()
    np.testing.assert_allclose(found.states.qpos, full.states.qpos, atol=3e-3)


def test_a_joint_that_is_not_measured_follows_from_the_model():
    gentle = [waves(300, [0.2, 0.05], i) for i in range(2)]
    both = record(ARM, ("q1", "q2"), gentle, 2e-4)
    one = replace(both, channels=("q1",), noise=both.noise[:1])
    one = replace(one, runs=tuple(replace(r, measured=r.measured[:, :1]) for r in both.runs))
    found, full = smoothed(one), smoothed(both)
    assert found.converged
    off = found.states.qpos[:, 1] - full.states.qpos[:, 1]
    assert np.sqrt(np.mean(off**2)) < 0.05 * full.states.qpos[:, 1].std()


@cache
def bouncing() -> Prepared:
    rng = np.random.default_rng(0)
    starts = [([0, 0, 0.2 + 0.05 * i, 1, 0, 0, 0], [*rng.uniform(-1, 1, 2), 0.5, 0, 0, 0]) for i in range(4)]
    noise = [5e-4] * 3 + [2e-3] * 4
    return prepare(record(BALL, SEEN, [np.zeros((60, 0))] * 4, noise, starts=starts, fine=5))


def test_a_ball_that_bounces_is_followed_through_its_contacts():
    made = bouncing()
    found = smooth(made.track, made.begun, made.noise)
    assert found.converged
    assert found.chi2 / found.count == pytest.approx(1, abs=0.08)
    flight, _, change = found.levels.force[[FLIGHT, STANCE, CHANGE]]
    assert set(found.levels.mode) == {FLIGHT, STANCE, CHANGE}
    assert flight[2] < 0.01 * 0.3 * 9.81 and flight[2] < change[2]


def test_what_was_simulated_does_not_stand_where_the_plant_responds_otherwise():
    made = bouncing()
    fit = smooth(made.track, made.begun, made.noise)
    (tried,) = candidates([EFFECTS["contact_stiffness"]], fit.track, motion_scales(fit))[:1]
    known = Simulated()
    rough = columns(fit, [tried], known).innovations
    moved = replace(fit, states=fit.states)
    np.testing.assert_array_equal(columns(moved, [tried], known).innovations, rough)
    heavy = copy.copy(fit.linear.plant.model)
    heavy.body_mass[1] *= 1.5
    plant = replace(fit.linear.plant, models=(heavy,))
    other = replace(fit, linear=replace(fit.linear, plant=plant))
    assert not np.allclose(columns(other, [tried], known).innovations, rough, rtol=0.05)


def test_the_same_recording_gives_the_same_fit():
    one, other = smoothed(rod(0.05)), smoothed(rod(0.05))
    np.testing.assert_array_equal(one.tau, other.tau)


SLED = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body name="sled"><joint name="rail" type="slide"
axis="1 0 0"/><geom type="box" size=".05 .05 .05" mass="1" contype="0" conaffinity="0"/><site name="imu"/></body>
</worldbody><sensor><jointpos name="place" joint="rail"/><accelerometer name="felt" site="imu"/></sensor></mujoco>"""


def test_no_law_of_a_reading_is_fitted_to_the_noise_of_a_smoothed_acceleration():
    """A gust of its own in each sample: the sensor shows it, and what is smoothed holds the sensor's noise."""
    rng = np.random.default_rng(4)
    gusts = 1.5 * rng.standard_normal(2000)

    def pull(model, data):
        return gusts[[int(data.time / PERIOD)]]

    commands, free = [np.zeros((500, 0))] * 3, Unknown("mass", "sled", 0.1)
    made = prepare(record(SLED, ("place", "felt[0]"), commands, [1e-3, 1.0], pull=pull, unknowns=[free], fine=10))
    fit = smooth(made.track, made.begun, made.noise)
    assert np.abs(fit.surprise[:, 1]).max() > 1 and not fit.surprise[:, 0].any()
    drift = at(EFFECTS["clock_drift"], "all", made.track.model, motion_scales(fit))

    def gain(own):
        asked = Regression(own, columns(own, drift))
        gained, dispersion = asked.gain(asked.solve([0]), asked.solve([0, 1]))
        return gained / dispersion

    assert 5 * gain(fit) < gain(replace(fit, surprise=np.zeros_like(fit.surprise)))


def test_a_step_that_is_no_number_ends_a_fit_with_what_it_had(monkeypatch):
    made = prepare(rod(0.3), refine=1)
    told, moves, calls = smooth(made.track, made.begun, made.noise), Solved.moves, []

    def wild(self, *own):
        calls.append(own)
        return np.nan if len(calls) == told.rounds else moves(self, *own)

    monkeypatch.setattr(Solved, "moves", wild)
    fit = smooth(made.track, made.begun, made.noise)
    assert not fit.converged and fit.rounds == told.rounds
    assert np.isfinite(fit.tau).all() and fit.chi2 == pytest.approx(told.chi2, rel=0.05)


@pytest.mark.parametrize(("creep", "converges"), [(0.9, True), (1.1, False)])
def test_a_fit_that_creeps_and_gains_nothing_by_it_stands_still(monkeypatch, creep, converges):
    """Its trajectory still moves, by a share of `WORN`."""
    moves = Solved.moves
    monkeypatch.setattr(Solved, "moves", lambda self, *own: max(creep * smoother.WORN, moves(self, *own)))
    made = prepare(rod(0.15), refine=1)
    assert smooth(made.track, made.begun, made.noise).converged == converges


def test_a_fit_that_stays_above_its_bar_ends_and_has_not_converged(monkeypatch):
    monkeypatch.setattr(smoother, "ROUNDS_ABOVE_BAR", 1)
    made = prepare(rod(0.15), refine=1)
    plain = smooth(made.track, made.begun, made.noise)
    ended = smooth(made.track, made.begun, made.noise, bar=plain.loss() - 1e3)
    assert plain.converged and plain.rounds > 2
    assert not ended.converged and ended.rounds < plain.rounds
    assert smooth(made.track, made.begun, made.noise, bar=plain.loss() + 1e3).converged


def test_signs_that_are_held_keep_no_fit_above_its_bar_going(monkeypatch):
    for name in ("SHRINKS", "STILL", "TIED"):  # signs are held from the third round, and nothing is ever still
        monkeypatch.setattr(smoother, name, 0.0)
    made = prepare(rod(0.15), refine=1)
    plain = smooth(made.track, made.begun, made.noise)
    assert not plain.converged and plain.rounds == smoother.ROUNDS
    assert smooth(made.track, made.begun, made.noise, bar=plain.loss() - 1e3).rounds < smoother.ROUNDS / 2


def test_where_a_shape_may_be_is_as_likely_all_over_its_range():
    made = prepare(rod(0.15), refine=1)
    naive = smooth(made.track, made.begun, made.noise)
    own = at(EFFECTS["payload"], "rod", made.track.model, motion_scales(naive))[0]
    place = parameters(made.track.simulator, naive.theta, [own.placed([0.1])], [own.priors])[-1]
    assert (place.name, place.mean, place.low, place.high) == ("place", pytest.approx(0.3), 0.0, pytest.approx(0.6))
    assert place.sd == pytest.approx(0.6 / np.sqrt(12))  # a rod of 0.4 m and half as much


def test_a_fit_that_comes_nearer_to_its_bar_goes_on(monkeypatch):
    """Dry friction begun at a sixteenth of its size, which at most doubles in a round."""
    monkeypatch.setattr(smoother, "ROUNDS_ABOVE_BAR", 1)
    made = prepare(rod(0.15))
    naive = smooth(made.track, made.begun, made.noise)
    own = at(EFFECTS["coulomb"], "pivot", made.track.model, motion_scales(naive))[0]
    asked = made.track, made.begun, made.noise, [own.placed([0.15 / 16])], [own.priors], naive
    whole = smooth(*asked)
    assert whole.converged and smooth(*asked, bar=whole.loss() + 100.0).converged


@pytest.mark.parametrize("size", [np.inf, 1e9])
def test_a_step_that_runs_away_is_halved(monkeypatch, size):
    """Once, and the fit comes to what it would have without."""
    made, plain, count = prepare(rod(0.15, free=True), refine=1), smoother.solve, []
    known = smooth(made.track, made.begun, made.noise)

    def runs_away(*given):
        found = plain(*given)
        count.extend([1] * (len(given) > 6))
        return replace(found, chi2=size) if len(given) > 6 and len(count) == 3 else found

    monkeypatch.setattr(smoother, "solve", runs_away)
    found = smooth(made.track, made.begun, made.noise)
    assert found.converged and known.rounds < found.rounds <= known.rounds + 2
    assert found.loss() < known.loss() + 10


@pytest.mark.parametrize(("worn", "sound"), [(10.0, True), (1e-9, False)])
def test_of_a_fit_that_runs_away_stands_what_was_nearly_still_before(monkeypatch, worn, sound):
    """From its third round on; nearly still is what moves the readings by less than `worn` of their noise."""
    made, plain, count = prepare(rod(0.15, free=True), refine=1), smoother.solve, []

    def runs_away(*given):
        found = plain(*given)
        count.extend([1] * (len(given) > 6))  # with a dispersion: once a round
        return replace(found, chi2=np.inf) if len(given) > 6 and len(count) >= 3 else found

    monkeypatch.setattr(smoother, "solve", runs_away)
    monkeypatch.setattr(smoother, "WORN", worn)
    found = smooth(made.track, made.begun, made.noise)
    assert found.rounds > 3 and not found.converged
    assert np.isfinite(found.chi2) == sound
