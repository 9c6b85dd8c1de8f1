"""Servos whose samples are long: how late they are, dry friction within a sample, and columns that are simulated."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from recorded import record, waves

from fimpact.deciding import REFINES, SHARE
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.recordings import Recording
from fimpact.selection import pruning, servo_drives
from fimpact.selection.forward import Search
from fimpact.selection.one_round import search
from fimpact.selection.options import Option
from fimpact.selection.pruning import pruned, without_doubtful_parts
from fimpact.selection.regression import Regression
from fimpact.selection.servo_drives import align, drive, far, restored
from fimpact.selection.substitutes import Alternative
from fimpact.simulation.state_guess import believed_noise, noise_level
from fimpact.smoothing.candidates import candidates
from fimpact.smoothing.columns import columns, motion_scales, units
from fimpact.smoothing.dynamics.linear import inverse_of_push
from fimpact.smoothing.dynamics.plant import plant_of
from fimpact.smoothing.dynamics.response import Response
from fimpact.smoothing.prepare import Prepared, prepare
from fimpact.smoothing.servo_lag import lateness
from fimpact.smoothing.simulated_laws import Simulated
from fimpact.smoothing.smoother import Smoothed, smooth

PERIOD = 0.02
XML = """<mujoco><option timestep="0.002"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
<body name="link"><joint name="pivot" axis="0 1 0" damping="0.3" armature="0.03" frictionloss="{friction}"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.3"/></body></worldbody>
<actuator><position name="servo" joint="pivot" kp="{kp}" kv="1" forcerange="-3 3"/></actuator>
<sensor><jointpos name="angle" joint="pivot"/></sensor></mujoco>"""


def followed(late: int = 0, friction: float = 0.0, kp: float = 300.0, noise: float = 3e-4) -> Recording:
    """A servo that follows its targets so many samples late; what is recorded is the targets as they were given."""
    xml, shift = XML.format(friction=friction, kp=kp), late + 1
    targets = 0.4 + waves(150 + shift, [0.4], 1, PERIOD)
    held = np.concatenate([np.repeat(targets[:1], late, 0), targets])[: len(targets)]
    start = [(targets[0], np.zeros(1))]
    found = record(xml, ["angle"], [held], noise, period=PERIOD, fine=200, starts=start)
    return replace(found, runs=(replace(found.runs[0], ctrl=targets),))


@pytest.mark.parametrize(("late", "named"), [(0, ()), (3, ("command_delay", "actuator_lag"))])
def test_how_late_a_servo_is_shows_before_all_else(late, named):
    made = prepare(followed(late))
    assert {way[0].effect.name for way in made.late} <= set(named) and bool(made.late) == bool(named)
    if named:
        found = next(way[0] for way in made.late if way[0].effect.name == "command_delay")
        assert found.values["delay"] == pytest.approx(late * PERIOD, abs=PERIOD / 4)


def test_how_soft_a_late_servo_is_shows_with_it():
    """A gain that is 40 % less than the model's looks like a few milliseconds more of delay."""
    soft = followed(3, kp=180.0)
    made = prepare(replace(soft, xml=soft.xml.replace('kp="180.0"', 'kp="300"')))
    delay, gain = next(way for way in made.late if len(way) > 1 and way[0].effect.name == "command_delay")
    assert delay.values["delay"] == pytest.approx(3 * PERIOD, abs=2e-3)
    assert gain.effect.name == "servo_kp" and gain.values["change"] == pytest.approx(-0.4, abs=0.15)
    search = Search(made.track, made.begun, made.noise, list(EFFECTS.values()), lambda line: None)
    align(search, made.late)
    found = {law.effect.name: law.values for law in search.current.placed}
    assert set(found) == {"command_delay", "servo_kp"}
    assert found["command_delay"]["delay"] == pytest.approx(0.06, abs=1e-3)
    assert found["servo_kp"]["change"] == pytest.approx(-0.4, abs=0.05)


def test_what_is_lacking_of_a_drive_is_no_lag():
    """Half of the rotor's inertia and of the damping are missing: that is late, too, but never nearly all of it."""
    heavy = followed(kp=30.0)
    light = heavy.xml.replace('armature="0.03"', 'armature="0.015"').replace('damping="0.3"', 'damping="0.15"')
    made = prepare(replace(heavy, xml=light))
    assert lateness(made.track, made.begun, made.noise) == ()


