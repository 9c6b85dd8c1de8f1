"""Servos: every effect against plants made otherwise, and by the files that are exported."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from replayed import replayed

from fimpact.effects import EFFECTS, sites
from fimpact.effects.base import Placed
from fimpact.effects.classes import classes
from fimpact.export.improved_model import Predicted
from fimpact.recordings import Recording, Run
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import Simulator
from fimpact.simulation.windows import cut

KP, KV, LIMIT, PERIOD = 20.0, 0.4, 3.0, 0.01
RUBBING = 'damping="0.05" frictionloss="0.02"'
XML = f"""<mujoco><option timestep="0.0005"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
<body name="upper"><joint name="shoulder" axis="0 1 0" {RUBBING} armature="0.01"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.3"/>
<body name="lower" pos="0.2 0 0"><joint name="elbow" axis="0 1 0" damping="0.05" armature="0.01"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2"/></body></body></worldbody>
<actuator><position name="s1" joint="shoulder" kp="{KP}" kv="{KV}" forcerange="-{LIMIT} {LIMIT}"/>
<position name="s2" joint="elbow" kp="{KP}" kv="{KV}" forcerange="-{LIMIT} {LIMIT}"/></actuator>
<sensor><jointpos name="q1" joint="shoulder"/><jointpos name="q2" joint="elbow"/></sensor></mujoco>"""
SERVOS = XML[XML.index("<actuator>") : XML.index("</actuator>")]
MOTORS = '<actuator><motor name="s1" joint="shoulder"/><motor name="s2" joint="elbow"/>'
SAMPLES = 80


def recording(xml: str = XML) -> Recording:
    """One run of targets; nothing measured yet."""
    time = PERIOD * np.arange(SAMPLES)
    ctrl = np.stack([0.3 * np.sin(9 * time), -0.4 * np.sin(6 * time + 0.5)], 1)
    run = Run("run", ctrl, np.zeros((SAMPLES, 2)), False)
    return Recording(xml, ".", PERIOD, ("q1", "q2"), (run,), (), np.full(2, 1e-3), np.full(4, np.inf), 0.0)


def simulated(*placed: Placed, xml: str = XML) -> np.ndarray:
    """Angles, (T, 2), from rest, as the package predicts them."""
    given, start = recording(xml), np.zeros((1, 2))
    return Simulator(given).predict(Hypothesis(np.zeros(0), placed), cut(given.runs, 0), start, start)[0]


def planted(xml: str = XML, targets=lambda ctrl: ctrl, torque=None) -> np.ndarray:
    """Angles, (T, 2), by plain MuJoCo; torque: of (targets, angles, speeds), where no servo of MuJoCo acts."""
    model = mujoco.MjModel.from_xml_string(xml if torque is None else xml.replace(SERVOS, MOTORS))
    model.opt.tolerance, model.opt.iterations = 1e-13, 50  # as the package's own
    data, rows = mujoco.MjData(model), []
    for u in targets(recording().runs[0].ctrl):
        rows.append(data.qpos.copy())
        for _ in range(round(PERIOD / model.opt.timestep)):
            data.ctrl[:] = u if torque is None else torque(u, data.qpos, data.qvel)
            mujoco.mj_step(model, data)
    return np.array(rows)


def servo(error, speed):
    """Torque of both servos, (2,), N m."""
    return np.clip(KP * error - KV * speed, -LIMIT, LIMIT)


def with_deadband(u, q, v):
    """Of the first servo, 0.04 rad wide."""
    error = u - q
    error[0] = 0.0 if abs(error[0]) < 0.02 else error[0] - np.copysign(0.02, error[0])
    return servo(error, v)


def with_weak_supply(u, q, v):
    """Each loses 10 % for each N m of both together."""
    given = servo(u - q, v)
    return given * (1 - 0.1 * (abs(given[0]) + abs(given[1])))


def later(ctrl, samples):
    """Targets that come late, (T, 2); the first is held before."""
    return np.concatenate([np.tile(ctrl[:1], (samples, 1)), ctrl[:-samples]])


def first(old: str, new: str) -> str:
    """The MJCF with something else about the first servo or joint."""
    return XML.replace(old, new, 1)


def in_steps(ctrl):
    """Targets of the second servo in twentieths of a radian."""
    return ctrl * [1, 0] + np.rint(ctrl * 20) / 20 * [0, 1]


LAG, LIGHT = f'kv="{KV}" timeconst="0.06"', 'damping="0.0125" frictionloss="0.005"'
PLANTS = {
    "servo_kp": ("s1", {"change": -0.4}, {"xml": first(f'kp="{KP}"', f'kp="{0.6 * KP}"')}, 1e-9),
    "servo_kv": ("s1", {"change": 0.5}, {"xml": first(f'kv="{KV}"', f'kv="{1.5 * KV}"')}, 1e-9),
    "saturation": ("s1", {"limit": 0.9}, {"xml": first(f"-{LIMIT} {LIMIT}", "-0.9 0.9")}, 1e-9),
    "command_delay": ("all", {"delay": 0.03}, {"targets": lambda ctrl: later(ctrl, 3)}, 1e-9),
    "actuator_lag": ("s1", {"time": 0.06}, {"xml": first(f'kv="{KV}"', LAG)}, 3e-2),
    "target_resolution": ("s2", {"step": 0.05}, {"targets": in_steps}, 1e-9),
    "deadband": ("s1", {"width": 0.04}, {"torque": with_deadband}, 2e-2),
    "supply_sag": ("all", {"droop": 0.1}, {"torque": with_weak_supply}, 2e-2),
    "gravity_compensation": ("all", {"share": 0.7}, {"xml": XML.replace("<body ", '<body gravcomp="0.7" ')}, 2e-2),
    "friction_compensation": ("shoulder", {"share": 0.75}, {"xml": first(RUBBING, LIGHT)}, 1e-9),
}


@pytest.mark.parametrize("name", PLANTS)
def test_an_effect_of_a_servo_is_what_was_planted_otherwise(name):
    site, values, plant, left = PLANTS[name]
    nature, plain = planted(**plant), simulated()
    found = simulated(Placed(EFFECTS[name], site, values))
    shown = np.sqrt(((nature - plain) ** 2).mean())
    assert shown > 1e-3 and np.sqrt(((nature - found) ** 2).mean()) < left * shown


@pytest.mark.parametrize("name", PLANTS)
def test_its_export_does_the_same_in_plain_mujoco(name, tmp_path):
    site, values, *_ = PLANTS[name]
    given, start = recording(), np.zeros((1, 2))
    hypothesis, windows = Hypothesis(np.zeros(0), (Placed(EFFECTS[name], site, values),)), cut(recording().runs, 0)
    ours = Simulator(given).predict(hypothesis, windows, start, start)
    predicted = Predicted(replace(windows, measured=ours), start, start, np.zeros((1, 0)), ours)
    theirs = replayed(given, hypothesis, predicted, tmp_path)
    shown = np.sqrt(((ours[0] - simulated()) ** 2).mean())
    assert np.sqrt(((ours - theirs) ** 2).mean()) < (3e-2 if EFFECTS[name].export else 1e-9) * shown
    assert (tmp_path / "improved.py").exists() == (EFFECTS[name].export is None)


def test_without_them_a_servo_is_untouched():
    np.testing.assert_allclose(simulated(), planted(), atol=1e-12)


def sited(actuators: str, joint: str = "") -> set[str]:
    """Effects of this file that a robot with these actuators may be found to lack."""
    xml = XML.replace(SERVOS, f"<actuator>{actuators}").replace('name="shoulder"', f'name="shoulder" {joint}')
    model = mujoco.MjModel.from_xml_string(xml)
    names = {*PLANTS, "gain"} - {"command_delay"}
    return {name for name in names if EFFECTS[name].sites(model, ("q1", "q2"))}


ALWAYS = {"saturation", "supply_sag", "friction_compensation"}
POSITION = '<position name="s1" joint="shoulder" kp="9" {}/>'


@pytest.mark.parametrize(
    ("actuators", "named"),
    [
        ('<motor name="s1" joint="shoulder"/>', {"gain", "actuator_lag"}),
        ('<velocity name="s1" joint="shoulder" kv="1"/>', {"servo_kv", "actuator_lag"}),
        (POSITION.format(""), {"servo_kp", "actuator_lag", "deadband", "target_resolution"}),
        (POSITION.format('kv="1"'), {"gain", "servo_kp", "servo_kv", "actuator_lag", "deadband", "target_resolution"}),
        (POSITION.format('kv="1" timeconst="0.05"'), {"gain", "servo_kp", "servo_kv"}),
    ],
)
def test_each_gain_has_one_name(actuators, named):
    """What a loop's only gain scales is that gain, not "gain"; a servo with a state of its own has no second lag."""
    assert sited(actuators) == named | ALWAYS
    assert "gravity_compensation" in sited(actuators + '<motor name="s2" joint="elbow"/>')


