"""Gears that give under a servo: the rotor is estimated with the link, and asked for by a refit."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from recorded import ARM, ROD, record, waves

from fimpact.benchmark.planting import gears
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed, Scales
from fimpact.recordings import Recording
from fimpact.selection.explanation import explain
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.rotors import Rotors
from fimpact.simulation.simulator import Simulator
from fimpact.smoothing.candidates import at
from fimpact.smoothing.columns import motion_scales
from fimpact.smoothing.dynamics.rotor_states import turning, with_rotors
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth

PERIOD, RETARDATION = 0.02, gears.RINGING
SERVO = ROD.replace('damping="0.02"', 'damping="0.1" armature="0.03"').replace(
    '<motor name="motor" joint="pivot"/>', '<position name="motor" joint="pivot" kp="9" kv="0.2"/>'
)
VALUES = {"joint_elasticity": {"compliance": 0.01}, "backlash": {"gap": 0.03}}


def behind(name: str, values: dict[str, float], xml: str = SERVO) -> str:
    """The same rod with a joint between motor and link, as the benchmark plants it."""
    world = SimpleNamespace(spec=mujoco.MjSpec.from_string(xml), shafts=[], angle=np.pi / 180)
    getattr(gears, name)(world, "pivot", **values)
    return world.spec.to_xml()


@cache
def recorded(name: str = "") -> Recording:
    """Three runs of 4 s at 50 Hz, one held out, of a rod with the gear `name`, and the model without one."""
    xml = behind(name, VALUES[name]) if name else SERVO
    made = record(xml, ("angle",), [waves(200, [0.6], i, PERIOD) for i in range(3)], 1e-3, period=PERIOD, fine=200)
    return replace(made, xml=SERVO, start_sd=np.full(2, np.inf))


def placed(name: str, **values: float) -> Placed:
    own = {"retardation": RETARDATION} if name == "joint_elasticity" else {}
    return Placed(EFFECTS[name], "pivot", {**own, **VALUES[name], **values})


FOOT = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="2 2 0.1"/>
<body name="hopper" pos="0 0 0.1"><joint name="rail" type="slide" axis="0 0 1"/><geom name="foot" size="0.1" mass="1"/>
</body></worldbody><contact><pair name="foot_floor" geom1="floor" geom2="foot" solref="0.05 1"/></contact>
<actuator><motor name="lift" joint="rail"/></actuator>
<sensor><jointpos name="height" joint="rail"/></sensor></mujoco>"""


@pytest.mark.parametrize(
    ("xml", "site"), [(ARM, "elbow"), (SERVO, "pivot"), (FOOT, "rail")], ids=["arm", "servo", "foot"]
)
def test_every_edit_of_a_model_does_beside_a_gear_what_it_does_without(xml, site):
    """Also one that makes a motor, or a contact, of another kind."""
    sensors = [name for name in ("q1", "q2", "angle", "height") if f'"{name}"' in xml]
    simulator = Simulator(record(xml, sensors, [np.zeros((4, 2 if xml == ARM else 1))], 1e-4))
    gear = Placed(EFFECTS["joint_elasticity"], site, {"compliance": 1e-3, "retardation": 5e-3})
    rotors, base = Rotors(simulator, (site,)), simulator.base
    rng = np.random.default_rng(0)
    qpos, qvel = rng.uniform(-0.02, 0, (3, base.nq)), rng.normal(size=(3, base.nv))
    ctrl, force = rng.normal(size=(3, base.nu)), np.zeros((3, base.nv))

    def rates(model) -> tuple[np.ndarray, np.ndarray]:
        beside = rotors.advance(model, [gear], qpos, qvel, np.zeros((3, base.na + 2)), ctrl, force)[1]
        return beside, simulator.advance(model, qpos, qvel, np.zeros((3, base.na)), ctrl, force)[1]

    plain, seen = rates(simulator.model(Hypothesis(simulator.theta))), set()
    each, motors = np.ones(base.nv), np.ones(base.nu)
    scales = Scales(each, each, each, each, motors, motors, motors, np.ones(len(sensors)), 1.0, 0.3, 9.81, PERIOD, 4.0)
    for effect in (e for e in EFFECTS.values() if e.enters == "model"):
        for own in effect.sites(base, ()):
            for probe in effect.probes(scales, base, own):
                law = Placed(effect, own, {**effect.neutral, **probe})
                edited = rates(simulator.model(Hypothesis(simulator.theta, (law,))))
                with_gear, without = (after - before for after, before in zip(edited, plain, strict=True))
                if np.abs(without).max() > 1e-6:
                    seen.add(law.name)
                    assert np.abs(with_gear).max() > 0.02 * np.abs(without).max(), law
    assert len(seen) > 3


