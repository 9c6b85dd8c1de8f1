"""Every effect says what it is, does nothing at its neutral values, shows at its probe, and exports what it is."""

import copy
import dataclasses
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from fimpact.effects import EFFECTS, get_effect, sites, wiring
from fimpact.effects.base import ENTERS, ENVIRONMENT, Coefficient, Effect, Scales
from fimpact.effects.classes import classes
from fimpact.effects.drives import motor_force
from fimpact.effects.families.sensing import interpolate
from fimpact.effects.gears import Shaft, coupled, encoders
from fimpact.effects.law_inputs import Signal, State
from fimpact.effects.native import editable
from fimpact.effects.typical import second_moments
from fimpact.export.callback import SourceBundle

# An arm in a vertical plane whose tip strikes the ground, its first link hanging on a mirror-imaged axis.
ARM = """
<mujoco>
  <option timestep="0.002"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <geom name="ground" type="plane" size="2 2 .1" pos="0 0 -0.4"/>
    <body name="upper" pos="0 0 0.1">
      <joint name="shoulder" axis="0 1 0" damping="0.05"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.6"/>
      <body name="lower" pos="0.3 0 0">
        <joint name="elbow" axis="0 1 0" damping="0.02" stiffness="0.3" springref="10" range="-170 170"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.4"/>
        <geom name="tip" type="sphere" size="0.03" pos="0.3 0 0" mass="0.05"/>
        <site name="imu" pos="0.2 0 0" euler="0 20 0"/>
      </body>
    </body>
  </worldbody>
  <contact><pair name="tip_ground" geom1="ground" geom2="tip" friction="0.5 0.5 0.005 1e-4 1e-4"/></contact>
  <actuator>
    <motor name="motor_1" joint="shoulder" gear="2"/>
    <motor name="motor_2" joint="elbow"/>
  </actuator>
  <sensor>
    <jointpos name="q1" joint="shoulder"/><jointpos name="q2" joint="elbow"/>
    <accelerometer name="imu" site="imu"/>
  </sensor>
</mujoco>
"""

# The same arm, its motors being servos.
SERVO = ARM.replace('<motor name="motor_1"', '<position name="motor_1" kp="20" kv="1"').replace(
    '<motor name="motor_2"', '<position name="motor_2" kp="10" kv="0.5"'
)

# A spinning ball thrown onto a table: contacts that no pair lists, mixed of both geoms' properties.
BALL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="table" type="box" size="1 1 .05" pos="0 0 0.02" friction="0.4" solref="-4000 -40"/>
    <body name="ball" pos="0 0 0.3">
      <freejoint name="free"/>
      <geom name="shell" type="sphere" size="0.05" mass="0.3" friction="0.6" solref="-5000 -20"/>
    </body>
  </worldbody>
  <sensor><framepos name="place" objtype="body" objname="ball"/></sensor>
