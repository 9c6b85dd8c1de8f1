"""The force that an edit of the model stands for is the difference that MuJoCo's own inverse dynamics makes."""

import copy

import mujoco
import numpy as np
import pytest

from fimpact.recordings import Recording, Run
from fimpact.simulation.servo_steps import is_long
from fimpact.simulation.simulator import Simulator
from fimpact.smoothing.dynamics.inverse import Inverse
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.states import States

PERIOD, COUNT = 0.01, 8
# Free, hinge, ball and slide; `weld` has its mass in its origin, and `other` is a tree of its own.
TREE = """<mujoco><option timestep="0.005" gravity="0.3 -1 -9.8"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody>
<body name="base" pos="0 0 1"><freejoint name="free"/><geom type="box" size=".1 .2 .3" pos=".05 .02 .01"/>
<body name="arm" pos=".1 .2 .1" euler="20 30 40"><joint name="hinge" axis="0 1 .3" stiffness="2" springref="10"/>
<geom type="capsule" fromto="0 0 0 .1 .2 .3" size=".03"/><site name="wrist" pos=".1 .2 .3"/>
<body name="hand" pos=".1 .2 .3" euler="10 0 5"><joint name="ball" type="ball"/>
<geom type="ellipsoid" size=".1 .05 .07" pos=".1 0 0"/><site name="palm"/>
<body name="weld" pos=".1 0 0"><geom type="sphere" size=".05"/>
<body name="finger" pos="0 .1 .2"><joint name="slide" type="slide" axis="1 0 0"/>
<geom type="box" size=".1 .2 .03" pos=".05 .02 .01"/></body></body></body></body></body>
<body name="other" pos="2 0 0"><joint name="lone" axis="1 0 0"/><geom name="pad" type="sphere" size=".1" pos="0 0 .2"/>
</body></worldbody>
<actuator><motor name="m1" joint="hinge" gear="3" ctrllimited="true" ctrlrange="-.5 .5"/><motor name="m2" joint="slide"
forcelimited="true" forcerange="-1 1"/><position name="servo" joint="lone" kp="3" kv=".2"/></actuator>
<sensor><jointpos name="q" joint="hinge"/><accelerometer name="imu" site="palm"/>
<framelinacc name="speeding" objtype="site" objname="palm"/><framepos name="centre" objtype="body" objname="hand"/>
<subtreecom name="all" body="hand"/><force name="weight" site="palm"/><torque name="twist" site="wrist"/>
<actuatorfrc name="given" actuator="m1"/></sensor></mujoco>"""
BODIES = ("base", "arm", "hand", "weld", "finger", "other")


def along(channels: tuple[str, ...] = ("q",), xml: str = TREE) -> Inverse:
    """Inverse dynamics along states that have nothing to do with one another."""
    rng, model = np.random.default_rng(0), mujoco.MjModel.from_xml_string(xml)
    run = Run("run", rng.standard_normal((COUNT, model.nu)), np.zeros((COUNT, len(channels))), False)
    free, noise = np.full(2 * model.nv, np.inf), np.ones(len(channels))
    recording = Recording(xml, ".", PERIOD, channels, (run,), (), noise, free, 0.0)
    track = Track(Simulator(recording), recording.runs)
    qpos = track.model.qpos0 + 0.3 * rng.standard_normal((COUNT, model.nq))
    for row in qpos:
        mujoco.mj_normalizeQuat(model, row)
    qvel = np.cumsum(0.1 * rng.standard_normal((COUNT, model.nv)), 0) + rng.standard_normal(model.nv)
    return Inverse(track, States(qpos, qvel, np.zeros((COUNT, model.na))))


def edited(model: mujoco.MjModel, edit) -> mujoco.MjModel:
    after = copy.copy(model)
    edit(after)
    mujoco.mj_setConst(after, mujoco.MjData(after))  # else a mass that lay in its origin stays there
    return after