@pytest.mark.parametrize("damped", [0.02, 0.1])
def test_a_sample_is_that_of_a_joint_between_motor_and_link(damped):
    """The bearing is the link's, and so is what is missing of the force."""
    xml = SERVO.replace('damping="0.1"', f'damping="{damped}" stiffness="0.5" springref="10"')
    own = replace(recorded(), xml=xml)
    simulator, whole = (
        Simulator(own, 8),
        Simulator(replace(own, xml=behind("joint_elasticity", {"compliance": 0.01}, xml)), 8),
    )
    whole.base.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    rng = np.random.default_rng(0)
    link, lead, rate, turn, target, push = rng.standard_normal((6, 20, 1))
    lead *= 0.05
    state = link, rate, np.concatenate([lead, turn], 1)
    found = Rotors(simulator, ("pivot",)).advance(simulator.base, [placed("joint_elasticity")], *state, target, push)
    motor, second = np.concatenate([link + lead, -lead], 1), np.concatenate([rate + turn, -turn], 1)
    none = np.zeros((20, 0))
    qpos, qvel, _, read = whole.advance(whole.base, motor, second, none, target, np.repeat(push, 2, 1))
    np.testing.assert_allclose(found[0][:, 0], qpos.sum(1), atol=1e-6)
    np.testing.assert_allclose(found[1][:, 0], qvel.sum(1), atol=1e-5)
    np.testing.assert_allclose(found[2], -np.stack([qpos[:, 1], qvel[:, 1]], 1), atol=1e-5)
    np.testing.assert_allclose(found[3], read, atol=1e-12)
    np.testing.assert_allclose(read[:, 0], motor[:, 0], atol=1e-12)


def test_a_gear_that_does_not_give_is_rigid():
    simulator, state = Simulator(recorded(), 8), (np.full((1, 1), 0.2), np.ones((1, 1)))
    simulator.base.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    gear = placed("joint_elasticity", compliance=0.0)
    target, push = np.zeros((1, 1)), np.full((1, 1), 0.3)
    found = Rotors(simulator, ("pivot",)).advance(simulator.base, [gear], *state, np.zeros((1, 2)), target, push)
    rigid = simulator.advance(simulator.base, *state, np.zeros((1, 0)), target, push)
    for own, other in zip(found[:2], rigid[:2], strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-6)
    assert np.abs(found[2]).max() < 1e-6


def test_contacts_are_as_soft_as_with_a_rigid_gear():
    simulator = Simulator(recorded(), 8)
    own = Rotors(simulator, ("pivot",)).model(simulator.base, [placed("joint_elasticity")])
    np.testing.assert_array_equal(own.body_invweight0, simulator.base.body_invweight0)
    assert own.dof_invweight0[1] > 1.5 * simulator.base.dof_invweight0[0]  # the link alone turns easier


@pytest.mark.parametrize(
    ("name", "value", "near"), [("joint_elasticity", "compliance", 0.1), ("backlash", "gap", 0.15)]
)
def test_a_gear_under_a_servo_is_found_as_it_is(name, value, near):
    made = prepare(recorded(name))
    first = at(EFFECTS[name], "pivot", made.track.model, motion_scales(made.naive))[0]
    begun = first.placed_as({**first.shapes, **first.effect.neutral, **first.shapes, value: 0.5 * VALUES[name][value]})
    found = smooth(made.track, made.begun, made.noise, [begun], [first.priors], made.naive)
    assert found.converged and found.loss() < made.naive.loss() - 50
    assert found.placed[0].values[value] == pytest.approx(VALUES[name][value], rel=near)
    assert found.levels.forces.max() < 0.2 * made.naive.levels.forces.max()


def test_readings_stay_where_a_rotor_comes_and_goes():
    made = prepare(recorded("backlash"))
    states, gear = made.naive.states, [placed("backlash")]
    wound = with_rotors(made.track, states, (), gear)
    assert wound.act.shape[1] == 2 and np.ptp(wound.act[:, 0]) > 0.5 * VALUES["backlash"]["gap"]
    np.testing.assert_allclose(wound.qpos + wound.act[:, :1], states.qpos, atol=1e-12)
    np.testing.assert_allclose(wound.qvel + wound.act[:, 1:], states.qvel, atol=1e-12)
    assert with_rotors(made.track, wound, gear, [*gear, placed("backlash")][:1]) is wound
    back = with_rotors(made.track, wound, gear, ())
    np.testing.assert_allclose(back.qpos, states.qpos, atol=1e-12)
    assert back.act.shape[1] == 0


def test_a_plain_motor_leaves_its_rotor_to_the_law():
    """It throws the rotor from end to end of a play: through its blows no tangent holds."""
    made = prepare(
        replace(recorded(), xml=SERVO.replace("position", "motor").replace(' kp="9" kv="0.2"', "")), refine=1
    )
    assert turning(made.track, [placed("backlash")]) == ()
    assert turning(prepare(recorded(), refine=1).track, [placed("backlash")]) == (placed("backlash"),)
    assert turning(made.track, [placed("joint_elasticity")]) == (placed("joint_elasticity"),)


@pytest.mark.parametrize("name", ["joint_elasticity", "backlash", ""])
def test_what_no_column_shows_is_asked_by_a_refit(name):
    made = prepare(recorded(name))
    known = [EFFECTS[own] for own in ("viscous", "coulomb", "backlash", "joint_elasticity")]
    found = explain(made.track, made.begun, made.noise, known, naive=made.naive)
    assert [law.name for law in found.final.placed] == ([f"{name}@pivot"] if name else [])