</mujoco>
"""

ARM_CHANNELS = ("q1", "q2", "imu[0]", "imu[2]")
BALL_CHANNELS = ("place[0]", "place[1]", "place[2]")
PERIOD, STEPS = 0.002, 500
FREE = 100  # steps before the arm strikes the ground


@dataclasses.dataclass
class Rig:
    """A model, its motion and what is measured of it."""

    xml: str
    channels: tuple[str, ...]
    qpos: np.ndarray
    qvel: np.ndarray
    amplitude: float

    def model(self):
        """A fresh model whose fields may be edited."""
        return editable(mujoco.MjSpec.from_string(self.xml))

    def commands(self, model, steps=STEPS):
        """Two swings of each actuator, as a run of shape (1, steps, nu)."""
        time = np.arange(steps)[:, None] * PERIOD
        return self.amplitude * np.sin(8 * time * (1 + np.arange(model.nu)) + 1)[None]

    def signal(self, ctrl):
        """Time base, names and forces."""
        names = {"q1": ("shoulder", 0), "q2": ("elbow", 1)}
        owners = [names.get(channel, ("", -1)) for channel in self.channels]
        actuators = tuple(self.model().actuator(i).name for i in range(ctrl.shape[2]))
        force = ctrl * [2.0, 1.0] if ctrl.shape[2] else ctrl
        joints, drivers = (tuple(column) for column in zip(*owners, strict=True))
        time = PERIOD * np.arange(ctrl.shape[1])[None]
        return Signal(time, ctrl, self.channels, actuators, force, joints, drivers)


RIGS = {
    "arm": Rig(ARM, ARM_CHANNELS, np.array([0.2, 0.3]), np.zeros(2), 0.6),
    "servo": Rig(SERVO, ARM_CHANNELS, np.array([0.2, 0.3]), np.zeros(2), 0.6),
    "ball": Rig(BALL, BALL_CHANNELS, np.array([0, 0, 0.3, 1, 0, 0, 0]), np.array([1, 0.2, -1, 0, 20, 5.0]), 0.0),
}
SCALES = {
    "arm": (np.array([2.0, 1.0]), np.array([3.0, 4.0]), np.array([0.6, 0.8]), np.array([0.4, 0.4]), 1.05, 0.6),
    "ball": (np.ones(6), np.array([1, 1, 1, 20, 20, 20]), np.ones(6), np.zeros(0), 0.3, 0.3),
}


def scales(name):
    """Natural magnitudes of a rig."""
    force, speed, travel, command, mass, length = SCALES["arm" if name == "servo" else name]
    measured = np.full(len(RIGS[name].channels), 0.5)
    middle = np.zeros_like(travel)
    return Scales(
        force, speed, travel, middle, command, command, 0 * command, measured, mass, length, 9.81, PERIOD, 1.0
    )


def play(rig, model, ctrl, push=None, limit=None, gear=None):
    """States (T, nq + nv) after, and measurements (1, T, ny) before, each step; push: a force law of a State, limit: a
    friction law for the elbow, gear: one of any joint, with its site and values."""
    data, memory, states, measured = mujoco.MjData(model), {}, [], []
    mujoco.mj_resetData(model, data)
    data.qpos[:], data.qvel[:] = rig.qpos, rig.qvel
    places = [model.sensor(wiring.base(c)).adr[0] + wiring.component(c) for c in rig.channels]
    before, step = data.qvel.copy(), model.opt.timestep
    for k, command in enumerate(ctrl[0]):
        data.ctrl[:] = command
        if push or limit:
            ahead = data.qvel + (data.qvel - before) / 2
            state = State(model, data.qpos[None], ahead[None], command[None], np.array([k * PERIOD]), step, memory)
            before = data.qvel.copy()
            if push:
                data.qfrc_applied[:] = push(state)[0]
            else:
                model.dof_frictionloss[1] = np.mean(limit(state))
        if gear:
            state = State(model, data.qpos[None], data.qvel[None], command[None], np.zeros(1), step, memory)
            found = coupled(model, state, *gear)
            dof, rotor = model.joint(gear[1]).dofadr[0], model.dof_armature.copy()
            data.qfrc_applied[dof], model.dof_armature[dof] = found.pull[0], found.inertia[0]
        mujoco.mj_step(model, data)
        if gear:
            data.sensordata[encoders(model, gear[1])[0]] += found.lead[0]
            model.dof_armature[:] = rotor
        measured.append(data.sensordata[places].copy())
        states.append(np.r_[data.qpos, data.qvel])
    return np.array(states), np.array(measured)[None]


def simulate(rig, effect=None, site="", values=None):
    """States and measurements of the rig with an effect added by its law."""
    model = rig.model()
    ctrl = rig.commands(model)
    push = limit = None
    if effect and effect.enters == "model":
        effect.law(model, site, **values)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    if effect and effect.enters == "command":
        ctrl = effect.law(ctrl, rig.signal(ctrl), site, **values)
    if effect and effect.enters == "force":
        push = lambda state: effect.law(state, site, **values)  # noqa: E731
    if effect and effect.enters == "friction":
        limit = lambda state: effect.law(state, site, **values)  # noqa: E731
    gear = (effect.law, site, values) if effect and effect.enters == "gear" else None
    states, measured = play(rig, model, ctrl, push, limit, gear)
    if effect and effect.enters == "measurement":
        measured = effect.law(measured, rig.signal(ctrl), site, **values)
    return states, measured


@pytest.fixture(scope="module")
def plain():
    """Each rig as it is."""
    return {name: simulate(rig) for name, rig in RIGS.items()}


def placements(effect):
    """Every rig and site at which an effect can be."""
    return [(name, site) for name, rig in RIGS.items() for site in effect.sites(rig.model(), rig.channels)]


def ids(effect):
    """Tests are named after the effect."""
    return effect.name


ALL = pytest.mark.parametrize("effect", EFFECTS.values(), ids=ids)
EXPORTED = pytest.mark.parametrize("effect", [e for e in EFFECTS.values() if e.export], ids=ids)


def test_catalogue_is_large_and_named_once():
    """At least 26 entries, each under its own name, with sites to try them in the two rigs."""
    assert len(EFFECTS) >= 26
    assert all(name == effect.name and name.replace("_", "").isalnum() for name, effect in EFFECTS.items())
    assert all(placements(effect) for effect in EFFECTS.values())


def test_unknown_effect_names_the_nearest():
    """The message says where all are listed."""
    with pytest.raises(ValueError, match="did you mean 'coulomb'"):
        get_effect("colomb")
    with pytest.raises(ValueError, match=r"'gremlin' not found; `fimpact effects` lists all"):
        get_effect("gremlin")
    assert get_effect("coulomb") is EFFECTS["coulomb"]


@ALL
def test_entry_is_complete(effect):
    """Texts, units and bounds are there and fit each other and the probes."""
    assert effect.enters in ENTERS and set(effect.contains) <= set(EFFECTS)
    assert all([effect.family, effect.equation, effect.reference, effect.law.__doc__])
    assert effect.sentence[0].isupper() and effect.sentence.endswith(".") and len(effect.sentence) < 130
    names = {c.name for c in effect.coefficients}
    assert names == set(effect.neutral) and all(c.unit for c in effect.coefficients)
    amplitudes = [c for c in effect.coefficients if not c.shape]
    assert amplitudes and all(effect.neutral[c.name] in (0.0, np.inf) for c in amplitudes)
    for name, site in placements(effect):
        probes = effect.probes(scales(name), RIGS[name].model(), site)
        assert probes and all(set(probe) == names for probe in probes)
        assert all(c.low <= probe[c.name] <= c.high for probe in probes for c in effect.coefficients)
        assert all(type(value) is float for probe in probes for value in probe.values())


@ALL
def test_prior_is_a_size(effect):
    """Every amplitude has a positive standard deviation of known origin, that no bound makes meaningless."""
    assert effect.prior_source and 0 <= effect.order <= ENVIRONMENT and set(effect.refines) <= set(EFFECTS)
    assert effect.name not in effect.refines
    for name, site in placements(effect):
        prior = effect.prior(scales(name), RIGS[name].model(), site)
        assert set(prior) == {c.name for c in effect.coefficients if not c.shape}
        assert all(type(sd) is float and 0 < sd < np.inf for sd in prior.values()), f"{effect.name}@{site} {prior}"
        assert all(c.low < prior[c.name] < c.high for c in effect.coefficients if not c.shape)


@ALL
def test_neutral_changes_nothing(effect, plain):
    """States and readings are the same to the last bit."""
    for name, site in placements(effect):
        states, measured = simulate(RIGS[name], effect, site, effect.neutral)
        np.testing.assert_array_equal(states, plain[name][0])
        np.testing.assert_allclose(measured, plain[name][1], rtol=0, atol=1e-12)


@ALL
def test_probe_shows(effect, plain):
    """Every probe is finite, and at some site one changes what is measured by more than rounding."""
    shown = []
    for name, site in placements(effect):
        for probe in effect.probes(scales(name), RIGS[name].model(), site):
            measured = simulate(RIGS[name], effect, site, probe)[1]
            assert np.isfinite(measured).all(), f"{effect.name}@{site} {probe}"
            shown.append(np.abs(measured - plain[name][1]).max())
    assert max(shown) > 1e-6


@EXPORTED
def test_export_is_the_law(effect):
    """Plain MuJoCo C, loaded from the exported XML's spec, moves and reads as the law does."""
    for name, site in placements(effect):
        rig = RIGS[name]
        # Of a turned sensor with two components only the turn between them, the second probe, is seen.
        values = effect.probes(scales(name), rig.model(), site)[1 if effect.name == "misalignment" else -1]
        spec = mujoco.MjSpec.from_string(rig.xml)
        effect.export(spec, site, **values)
        exported = spec.compile()
        if effect.enters == "force":
            _same_force(rig, effect, site, values, exported)
            continue
        states, measured = play(rig, exported, rig.commands(exported))
        by_law = simulate(rig, effect, site, values)
        np.testing.assert_allclose(states, by_law[0], rtol=0, atol=1e-9, err_msg=f"{effect.name}@{site}")
        np.testing.assert_allclose(measured, by_law[1], rtol=0, atol=1e-6, err_msg=f"{effect.name}@{site}")


