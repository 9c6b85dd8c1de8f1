"""Gears that give, against MuJoCo with a second joint between motor and link."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from fimpact.benchmark.planting import gears
from fimpact.benchmark.planting.ground_truth import compiled, new_world
from fimpact.benchmark.rigs.registry import rig_of
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.effects.drives import servo_force
from fimpact.effects.gears import Shaft, elastic, loose
from fimpact.effects.law_inputs import State
from fimpact.recordings import Recording, Run
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import Simulator
from fimpact.simulation.windows import cut

ROTOR, PERIOD = 0.004, 0.005
XML = f"""
<mujoco>
  <option timestep="{PERIOD}" gravity="0 0 0"/>
  <worldbody>
    <body name="link">
      <joint name="hinge" axis="0 0 1" armature="{ROTOR}" damping="0.05"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.4" contype="0" conaffinity="0"/>
      <site name="end" pos="0.3 0 0"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge"/></actuator>
  <sensor>
    <jointpos name="encoder" joint="hinge"/><jointvel name="tacho" joint="hinge"/>
    <accelerometer name="felt" site="end"/>
  </sensor>
</mujoco>
"""
CHANNELS = ("encoder", "tacho", "felt[1]")


def commands():
    """One run of a second, (1, T, nu), N m."""
    time = np.arange(200) * PERIOD
    return 0.5 * (np.sin(9 * time) + np.sin(23 * time))[None, :, None]


def measured(xml, refine=1, placed=(), joints=1):
    """(T, ny) from rest."""
    runs = (Run("run", commands()[0], np.zeros((200, 3)), False),)
    recording = Recording(xml, ".", PERIOD, CHANNELS, runs, (), np.ones(3), np.full(2 * joints, np.inf), 0.0)
    simulator, windows = Simulator(recording, refine), cut(runs, 0)
    return simulator.predict(Hypothesis(np.zeros(0), placed), windows, *np.zeros((2, 1, joints)))[0]


def behind(name, values, xml=XML):
    """The same mechanism with a joint between motor and link, as the benchmark plants it."""
    world = SimpleNamespace(spec=mujoco.MjSpec.from_string(xml), shafts=[], angle=np.pi / 180)
    planted = {key: value for key, value in values.items() if key != "retardation"}
    getattr(gears, name)(world, "hinge", **planted)
    return world.spec.to_xml()


@pytest.mark.parametrize(
    ("name", "values", "left"),
    [
        ("joint_elasticity", {"compliance": 0.02, "retardation": 2e-3}, [0.06, 0.03, 0.03]),
        ("joint_elasticity", {"compliance": 1e-4, "retardation": 2e-3}, [np.inf, np.inf, 0.02]),
        # Ends of a play that are softer than ours spread a blow, which the link feels, over more samples.
        ("backlash", {"gap": 0.02}, [0.1, 0.5, np.inf]),
    ],
)
def test_a_gear_does_what_a_joint_behind_the_motor_does(name, values, left):
    """Encoder, tachometer and the acceleration of the link: of what rigid gears miss, this share is left."""
    nature, rigid = measured(behind(name, values), 40, joints=2), measured(XML, 40)
    found = measured(XML, 16, (Placed(EFFECTS[name], "hinge", values),))
    error, missing = (np.sqrt(((nature - other)[5:] ** 2).mean(0)) for other in (found, rigid))
    assert (error < left * missing).all(), error / missing


@pytest.mark.parametrize(
    ("name", "values", "left"),
    [
        ("joint_elasticity", {"compliance": 0.02, "retardation": 2e-3}, [0.05, 0.01, 0.01]),
        ("backlash", {"gap": 0.1}, [0.2, 0.4, np.inf]),
    ],
)
@pytest.mark.parametrize(("kp", "kv"), [(8, 0.1), (40, 0.3)])
def test_a_servo_holds_its_motor_and_not_the_link(kp, kv, name, values, left):
    servo = XML.replace("<motor ", f'<position kp="{kp}" kv="{kv}" ')
    nature, rigid = measured(behind(name, values, servo), 40, joints=2), measured(servo, 40)
    found = measured(servo, 16, (Placed(EFFECTS[name], "hinge", values),))
    error, missing = (np.sqrt(((nature - other)[5:] ** 2).mean(0)) for other in (found, rigid))
    assert (error < left * missing).all(), error / missing


def test_a_servo_that_is_saturated_no_longer_looks():
    """Beyond its limit, what it gives does not depend on where its motor is."""
    model = mujoco.MjModel.from_xml_string(XML.replace("<motor ", '<position kp="40" kv="0.3" forcerange="-1 1" '))
    ctrl = np.array([[0.01], [1.0]])
    state = State(model, np.zeros((2, 1)), np.zeros((2, 1)), ctrl, np.zeros(2), PERIOD)
    lead, rate = np.full((2, 2), 0.01)
    force, stiffness, damping = servo_force(state, "hinge", lead, rate)
    np.testing.assert_allclose(force, [40 * (0.01 - 0.01) - 0.3 * 0.01, 1.0], atol=1e-12)
    np.testing.assert_allclose(stiffness, [40, 0], rtol=1e-6)
    np.testing.assert_allclose(damping, [0.3, 0], rtol=1e-6)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (("backlash", {"gap": 0.02}), ("efficiency", {"driving": 0.1, "driven": 0.1})),
        (("load_dependent_friction", {"coefficient": 0.3}), ("backlash", {"gap": 0.02})),
    ],
)
def test_a_law_leaves_nothing_behind(first, second):
    """Models of windows are used again, by laws that know nothing of those before."""
    runs = (Run("run", commands()[0], np.zeros((200, 3)), False),)
    recording = Recording(XML, ".", PERIOD, CHANNELS, runs, (), np.ones(3), np.full(2, np.inf), 0.0)
    used, fresh, start = Simulator(recording), Simulator(recording), np.zeros((2, 1, 1))
    before, after = (Hypothesis(np.zeros(0), (Placed(EFFECTS[n], "hinge", v),)) for n, v in (first, second))
    used.predict(before, cut(runs, 0), *start)
    found, expected = (s.predict(after, cut(runs, 0), *start) for s in (used, fresh))
    np.testing.assert_array_equal(found, expected)


def test_a_stiff_gear_is_rigid_but_not_at_once():
    """What it lets through in a step is all; at the very instant of a command, what it held before."""
    memory = {}
    for torque in (1.0, 1.0, 1.0, 3.0):
        shaft = Shaft(np.array([torque]), np.zeros(1), ROTOR, PERIOD, memory)
        found = elastic(shaft, "hinge", compliance=1e-9, retardation=1e-5)
    assert found.inertia[0] == pytest.approx(ROTOR, rel=1e-3) and found.pull[0] == pytest.approx(0.0, abs=0.02)
    assert found.at_once[0][0] == pytest.approx(1.0 - 3.0, rel=1e-3) and found.at_once[1][0] == 0.0


def test_a_rotor_without_inertia_winds_up_all_the_same():
    memory, leads = {}, []
    for torque in (0.0, 2.0, 2.0, 2.0):
        found = elastic(Shaft(np.array([torque]), np.zeros(1), 0.0, PERIOD, memory), "hinge", 0.01, retardation=PERIOD)
        leads.append(found.lead[0])
    assert leads == pytest.approx([0.0, 0.0, 0.02 * (1 - np.exp(-1)), 0.02 * (1 - np.exp(-2))])
    assert not found.pull.any() and not found.inertia.any()


LAWS = {
    "elastic": lambda shaft: elastic(shaft, "", compliance=0.01, retardation=1e-3),
    "loose": lambda shaft: loose(shaft, "", gap=0.01),
}


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_momentum_is_neither_made_nor_lost(law):
    """What the motor gives is what rotor and link have, once they are at rest against each other."""
    rng, memory, speed, link, given = np.random.default_rng(0), {}, np.zeros(3), 0.01, np.zeros(3)
    for k in range(400):
        torque = rng.normal(size=3) if k < 300 else np.ones(3)
        found = law(Shaft(torque, speed, ROTOR, PERIOD, memory))
        given = given + torque * PERIOD
        speed = speed + PERIOD * (torque + found.pull) / (link + found.inertia)
    np.testing.assert_allclose((link + ROTOR) * speed, given, rtol=2e-3)


def test_play_is_never_left():
    rng, memory, speed = np.random.default_rng(1), {}, np.zeros(5)
    for _ in range(300):
        found = loose(Shaft(rng.normal(size=5), speed, ROTOR, PERIOD, memory), "hinge", gap=0.01)
        speed = speed + rng.normal(size=5) * 0.3
        assert (np.abs(found.lead) <= 0.005 + 1e-12).all()
        assert ((found.inertia >= -1e-12) & (found.inertia <= ROTOR + 1e-12)).all()


def test_what_is_planted_leaves_contacts_as_soft_as_they_were():
    """MuJoCo scales the softness of a contact by an inverse inertia that a joint behind the motor would change."""
    rig = rig_of("arm_contact")
    plain, world = (new_world(rig, np.zeros(len(rig.unknowns)), fine=True) for _ in range(2))
    gears.joint_elasticity(world, "joint_3", compliance=0.002)
    found, raw = compiled(world), world.spec.compile()
    np.testing.assert_allclose(found.body_invweight0, compiled(plain).body_invweight0, rtol=1e-4)
    assert not np.allclose(raw.body_invweight0, compiled(plain).body_invweight0, rtol=0.05)