def test_motors_that_hold_no_position_are_not_asked():
    xml = '<motor name="servo" joint="pivot"/>'
    own = followed()
    begin, end = own.xml.index("<position"), own.xml.index("</actuator>")
    assert prepare(replace(own, xml=own.xml[:begin] + xml + own.xml[end:])).late == ()


@cache
def made() -> tuple[Prepared, Smoothed]:
    own = prepare(followed(friction=0.2), refine=4)
    return own, smooth(own.track, own.begun, own.noise)


def test_the_models_own_friction_stops_a_joint_at_once_within_a_long_sample():
    own, fit = made()
    still = np.zeros_like(fit.states.qvel)
    plant = plant_of(own.track, (), fit.theta, fit.states, still, np.ones_like(still))
    assert own.track.long and not plant.dry.any()
    ours = plant.step(fit.states, still).after.qpos
    soft, sharp = (truth(fit, own.track.ctrl[:, 0], tight) for tight in (False, True))
    off = [float(np.sqrt(((ours - theirs) ** 2).mean())) for theirs in (soft, sharp)]
    assert off[1] < 0.3 * off[0]


def truth(fit: Smoothed, targets: np.ndarray, tight: bool) -> np.ndarray:
    """Angles a sample ahead of each state, by steps of 20 us; tight: with friction that follows its exact law."""
    model = mujoco.MjModel.from_xml_string(XML.format(friction=0.2, kp=300.0))
    model.opt.timestep = 2e-5
    if tight:
        model.dof_solref[:], model.dof_solimp[:, :2] = (4e-5, 1.0), 0.9999
    data, out = mujoco.MjData(model), []
    for qpos, qvel, target in zip(fit.states.qpos, fit.states.qvel, targets, strict=True):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, target
        mujoco.mj_step(model, data, round(PERIOD / 2e-5))
        out.append(data.qpos.copy())
    return np.array(out)


def test_columns_of_an_earlier_trajectory_stand_until_they_are_asked_for_again():
    own, fit = made()
    names = ("coulomb", "viscous", "servo_kp", "command_delay", "sensor_bias")
    tried = candidates([EFFECTS[name] for name in names], own.track, motion_scales(fit))
    moved = replace(fit, states=fit.states[np.roll(np.arange(own.track.count), 1)])
    true, known = columns(moved, tried), Simulated()
    columns(fit, tried, known)
    assert not known.renew(units(tried))
    earlier = columns(moved, tried, known)
    assert not np.array_equal(earlier.innovations, true.innovations)
    assert known.renew(units(tried))
    again = columns(moved, tried, known)
    np.testing.assert_array_equal(again.innovations, true.innovations)
    assert not known.renew(units(tried))


def test_firmware_holds_an_arm_and_does_not_load_it():
    own, fit = made()
    (found,) = candidates([EFFECTS["gravity_compensation"]], own.track, motion_scales(fit))
    assert found.positive == (True,)


def search_of(recording: Recording, *more: str) -> Search:
    made = prepare(recording)
    effects = [EFFECTS[name] for name in ("coulomb", "viscous", "rotor_inertia", "payload", *more)]
    return Search(made.track, made.begun, made.noise, effects, lambda line: None)


def test_where_little_is_missing_and_another_does_far_more_the_compound_is_declined():
    """A heavier link than the model has, and a little of its damping is missing."""
    heavy = followed()
    naive = heavy.xml.replace('mass="0.3"', 'mass="0.1"').replace('damping="0.3"', 'damping="0.28"')
    search = search_of(replace(heavy, xml=naive))
    drive(search)
    assert not far(search, search.missing) and search.failed == {"geared drive"} and not search.current.placed


def test_where_much_is_missing_the_compound_is_refitted_whatever_its_columns_say():
    heavy = followed(kp=30.0)
    light = heavy.xml.replace('armature="0.03"', 'armature="0.003"').replace('damping="0.3"', 'damping="0.03"')
    search = search_of(replace(heavy, xml=light))
    drive(search)
    assert far(search, search.missing) and {"viscous@pivot", "rotor_inertia@pivot"} <= {
        law.name for law in search.current.placed
    }