def _same_force(rig, effect, site, values, exported):
    """A force law is held over a step, a native force is not: they are compared state by state."""
    model, rng = rig.model(), np.random.default_rng(0)
    data = [mujoco.MjData(m) for m in (model, exported)]
    for _ in range(5):
        qvel = rng.normal(size=model.nv)
        for d in data:
            d.qpos[:], d.qvel[:] = rig.qpos, qvel
        mujoco.mj_integratePos(model, data[0].qpos, qvel, 0.1)
        data[1].qpos[:] = data[0].qpos
        mujoco.mj_forward(model, data[0])
        mujoco.mj_forward(exported, data[1])
        state = State(model, data[0].qpos[None], qvel[None], np.zeros((1, model.nu)), np.zeros(1), PERIOD)
        native = data[1].qfrc_passive - data[0].qfrc_passive
        np.testing.assert_allclose(effect.law(state, site, **values)[0], native, atol=1e-9)


def test_export_survives_xml():
    """What is exported is in the XML, to the digits that MuJoCo writes."""
    spec = mujoco.MjSpec.from_string(ARM)
    EFFECTS["spring"].export(spec, "elbow", stiffness=0.7, rest=0.4)
    EFFECTS["direction_dependent_coulomb"].export(spec, "shoulder", forward=0.3, backward=0.1)
    spec.compile()
    model = mujoco.MjModel.from_xml_string(spec.to_xml())
    law = RIGS["arm"].model()
    EFFECTS["spring"].law(law, "elbow", stiffness=0.7, rest=0.4)
    np.testing.assert_allclose(model.jnt_stiffness, law.jnt_stiffness, rtol=1e-5)
    np.testing.assert_allclose(model.qpos_spring, law.qpos_spring, rtol=1e-5)
    assert model.joint("shoulder").frictionloss[0] == pytest.approx(0.2)
    assert model.actuator("motor_1").biasprm[0] == pytest.approx(-0.05)


@pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass'")
def test_export_where_the_compiler_infers_masses():
    """A changed geom or body keeps the other bodies' masses."""
    xml = ARM.replace("<option", '<compiler inertiafromgeom="true" settotalmass="2"/><option', 1)
    spec = mujoco.MjSpec.from_string(xml)
    law = editable(spec)
    EFFECTS["payload"].export(spec, "lower", mass=0.2, place=0.3)
    EFFECTS["payload"].law(law, "lower", mass=0.2, place=0.3)
    np.testing.assert_allclose(spec.compile().body_mass, law.body_mass, rtol=1e-12)


# Laws of model fields, as forces at a speed of 3, a position of 0.5, a command of 0.4.
NATIVE = [
    ("viscous", "elbow", {"damping": 0.2}, -0.2 * 3),
    ("quadratic_damping", "elbow", {"damping": 0.2}, -0.2 * 9),
    ("quadratic_damping", "elbow", {"damping": -0.002}, 0.002 * 9),
    ("hardening_spring", "elbow", {"cubic": 0.2}, -0.2 * (0.5 - np.radians(10)) ** 3),
    ("spring", "elbow", {"stiffness": 0.2, "rest": -0.1}, -0.2 * 0.6),
    ("gain", "motor_2", {"change": 0.1}, 0.04),
    ("torque_offset", "motor_2", {"offset": 0.1}, 0.1),
    ("saturation", "motor_2", {"limit": 0.3}, -0.1),
    ("coulomb", "elbow", {"friction": 0.02}, -0.02),
    ("direction_dependent_coulomb", "elbow", {"forward": 0.02, "backward": 0.01}, -0.02),
]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("name", "site", "values", "force"), NATIVE, ids=[row[0] for row in NATIVE])
def test_native_fields_give_the_equation(name, site, values, force, sign):
    """The equation in the catalogue, with its signs, is what MuJoCo computes."""
    forces = []
    for added in (False, True):
        model = RIGS["arm"].model()
        if added:
            EFFECTS[name].law(model, site, **values)
        data = mujoco.MjData(model)
        data.qpos[1], data.qvel[1], data.ctrl[1] = 0.5, sign * 3, 0.4
        mujoco.mj_forward(model, data)
        forces.append(data.qfrc_passive[1] + data.qfrc_actuator[1] + data.qfrc_constraint[1])
    expected = force
    if "coulomb" in name:
        expected = force if sign > 0 else values.get("backward", values.get("friction"))
    elif name == "viscous" or name.startswith("quadratic"):
        expected = sign * force
    assert forces[1] - forces[0] == pytest.approx(expected, rel=1e-3)