def needed(inverse: Inverse, model: mujoco.MjModel) -> np.ndarray:
    """What MuJoCo says that the motion takes, (N, nv)."""
    data, out = mujoco.MjData(model), []
    for qpos, qvel, qacc in zip(inverse.qpos, inverse.qvel, inverse.qacc, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, qacc
        mujoco.mj_inverse(model, data)
        out.append(data.qfrc_inverse.copy())
    return np.array(out)


def test_the_motion_is_that_of_the_middle_of_each_sample():
    inverse = along()
    np.testing.assert_allclose(
        np.diff(inverse.qvel, axis=0)[:-1], PERIOD * (inverse.qacc[:-2] + inverse.qacc[1:-1]) / 2
    )
    np.testing.assert_array_equal(inverse.qacc[-1], inverse.qacc[-2])  # of the last sample nothing else is known


def heavier(body: int):
    def edit(model):
        model.body_mass[body] *= 1.3

    return edit


def off_centre(body: int):
    def edit(model):
        model.body_ipos[body] += 0.1, 0.02, -0.03

    return edit


def wider(body: int):
    def edit(model):
        model.body_inertia[body] *= 1.5, 1.2, 1.4

    return edit


def turned(body: int):
    def edit(model):
        model.body_iquat[body] += 0.1, 0.3, -0.2, 0.1
        mujoco.mju_normalize4(model.body_iquat[body])

    return edit


def gravity(model):
    model.opt.gravity[:] = 1, 2, -5


def gravity_and_mass(model):
    gravity(model)
    model.body_mass[2] *= 2


def damping(model):
    model.dof_damping[:] += np.linspace(0.5, 1.0, model.nv)


def damping_that_grows(model):
    model.dof_dampingpoly[:] = 0.3, 0.2
    model.dof_dampingpoly[-1] = 0.1, 0.0


def armature(model):
    model.dof_armature[:] += np.linspace(0.1, 0.4, model.nv)


def spring(model):
    model.jnt_stiffness[model.joint("hinge").id] = 1.0
    model.jnt_stiffness[model.joint("slide").id] = 3.0


def spring_that_stiffens(model):
    model.jnt_stiffnesspoly[model.joint("hinge").id] = 0.3, 0.5


def rest(model):
    model.qpos_spring[int(model.joint("hinge").qposadr[0])] = 0.3


OF_BODIES = [
    (f"{make.__name__} {name}", make(i))
    for make in (heavier, off_centre, wider, turned)
    for i, name in enumerate(BODIES, 1)
    if make is not turned or name in ("base", "arm", "hand", "finger")  # the others are round
]
OF_ALL = (gravity, gravity_and_mass, damping, damping_that_grows, armature, spring, spring_that_stiffens, rest)
EDITS = dict(OF_BODIES) | {edit.__name__: edit for edit in OF_ALL}


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_is_the_difference_of_inverse_dynamics(name):
    inverse = along()
    after = edited(inverse.model, EDITS[name])
    expected = needed(inverse, inverse.model) - needed(inverse, after)
    found = inverse.change(after, inverse.model, inverse.track.ctrl[:, 0])
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(found, expected, atol=1e-9 * max(1.0, np.abs(expected).max()))


def test_gravity_that_is_switched_off_weighs_nothing():
    weightless = TREE.replace('gravity="0.3 -1 -9.8"/>', '><flag gravity="disable"/></option>')
    inverse = along(xml=weightless)
    after = edited(inverse.model, heavier(2))
    expected = needed(inverse, inverse.model) - needed(inverse, after)
    np.testing.assert_allclose(inverse.change(after, inverse.model, inverse.track.ctrl[:, 0]), expected, atol=1e-9)
    flagged = edited(inverse.model, gravity)
    flagged.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_GRAVITY
    assert not inverse.change(flagged, inverse.model, inverse.track.ctrl[:, 0]).any()


def given(inverse: Inverse, model: mujoco.MjModel, told: np.ndarray) -> np.ndarray:
    """What MuJoCo's motors give, (N, nv)."""
    data, out = mujoco.MjData(model), []
    for qpos, qvel, ctrl in zip(inverse.qpos, inverse.qvel, told, strict=True):
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
        mujoco.mj_forward(model, data)
        out.append(data.qfrc_actuator.copy())
    return np.array(out)


def stronger(model):
    model.actuator_gainprm[:2, 0] *= 1.4


def tighter(model):
    model.actuator_forcerange[1] = -0.4, 0.3


def limited(model):
    model.actuator_forcelimited[0], model.actuator_forcerange[0] = True, (-0.2, 0.2)


def shifted(model):
    model.actuator_biastype[0], model.actuator_biasprm[0, 0] = mujoco.mjtBias.mjBIAS_AFFINE, 0.3


def shifted_within_limits(model):
    shifted(model)
    limited(model)


@pytest.mark.parametrize("edit", [stronger, tighter, limited, shifted, shifted_within_limits])
def test_gains_and_limits_of_motors_are_what_they_give_more(edit):
    inverse = along()
    after, told = edited(inverse.model, edit), 0.8 * inverse.track.ctrl[:, 0]
    expected = given(inverse, after, told) - given(inverse, inverse.model, told)
    assert np.abs(expected).max() > 0.05
    np.testing.assert_allclose(inverse.change(after, inverse.model, told), expected, atol=1e-12)


def test_a_motor_that_becomes_a_spring_is_simulated():
    def sprung(model):
        shifted(model)
        model.actuator_biasprm[0, 1] = -2.0

    inverse = along()
    assert inverse.change(edited(inverse.model, sprung), inverse.model, inverse.track.ctrl[:, 0]) is None


def rougher(model):
    model.geom_friction[model.geom("pad").id] *= 2


def stiffer_servo(model):
    model.actuator_gainprm[2, 0] *= 2
    model.actuator_biasprm[2, 1] *= 2


def servo_gain(model):
    model.actuator_gainprm[2, 0] *= 2


def carried_weight(model):
    model.body_gravcomp[2] = 0.5


def sprung_ball(model):
    model.jnt_stiffness[model.joint("ball").id] = 1.0


@pytest.mark.parametrize("edit", [rougher, stiffer_servo, servo_gain, carried_weight, sprung_ball])
def test_what_is_no_such_force_is_left_to_simulation(edit):
    inverse = along()
    assert inverse.change(edited(inverse.model, edit), inverse.model, inverse.track.ctrl[:, 0]) is None


@pytest.mark.parametrize("sensor", ["weight", "twist"])
@pytest.mark.parametrize("body", BODIES)
def test_a_sensor_that_weighs_a_body_wants_a_simulation_of_it_and_of_no_other(sensor, body):
    inverse = along(("q", f"{sensor}[0]"))
    carried = {"weight": ("hand", "weld", "finger"), "twist": ("arm", "hand", "weld", "finger")}[sensor]
    after = edited(inverse.model, heavier(inverse.model.body(body).id))
    found = inverse.change(after, inverse.model, inverse.track.ctrl[:, 0])
    assert (found is None) == (body in carried)
    if body not in carried:
        plain = along()
        np.testing.assert_allclose(found, plain.change(after, inverse.model, plain.track.ctrl[:, 0]), atol=1e-12)


def test_a_sensor_that_weighs_something_feels_gravity():
    inverse = along(("q", "weight[0]"))
    assert inverse.change(edited(inverse.model, gravity), inverse.model, inverse.track.ctrl[:, 0]) is None


@pytest.mark.parametrize("channel", ["given", "weight[2]"])
def test_what_motors_give_is_simulated_where_a_sensor_reads_it(channel):
    inverse = along(("q", channel))
    assert inverse.change(edited(inverse.model, stronger), inverse.model, inverse.track.ctrl[:, 0]) is None
    assert inverse.change(edited(inverse.model, damping), inverse.model, inverse.track.ctrl[:, 0]) is not None


@pytest.mark.parametrize(
    ("channel", "edit"),
    [
        ("imu[2]", gravity),
        ("speeding[2]", gravity),
        ("centre[0]", off_centre(BODIES.index("hand") + 1)),
        ("all[0]", off_centre(BODIES.index("hand") + 1)),
    ],
    ids=["accelerometer", "acceleration of a site", "place of a centre of mass", "centre of a tree"],
)
def test_what_a_sensor_reads_beside_the_motion_is_simulated(channel, edit):
    """An accelerometer reads gravity, and the place of a centre of mass is no place of the body."""
    inverse = along(("q", channel))
    assert inverse.change(edited(inverse.model, edit), inverse.model, inverse.track.ctrl[:, 0]) is None


def test_a_gain_is_not_more_than_the_joint_is_given():
    """MuJoCo's `actuatorfrcrange`: what all motors of a joint may give it together."""
    inverse = along(xml=TREE.replace('joint name="hinge"', 'joint name="hinge" actuatorfrcrange="-0.2 0.2"'))
    after, told = edited(inverse.model, stronger), inverse.track.ctrl[:, 0]
    expected = given(inverse, after, told) - given(inverse, inverse.model, told)
    found = inverse.change(after, inverse.model, told)
    assert found is None or np.abs(found - expected).max() < 1e-9


ONE = """<mujoco><worldbody><body><joint name="j" axis="0 1 0" damping="0.05" armature="0.01"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.5"/></body></worldbody>
<actuator>{}</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("motor", "period", "long"),
    [
        ('<position joint="j" kp="200" kv="5"/>', 0.02, True),
        ('<position joint="j" kp="200" kv="5"/>', 0.001, False),
        ('<position joint="j" kp="200"/>', 0.02, True),
        ('<position joint="j" kp="2" gear="10"/>', 0.02, True),
        ('<position joint="j" kp="2"/>', 0.02, False),
        ('<velocity joint="j" kv="5"/>', 0.02, True),
        ('<motor joint="j"/>', 0.004, False),
        ('<motor joint="j"/>', 0.02, False),
    ],
)
def test_a_sample_is_long_where_a_servo_comes_to_rest_within_it(motor, period, long):
    assert is_long(mujoco.MjModel.from_xml_string(ONE.format(motor)), period) == long


def test_a_sample_is_long_where_damping_stops_a_joint_within_it():
    model = mujoco.MjModel.from_xml_string(ONE.format('<motor joint="j"/>'))
    model.dof_damping[:] = 10.0
    assert is_long(model, 0.02)