def test_parts_of_a_drive_are_judged_beside_one_another(monkeypatch):
    """Where viscous friction takes nearly all that was missing, the rest still is as much as a refinement."""
    heavy, asked = followed(kp=30.0), {}
    light = heavy.xml.replace('armature="0.03"', 'armature="0.003"').replace('damping="0.3"', 'damping="0.03"')
    search = search_of(replace(heavy, xml=light))
    drive(search)
    assert search.parts >= {law.name for law in search.current.placed} >= {"viscous@pivot"}
    monkeypatch.setattr(pruning, "bears", lambda regression, place, *bar: asked.update({place: bar}) or True)
    pruned(search, search.current)
    assert {floor for _, floor in asked.values()} == {REFINES}
    assert all(missing < search.missing.sum() for missing, _ in asked.values())
    search.parts = set()
    pruned(search, search.current)
    assert {floor for _, floor in asked.values()} == {SHARE}


@pytest.mark.parametrize("shares", [True, False])
def test_what_a_refit_needs_stays_however_badly_its_size_is_known(monkeypatch, shares):
    """But not where it bears no share of what is missing."""
    heavy = followed(kp=30.0)
    light = heavy.xml.replace('damping="0.3"', 'damping="0.03"')
    search = search_of(replace(heavy, xml=light))
    law = next(c for c in search.candidates if c.name == "viscous@pivot")
    made = smooth(search.track, search.begun, search.noise, [law.placed([0.2])], [law.priors], search.naive)
    monkeypatch.setattr(pruning, "chance_of", lambda *given: 1.0)
    monkeypatch.setattr(pruning, "share_of", lambda *given: float(shares))
    assert bool(pruned(search, made).placed) == shares


@pytest.mark.parametrize("drives", [True, False])
def test_what_a_drive_lost_to_a_gain_is_asked_again_in_its_place(drives):
    """Friction has gone while something else was missing, and a softer servo has come; False: it was never in."""
    heavy = followed(kp=30.0)
    light = heavy.xml.replace('armature="0.03"', 'armature="0.003"').replace('damping="0.3"', 'damping="0.03"')
    search = search_of(replace(heavy, xml=light), "servo_kp")
    drive(search)
    whole = {law.name for law in search.current.placed}
    known = {c.name: c for c in search.candidates}
    own = [known["rotor_inertia@pivot"], known["servo_kp@servo"]]
    placed, priors = [own[0].placed([0.02]), own[1].placed([-0.2])], [c.priors for c in own]
    search.current = smooth(search.track, search.begun, search.noise, placed, priors, search.naive)
    search.parts = search.parts if drives else set()
    assert "viscous@pivot" in whole and restored(search) == drives
    assert ({law.name for law in search.current.placed} == whole) == drives
    assert not restored(search)


def test_a_better_optimum_of_the_naive_model_is_where_a_search_begins(monkeypatch):
    """A leg's first fit may end in one of its own; what is likelier than that alone is no name."""
    heavy = followed(kp=30.0)
    search = search_of(replace(heavy, xml=heavy.xml.replace('damping="0.3"', 'damping="0.03"')))
    better = replace(search.naive, fit=search.naive.fit - 10.0, tau=0.5 * search.naive.tau)
    monkeypatch.setattr(servo_drives, "pruned", lambda *given, **known: better)
    drive(search)
    assert search.naive is search.current is better
    np.testing.assert_array_equal(search.missing, better.tau**2)


@pytest.mark.parametrize(("chance", "first", "last"), [(0.1, 0, 0), (0.02, 3, 0), (1e-4, 3, 3)])
def test_parts_that_may_be_hidden_stay_until_all_is_found(monkeypatch, chance, first, last):
    """By their chance where there is nothing of them: alone, and in the end over all that is in."""
    monkeypatch.setattr(pruning, "chance_of", lambda *given: chance)
    monkeypatch.setattr(pruning, "share_of", lambda *given: 1.0)
    monkeypatch.setattr(pruning, "smooth", lambda *given, **known: replace(smooth(*given, **known), fit=-1e9))
    heavy = followed(kp=30.0)
    light = heavy.xml.replace('armature="0.03"', 'armature="0.003"').replace('damping="0.3"', 'damping="0.03"')
    search = search_of(replace(heavy, xml=light))
    drive(search)
    parts = search.current.placed
    assert len(parts) == first
    search.alternatives = [Alternative(parts, search.current.theta, 0.5)]
    assert len(without_doubtful_parts(search).placed) == last == len(search.alternatives[0].placed)
    search.parts = set()
    assert without_doubtful_parts(search) is search.current