def test_payload_is_a_body_welded_on():
    """The composed inertia is that of a second body in its place."""
    rig = RIGS["arm"]
    extra = (
        '<body pos="0.25 0 0"><inertial pos="0 0 0" mass="0.2" diaginertia="1e-12 1e-12 1e-12"/></body><site name="imu"'
    )
    welded = mujoco.MjModel.from_xml_string(rig.xml.replace('<site name="imu"', extra))
    states = play(rig, welded, rig.commands(welded))[0]
    law = simulate(rig, EFFECTS["payload"], "lower", {"mass": 0.2, "place": 0.25})[0]
    np.testing.assert_allclose(law[:FREE], states[:FREE], atol=1e-8)


RIGID = {"mass": 0.1, "x": 0.02, "y": -0.01, "z": 0.005}
RIGID |= {"sxx": 2e-4, "syy": 1e-3, "szz": 1e-3, "sxy": 1e-4, "sxz": -1e-4, "syz": 5e-5}


def needed(model, rng):
    """Forces, (nv,), that a fixed motion of `model` needs."""
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    data.qpos[:], data.qvel[:], data.qacc[:] = (rng.normal(size=size) for size in (model.nq, model.nv, model.nv))
    mujoco.mj_inverse(model, data)
    return data.qfrc_inverse.copy()


def test_a_rigid_body_is_linear_in_mass_and_inertia():
    """Twice the change, twice the force."""
    forces = []
    for size in (0.0, 1.0, 2.0):
        model = editable(mujoco.MjSpec.from_string(chain(3)))
        values = {name: size * value for name, value in RIGID.items()} | dict.fromkeys("xyz", 0.0)
        EFFECTS["rigid_body"].law(model, "body_2", **values)
        forces.append(needed(model, np.random.default_rng(0)))
    np.testing.assert_allclose(forces[2] - forces[0], 2 * (forces[1] - forces[0]), atol=1e-12)
    assert np.abs(forces[1] - forces[0]).max() > 0.01


def full(model, body):
    """Inertia, (3, 3), about the centre of mass in the body's axes."""
    axes = turned_by(model.body(body).iquat)
    return axes * model.body(body).inertia @ axes.T


def turned_by(quaternion):
    """Rotation matrix, (3, 3)."""
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, quaternion)
    return axes.reshape(3, 3)


def test_payload_shift_and_inertia_are_rigid_bodies():
    """Each is the rigid body with its mass, its centre of mass and what its inertia is more than the mass makes it."""
    for name, values in (
        ("payload", {"mass": 0.2, "place": 0.28}),
        ("com_shift", {"x": 0.02, "y": 0.01, "z": -0.03}),
        ("inertia", {"change": 0.4}),
    ):
        before, special, general = (editable(mujoco.MjSpec.from_string(ARM)) for _ in range(3))
        EFFECTS[name].law(special, "lower", **values)
        old, new = before.body("lower"), special.body("lower")
        axes = turned_by(old.iquat)
        change = axes.T @ (full(special, "lower") - full(before, "lower") * new.mass[0] / old.mass[0]) @ axes
        change = np.trace(change) / 2 * np.eye(3) - change
        tensor = {f"s{'xyz'[i]}{'xyz'[j]}": change[i, j] for i in range(3) for j in range(i, 3)}
        shift = dict(zip("xyz", new.ipos - old.ipos, strict=True))
        EFFECTS["rigid_body"].law(general, "lower", mass=new.mass[0] - old.mass[0], **shift, **tensor)
        one, other = (needed(model, np.random.default_rng(0)) for model in (special, general))
        np.testing.assert_allclose(one, other, atol=1e-12)
        assert np.abs(one - needed(before, np.random.default_rng(0))).max() > 1e-4


@pytest.mark.parametrize("change", [{"mass": -9.0}, {"syy": -1.0}, {"szz": -1.0}, {"sxy": -1.0}, {"sxx": -1.0}])
def test_what_no_rigid_body_can_be_is_projected(change):
    """Any values give a mass and moments that a density can have, and an XML that MuJoCo compiles."""
    spec = mujoco.MjSpec.from_string(ARM)
    EFFECTS["rigid_body"].export(spec, "lower", **dict.fromkeys(RIGID, 0.0) | change)
    row = spec.compile().body("lower")
    assert row.mass[0] > 0
    assert second_moments(row.inertia).min() > 0


def test_a_neighbour_drags_with_its_acceleration_speed_and_direction():
    """The acceleration is the one that is known, or that since the step before."""
    model, law = RIGS["arm"].model(), EFFECTS["transmission_coupling"].law
    values = {"inertia": 0.1, "damping": 0.02, "friction": 0.3}
    assert sites.neighbours(model) == ["elbow<-shoulder", "shoulder<-elbow"]

    def state(speed, memory=None, **more):
        parts = np.zeros((1, 2)), np.array([[speed, 5.0]]), np.zeros((1, 2)), np.zeros(1), 0.01
        return State(model, *parts, {} if memory is None else memory, **more)

    known = state(-2.0, qacc=np.array([[7.0, 0.0]]))
    np.testing.assert_allclose(law(known, "elbow<-shoulder", **values), [[0, -0.7 + 0.04 + 0.3]])
    assert not known.remembers
    memory = {}
    np.testing.assert_allclose(law(state(-2.0, memory), "elbow<-shoulder", **values), [[0, 0.34]])
    np.testing.assert_allclose(law(state(-1.9, memory), "elbow<-shoulder", **values), [[0, -1 + 0.038 + 0.3]])


def test_a_base_that_gives_way_tilts_gravity():
    """Its force is what the weight of the same mechanism is less on a base that stands askew by the angle."""
    compliance, models = 0.003, [mujoco.MjModel.from_xml_string(chain(3)) for _ in range(2)]
    data = [mujoco.MjData(model) for model in models]
    data[0].qpos[:] = data[1].qpos[:] = [0.3, -0.7, 0.4]
    mujoco.mj_forward(models[0], data[0])
    root = models[0].body("body_1").id
    weight = models[0].body_subtreemass[root] * models[0].opt.gravity
    turn = compliance * np.cross(data[0].subtree_com[root] - data[0].xpos[root], weight)
    assert 0.005 < np.linalg.norm(turn) < 0.2 and turn[2] == 0
    models[1].opt.gravity += np.cross(-turn, models[1].opt.gravity)
    mujoco.mj_forward(models[1], data[1])
    state = State(models[0], data[0].qpos[None], np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1), PERIOD)
    force = EFFECTS["base_gives_way"].law(state, "body_1", compliance=compliance, settling=0.01)[0]
    np.testing.assert_allclose(force, data[0].qfrc_bias - data[1].qfrc_bias, atol=1e-12)
    assert sites.standing(RIGS["ball"].model()) == []