def test_the_gain_of_a_velocity_servo_scales_all_of_it():
    model = mujoco.MjModel.from_xml_string(XML.replace(SERVOS, '<actuator><velocity name="s1" joint="elbow" kv="2"/>'))
    EFFECTS["servo_kv"].law(model, "s1", change=0.5)
    np.testing.assert_allclose([model.actuator_gainprm[0, 0], *model.actuator_biasprm[0, :3]], [3, 0, 0, -3])


def test_servos_are_suspected_together():
    model = mujoco.MjModel.from_xml_string(XML)
    names = {kind.name: len(kind.effects) for kind in classes(model, ("q1", "q2"))}
    assert names["position gain at every servo"] == names["deadband at every servo"] == 2
    assert names["sagging supply"] == names["gravity that firmware compensates"] == 1
    assert names["friction that firmware compensates at every driven joint"] == 2


def test_firmware_holds_no_arm_on_a_free_base():
    """But a cube that is free beside the arm is no part of it."""
    cart = '<worldbody><body name="cart"><freejoint/><geom size="0.1"/>'
    on_cart = XML.replace("<worldbody>", cart).replace("</worldbody>", "</body></worldbody>")
    beside = XML.replace("<worldbody>", f"{cart}</body>")
    assert sites.weighed(mujoco.MjModel.from_xml_string(on_cart)) == []
    assert sites.weighed(mujoco.MjModel.from_xml_string(beside)) == ["all"]
    spec = mujoco.MjSpec.from_string(beside)
    EFFECTS["gravity_compensation"].export(spec, "all", share=0.5)
    np.testing.assert_allclose(spec.compile().body_gravcomp, [0, 0, 0.5, 0.5])