def test_what_a_force_does_to_a_joint_that_sticks_is_judged_over_as_much_as_may_be_missing():
    own, fit = made()
    target, weight = own.track.ctrl[:, 0], 0.3 * 9.81 * 0.1
    rest = replace(fit.states, qpos=target + weight * np.cos(target) / 300, qvel=np.zeros_like(fit.states.qvel))
    still = np.zeros_like(rest.qvel)
    plant = plant_of(own.track, (), fit.theta, rest, still, np.ones_like(still))
    plant = replace(plant, ctrl=replace(plant.ctrl, values=own.track.ctrl))
    tangent, wide = (Response(plant, rest, still).slopes(spread).advance[:-1, 0, 2] for spread in (None, np.ones(1)))
    assert np.median(np.abs(tangent)) < 0.1 * np.median(np.abs(wide))


def test_a_joint_that_sticks_is_given_no_force_that_would_move_it():
    own, fit = made()
    advance = fit.linear.advance.copy()
    advance[5, :, -1] = 1e-6 * np.median(advance[:, :, -1], 0)
    push = inverse_of_push(own.track, replace(fit.linear, advance=advance))
    assert not push[5].any() and push[4].any()


@pytest.mark.parametrize(("noise", "quantum", "known"), [(0.0, 6e-3, True), (2e-3, 1.5e-3, False)])
def test_the_noise_of_an_encoder_that_only_rounds_is_its_quantums(noise, quantum, known):
    own = followed(noise=1e-9)
    read = own.runs[0].measured + noise * np.random.default_rng(0).standard_normal(own.runs[0].measured.shape)
    runs = (replace(own.runs[0], measured=np.round(read / quantum) * quantum),)
    own = replace(own, runs=runs, noise=np.full(1, np.nan))
    level = noise_level(own)
    low, high = believed_noise(own, level)
    assert (low[0] == high[0]) == known and low[0] >= 0.99 * quantum / np.sqrt(12)
    assert level[0] == pytest.approx(quantum / np.sqrt(12) if known else noise, rel=0.5)


def test_the_share_of_what_a_stiff_servo_hides_is_that_of_its_own_force():
    """Of a force that changes its sign, a smoother whose noise is large sees little; of what it does, all counts."""
    own, fit = made()
    (viscous,) = candidates([EFFECTS["viscous"]], own.track, motion_scales(fit))
    tried = [replace(viscous, positive=(False,))]
    regression = Regression(fit, columns(fit, tried))
    missing = 1e3 * (tried[0].sd[0] * fit.states.qvel).var(0) * own.track.count
    (trial,) = search(regression, [Option("viscous", 0, (0,), compound=True)], missing, 0.0).tried
    size = trial.estimate.values[-1] ** 2 / 1e3
    assert trial.share == pytest.approx(size, rel=0.5)


def test_what_stood_in_the_place_of_a_delay_goes_with_it():
    """Drives that lack nearly all look late; once they are in, neither delay nor lag is."""
    heavy = followed(kp=30.0)
    light = heavy.xml.replace('armature="0.03"', 'armature="0.003"').replace('damping="0.3"', 'damping="0.03"')
    search = search_of(replace(heavy, xml=light))
    late = Placed(EFFECTS["command_delay"], "servo", {"delay": 0.03})
    search.current = smooth(search.track, search.begun, search.noise, (late,), ({"delay": 0.05},))
    search.alternatives = [Alternative((late,), search.current.theta, 0.5)]
    drive(search)
    assert {"viscous@pivot", "rotor_inertia@pivot"} <= {law.name for law in search.current.placed}
    gone = "command_delay@servo" not in {law.name for law in search.current.placed}
    assert bool(search.alternatives) != gone