def test_dry_friction_turns_over_with_the_speed():
    """At every step that does not reverse the speed it is all there, against the speed; the export keeps that."""
    spec = mujoco.MjSpec.from_string(ARM)
    EFFECTS["coulomb"].export(spec, "elbow", friction=0.05)
    spec.compile()
    model = mujoco.MjModel.from_xml_string(spec.to_xml())
    ctrl = RIGS["arm"].commands(model)[0][:FREE]
    data = mujoco.MjData(model)
    data.qpos[:] = RIGS["arm"].qpos
    slid = 0
    for command in ctrl:
        data.ctrl[:], before = command, data.qvel[1]
        mujoco.mj_step(model, data)
        if before * data.qvel[1] > 0:
            slid += 1
            assert data.qfrc_constraint[1] == pytest.approx(-0.05 * np.sign(before), rel=1e-3)
    assert slid > FREE / 2


def chain(joints):
    """XML of an arm of so many driven hinges about alternating axes, with an encoder at each and a wrist sensor."""
    opening = "".join(
        f'<body name="body_{i}" pos="{0.2 * (i > 1)} 0 0"><joint name="j{i}" axis="0 {i % 2} {1 - i % 2}"/>'
        '<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.4" contype="0" conaffinity="0"/>'
        for i in range(1, joints + 1)
    )
    motors = "".join(f'<motor name="m{i}" joint="j{i}"/>' for i in range(1, joints + 1))
    encoders = "".join(f'<jointpos name="e{i}" joint="j{i}"/>' for i in range(1, joints + 1))
    return f"""<mujoco><worldbody>{opening}<site name="hand"/>{"</body>" * joints}</worldbody>
    <actuator>{motors}</actuator><sensor>{encoders}<force name="wrist" site="hand"/></sensor></mujoco>"""


def test_classes_of_a_six_joint_arm():
    """Every effect at every place, each kind at all places of a kind, the geared drive first, then bodies."""
    model = mujoco.MjModel.from_xml_string(chain(6))
    channels = (*(f"e{i}" for i in range(1, 7)), "wrist[0]", "wrist[2]")
    found = classes(model, channels)
    named = {own.name: own for own in found}
    assert len(named) == len(found)
    drive = found[0]
    assert drive.compound and drive.name == "geared drive" and len(drive.effects) == 18
    assert not any(own.compound for own in found[1:])
    assert found[1].name == "rigid bodies" and len(found[1].effects) == 6
    assert [own.order for own in found[1:]] == sorted(own.order for own in found[1:])
    joints = [f"j{i}" for i in range(1, 7)]
    assert named["Coulomb friction at every driven joint"].effects == tuple(("coulomb", joint) for joint in joints)
    assert named["rotor inertia at every driven joint"].order == 2
    assert sum(name.startswith("coupling of") for name in named) == 5
    pair = (("transmission_coupling", "j2<-j1"), ("transmission_coupling", "j1<-j2"))
    assert named["coupling of j1 and j2"].effects == pair
    assert len(named["sensor bias at every encoder"].effects) == 6
    assert len(named["sensor bias at every axis of every force sensor"].effects) == 2
    assert named["sensor delay of everything together"].effects == (("sensor_delay", "all"),)
    assert len(named["torque gain at every motor"].effects) == 6
    parts = {part for own in found[1:] for part in own.effects}
    assert parts == {(e.name, site) for e in EFFECTS.values() for site in e.sites(model, channels)}
    assert sum(len(own.effects) for own in found[1:]) == len(parts)


def test_classes_where_nothing_is_driven_or_things_touch():
    """Joints stand for driven joints, and what no motor drives has no rotor beside what one does."""
    xml = chain(2)
    still = mujoco.MjModel.from_xml_string(xml[: xml.index("<actuator>")] + xml[xml.index("<sensor>") :])
    named = {own.name for own in classes(still, ("e1",))}
    assert {"Coulomb friction at every joint", "sensor bias at e1"} <= named and "geared drive" not in named
    half = mujoco.MjModel.from_xml_string(xml.replace('<motor name="m2" joint="j2"/>', ""))
    named = {own.name: own for own in classes(half, ("e1",))}
    assert named["viscous friction at j2"].effects == (("viscous", "j2"),)
    assert named["geared drive"].effects == (("coulomb", "j1"), ("viscous", "j1"), ("rotor_inertia", "j1"))
    assert not any(part == ("rotor_inertia", "j2") for own in named.values() for part in own.effects)
    named = {own.name for own in classes(RIGS["ball"].model(), BALL_CHANNELS)}
    assert {"sliding friction at table", "height at table", "size of gravity"} <= named


def test_a_rigid_body_is_exported_whole():
    """All ten values at once move in plain MuJoCo as by the law."""
    rig, spec = RIGS["arm"], mujoco.MjSpec.from_string(ARM)
    EFFECTS["rigid_body"].export(spec, "lower", **RIGID)
    model = mujoco.MjModel.from_xml_string(spec.to_xml())
    by_law = simulate(rig, EFFECTS["rigid_body"], "lower", RIGID)[0]
    np.testing.assert_allclose(play(rig, model, rig.commands(model))[0][:FREE], by_law[:FREE], atol=1e-4)
    assert np.abs(by_law - simulate(rig)[0]).max() > 0.01


def stuck(law, values, step):
    """Positions, (T,), of an elbow that is pushed with a sixth of its friction for a second, from rest."""
    model = editable(mujoco.MjSpec.from_string(ARM.replace("<option", '<option gravity="0 0 0"', 1)))
    model.qpos_spring[1], model.opt.timestep = RIGS["arm"].qpos[1], step
    ctrl, effect = np.tile([0.0, 0.05], (1, int(1 / step), 1)), EFFECTS[law]
    return play(RIGS["arm"], model, ctrl, lambda state: effect.law(state, "elbow", **values))[0][:, 1]


def test_pre_sliding_springs():
    """Below its friction a Dahl joint gives like a spring and stays within the pre-sliding distance."""
    given = stuck("dahl", {"friction": 0.3, "displacement": 0.01}, 0.002) - RIGS["arm"].qpos[1]
    assert 0.001 < given[-1] < 0.01 and np.abs(given).max() < 0.01


def test_load_dependent_and_directional_losses():
    """They take their share of the motor's torque; driven backwards, gears cost more than they save."""
    model = RIGS["arm"].model()

    def limits(name, speed, **values):
        state = State(
            model, np.zeros((2, 2)), np.tile([0.0, speed], (2, 1)), np.array([[0, 0.5], [0, -0.5]]), np.zeros(2), PERIOD
        )
        return np.array(EFFECTS[name].law(state, "elbow", **values))

    np.testing.assert_allclose(limits("load_dependent_friction", 5.0, coefficient=0.1), [[0.05, 0.05], [0.05, 0.05]])
    np.testing.assert_allclose(limits("efficiency", 5.0, driving=0.2, driven=0.25), [[0.1, 0.125], [0.125, 0.1]])


PENDULUM = """<mujoco>{option}<worldbody><body name="rod" gravcomp="1"><joint name="pivot" axis="0 1 0" {joint}/>
<geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.015" mass="0.3"/></body></worldbody>
<actuator><{motor} name="motor" joint="pivot"/></actuator></mujoco>"""
DRIVEN = {
    "motor": {"motor": 'motor gear="2" forcerange="-3 3"'},
    "servo": {"motor": 'position kp="5" kv="0.2"'},
    "limited joint": {"joint": 'actuatorfrcrange="-0.5 1"'},
    "held against gravity": {"joint": 'actuatorgravcomp="true"'},
    "held within a limit": {"joint": 'actuatorgravcomp="true" actuatorfrcrange="-0.5 2.1"'},
    "commands are not clamped": {
        "motor": 'motor ctrlrange="-1 1"',
        "option": '<option><flag clampctrl="disable"/></option>',
    },
    "switched off": {"joint": 'actuatorgravcomp="true"', "option": '<option><flag actuation="disable"/></option>'},
    "group switched off": {"motor": 'motor group="2"', "option": '<option actuatorgroupdisable="2"/>'},
}


@pytest.mark.parametrize("parts", DRIVEN.values(), ids=DRIVEN)
def test_what_a_motor_delivers_is_what_mujoco_lets_it(parts):
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(**{"motor": "motor", "joint": "", "option": "", **parts}))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = 0.3, 2.0, 2.0
    mujoco.mj_forward(model, data)
    state = State(model, *(np.tile(part, (3, 1)) for part in (data.qpos, data.qvel, data.ctrl)), np.zeros(3), PERIOD)
    np.testing.assert_allclose(motor_force(state, "pivot"), data.qfrc_actuator[0], atol=1e-12)


def test_delay_and_lag_hold_back_what_they_say():
    """A step of the command loses its height times the delay, whatever the time step."""
    rig, ctrl = RIGS["arm"], np.ones((1, 400, 2))
    for name, values in (("command_delay", {"delay": 0.0113}), ("actuator_lag", {"time": 0.0113})):
        out = EFFECTS[name].law(ctrl, rig.signal(ctrl), "motor_2", **values)
        assert (ctrl - out)[0, :, 1].sum() * PERIOD == pytest.approx(0.0113)
        np.testing.assert_array_equal(out[:, :, 0], ctrl[:, :, 0])
    assert not EFFECTS["command_delay"].law(ctrl, rig.signal(ctrl), "all", delay=10.0).any()


def test_readings_between_samples():
    """Cubics are exact for cubics, straight lines carry on at the ends, and one sample is left alone."""
    time = np.arange(20.0)[None]
    cubic = (0.1 * time**3 - time**2)[..., None]
    inside = time[:, 2:-2] - 0.37
    np.testing.assert_allclose(interpolate(cubic, inside)[..., 0], 0.1 * inside**3 - inside**2, atol=1e-9)
    line = 2 * time[..., None]
    np.testing.assert_allclose(interpolate(line, time - 3.5)[..., 0], 2 * (time - 3.5))
    rig = RIGS["ball"]
    alone = EFFECTS["sensor_delay"].law(np.ones((1, 1, 3)), rig.signal(np.zeros((1, 1, 0))), "place", delay=0.1)
    np.testing.assert_array_equal(alone, np.ones((1, 1, 3)))


def test_sensors_that_are_late_together_are_late_against_a_known_start_or_command():
    """A throw that nobody times may begin at any time; a single sensor is late beside the others anyway."""
    time, line = np.array([[0.0], [6.0]]) + np.arange(6.0), np.repeat(np.arange(6.0)[None, :, None], 3, axis=2)
    thrown = replace(RIGS["ball"].signal(np.zeros((2, 6, 0))), time=time)
    driven = replace(thrown, actuators=("motor",))
    read = EFFECTS["sensor_delay"].law
    line = np.repeat(line, 2, axis=0)
    together = read(line, thrown, "all", delay=0.5) - line
    np.testing.assert_allclose(together[0], -0.5)
    np.testing.assert_array_equal(together[1], 0.0)
    np.testing.assert_allclose(read(line, driven, "all", delay=0.5) - line, -0.5)
    np.testing.assert_allclose(read(line, thrown, "place", delay=0.5) - line, -0.5)


def test_a_clock_that_drifts_counts_from_the_first_command_or_sample():
    """A window late in a run is read elsewhere where commands tell the time, and only stretched where nothing does."""
    time, line = 100.0 + np.arange(6.0)[None], np.repeat(np.arange(6.0)[None, :, None], 3, axis=2)
    thrown = replace(RIGS["ball"].signal(np.zeros((1, 6, 0))), time=time)
    read = EFFECTS["clock_drift"].law(line, thrown, "place", rate=0.01)
    np.testing.assert_allclose(read[0, :, 0], 0.99 * np.arange(6.0))
    driven = replace(thrown, actuators=("motor",))
    read = EFFECTS["clock_drift"].law(line, driven, "place", rate=0.01)
    np.testing.assert_allclose(read[0, :, 0], 0.99 * np.arange(6.0) - 1.0)


def test_measurement_sites_name_their_columns():
    """A channel, a sensor of several channels, or all of them."""
    rig = RIGS["arm"]
    signal = rig.signal(np.zeros((1, 5, 2)))
    flat = np.zeros((1, 5, 4))
    assert EFFECTS["sensor_bias"].law(flat, signal, "q2", offset=1.0)[0, 0].tolist() == [0, 1, 0, 0]
    assert EFFECTS["sensor_scale"].law(flat + 1, signal, "imu", change=1.0)[0, 0].tolist() == [1, 1, 2, 2]
    turned = EFFECTS["misalignment"].law(flat + np.eye(4)[2], signal, "imu", turn_x=0.5, turn_y=np.pi / 2, turn_z=0.0)
    np.testing.assert_allclose(np.abs(turned[0, 0]), [0, 0, 0, 1], atol=1e-12)


def test_sites_follow_the_model():
    """Nothing is proposed where it cannot act."""
    arm, ball = RIGS["arm"].model(), RIGS["ball"].model()
    assert sites.joints(ball) == [] and sites.joints(arm) == ["shoulder", "elbow"]
    assert sites.contacts(arm) == ["tip_ground"] and sites.contacts(ball) == ["table"]
    assert sites.grounds(arm) == ["ground"] and sites.grounds(ball) == ["table"]
    assert sites.commands(arm) == ["motor_1", "motor_2", "all"] and sites.commands(ball) == []
    assert sites.encoded(arm, ("q2", "imu[0]")) == ["elbow"]
    assert sites.turnable(arm, ARM_CHANNELS) == ["imu"] and sites.turnable(ball, BALL_CHANNELS) == []
    assert sites.sensors(arm, ARM_CHANNELS) == ["q1", "q2", "imu", "all"]
    rotates = [wiring.rotates_with_site(*at) for at in ((arm, "imu"), (arm, "q2"), (ball, "place"))]
    assert rotates == [True, False, False]
    free = '<mujoco><option gravity="0 0 0"/><worldbody><body><joint/><geom size=".1"/></body></worldbody></mujoco>'
    bare = mujoco.MjModel.from_xml_string(free)
    found = {name for name, effect in EFFECTS.items() if effect.sites(bare, ())}
    assert found == {"gravity_tilt"}


def test_planar_flight_has_no_joint_friction():
    """Two slides and a hinge on one body are coordinates, not guides; a driven pair of slides is a table."""
    joints = (
        '<joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide"/><joint name="turn" axis="0 1 0"/>'
    )
    xml = f'<mujoco><worldbody><body name="b">{joints}<geom size=".1"/></body></worldbody>%s</mujoco>'
    assert sites.joints(mujoco.MjModel.from_xml_string(xml % "")) == []
    driven = xml % '<actuator><motor joint="x"/></actuator>'
    assert sites.joints(mujoco.MjModel.from_xml_string(driven)) == ["x", "z", "turn"]


def test_a_contact_that_a_pair_lists_is_listed_once():
    """MuJoCo makes no further contact of the two geoms, though their types allow it."""
    xml = """<mujoco><worldbody><geom name="table" type="plane" size="1 1 1"/><body name="cube"><freejoint/>
    <geom name="cube" type="box" size=".1 .1 .1"/></body></worldbody>%s</mujoco>"""
    pair = '<contact><pair name="cube_table" geom1="cube" geom2="table"/></contact>'
    alone, listed = (mujoco.MjModel.from_xml_string(xml % more) for more in ("", pair))
    assert sites.contacts(alone) == ["table"] and sites.contacts(listed) == ["cube_table"]
    assert sites.grounds(listed) == ["table"]


def test_a_scale_of_what_is_read_is_suspected_before_gravity():
    order = list(EFFECTS)
    assert order.index("sensor_scale") < order.index("gravity_scale")


def test_one_pair_of_several_and_the_ground_of_all():
    """A pair is edited alone; its ground stands for all its pairs."""
    more = ARM.replace("</contact>", '<pair name="arm_ground" geom1="ground" geom2="bar"/></contact>')
    model = mujoco.MjModel.from_xml_string(more.replace('<geom type="capsule"', '<geom name="bar" type="capsule"', 1))
    assert sites.contacts(model) == ["arm_ground", "tip_ground", "ground"]
    before = model.pair_friction.copy()
    EFFECTS["sliding_friction"].law(model, "tip_ground", change=0.1)
    np.testing.assert_allclose((model.pair_friction - before)[:, :2], [[0, 0], [0.1, 0.1]])
    EFFECTS["sliding_friction"].law(model, "ground", change=-10.0)
    np.testing.assert_allclose(model.pair_friction[:, :2], 1e-5)


def slid(dimensions, coefficient):
    """Speed along x, turning about y and z, (3,), of a ball that has slid and spun on a table for 0.1 s."""
    model = RIGS["ball"].model()
    model.geom_condim[:], model.geom_friction[:] = dimensions, [0.6, 0.02, 1e-4]
    EFFECTS["rolling_friction"].law(model, "table", coefficient=coefficient)
    data = mujoco.MjData(model)
    data.qpos[2], data.qvel[:] = 0.1199, [0.5, 0, 0, 0, 0, 20.0]
    mujoco.mj_step(model, data, nstep=50)
    return data.qvel[[0, 4, 5]]


@pytest.mark.parametrize("dimensions", [(1, 1), (3, 1), (3, 3), (4, 4), (4, 1), (6, 3)])
def test_rolling_friction_brings_no_other_and_takes_none_away(dimensions):
    """What is barely there barely changes a motion, however many dimensions the contacts of table and ball had."""
    np.testing.assert_allclose(slid(dimensions, 1e-9), slid(dimensions, 0.0), atol=0.1)


@pytest.mark.parametrize("direct", [False, True])
def test_contact_stiffness_and_damping_are_apart(direct):
    """In both forms of solref one changes stiffness only, the other damping only."""
    model = mujoco.MjModel.from_xml_string(ARM)
    model.pair_solref[:] = [-4000, -40] if direct else [0.02, 0.5]

    def direct_form():
        time, ratio = model.pair_solref[0]
        return np.array([-time, -ratio]) if direct else np.array([1 / (time * ratio) ** 2, 2 / time])

    start = direct_form()
    EFFECTS["contact_stiffness"].law(model, "tip_ground", change=0.5)
    np.testing.assert_allclose(direct_form() / start, [1.5, 1])
    EFFECTS["contact_damping"].law(model, "tip_ground", change=1.0)
    np.testing.assert_allclose(direct_form() / start, [1.5, 2])


def test_own_effect_is_one_function_and_one_line(monkeypatch):
    """A user's law joins the catalogue and is found by name."""

    def wind(state, site, force):
        """A constant push along x."""
        return force * state.body(site)[2][:, 0]

    own = Effect(
        name="wind",
        family="environment",
        equation="F = f x̂",
        sentence="Wind.",
        reference="mine",
        enters="force",
        coefficients=(Coefficient("force", "N"),),
        sites=sites.bodies,
        probes=lambda scales, model, site: [{"force": 0.1}],
        law=wind,
        neutral={"force": 0.0},
    )
    monkeypatch.setitem(EFFECTS, own.name, own)
    assert own.prior(scales("ball"), RIGS["ball"].model(), "ball") == {"force": pytest.approx(5.0)}
    shift = simulate(RIGS["ball"], get_effect("wind"), "ball", {"force": 0.3})[0] - simulate(RIGS["ball"])[0]
    assert shift[50, 0] == pytest.approx(0.5 * (51 * PERIOD) ** 2, rel=0.05)


def test_laws_without_native_fields_stand_alone():
    """Their source and all that it names makes a file that needs numpy and mujoco only, and computes the same."""
    model = RIGS["servo"].model()
    for effect in (e for e in EFFECTS.values() if e.export is None):
        site = effect.sites(model, ARM_CHANNELS)[-1]
        values, bundle, scope = effect.probes(scales("servo"), model, site)[0], SourceBundle({}), {}
        name = bundle.add(effect.law)
        assert not any("fimpact" in line or "scipy" in line for line in bundle.imports)
        exec(bundle.text(), scope)
        if effect.enters == "gear":
            given = [Shaft(np.ones(2), np.zeros(2), 0.01, PERIOD, {}) for _ in "ab"]
        elif effect.enters in ("force", "friction"):
            given = [
                State(model, np.full((1, 2), 0.3), np.ones((1, 2)), np.ones((1, 2)), np.zeros(1), PERIOD) for _ in "ab"
            ]
        else:
            signal = RIGS["arm"].signal(np.ones((1, 9, 2)))
            array = np.arange(36.0).reshape(1, 9, 4) if effect.enters == "measurement" else np.ones((1, 9, 2))
            given = [(array, signal)] * 2
        by_file, by_law = (
            law(*(g if isinstance(g, tuple) else (g,)), site, **values)
            for law, g in zip((scope[name], effect.law), given, strict=True)
        )
        if effect.enters == "gear":
            by_file, by_law = (np.array([f.pull, f.inertia, f.lead, f.rate]) for f in (by_file, by_law))
        np.testing.assert_array_equal(by_file, by_law)


def test_laws_leave_their_input_alone():
    """Measurement and command laws return copies; models are edited only where they are given."""
    rig = RIGS["servo"]
    ctrl, measured = np.ones((1, 9, 2)), np.ones((1, 9, 4))
    signal = rig.signal(ctrl)
    for effect in EFFECTS.values():
        if effect.enters in ("command", "measurement"):
            site = effect.sites(rig.model(), rig.channels)[0]
            given = ctrl if effect.enters == "command" else measured
            effect.law(given, signal, site, **effect.probes(scales("servo"), rig.model(), site)[0])
            assert (given == 1).all()
    model = rig.model()
    EFFECTS["coulomb"].law(copy.copy(model), "elbow", friction=1.0)
    assert not model.dof_frictionloss.any()


BOX = """
<mujoco>
  <worldbody>
    <geom name="table" type="plane" size="1 1 0.1"/>
    <body name="cube" pos="0 0 0.1">
      <freejoint/><geom name="cube" type="box" size="0.05 0.05 0.05"/>
    </body>
  </worldbody>
  <contact><pair name="cube_table" geom1="cube" geom2="table" margin="0.05"/></contact>
</mujoco>
"""


@pytest.mark.parametrize(("turn", "less"), [(0.0, 0.0), (np.pi / 4, np.sqrt(2) - 1)])
def test_a_box_with_rounded_edges_reaches_as_far_with_its_faces_and_less_with_its_edges(turn, less):
    radius, spec = 0.004, mujoco.MjSpec.from_string(BOX)
    EFFECTS["rounded_edge"].export(spec, "cube_table", radius=radius)
    found = []
    for model in (mujoco.MjModel.from_xml_string(BOX), mujoco.MjModel.from_xml_string(spec.to_xml())):
        data = mujoco.MjData(model)
        data.qpos[:] = [0, 0, 0.075, np.cos(turn / 2), 0, np.sin(turn / 2), 0]
        mujoco.mj_forward(model, data)
        found.append(min(c.dist - c.includemargin for c in data.contact) + model.pair_margin[0] * (not found))
    assert found[1] + 0.05 - found[0] == pytest.approx(less * radius, abs=1e-9)
    assert EFFECTS["rounded_edge"].sites(mujoco.MjModel.from_xml_string(BOX), ()) == ["cube_table"]
