"""The catalogue as it is planted: where, with which values and how strongly at most."""

from collections.abc import Callable

import numpy as np

from fimpact.benchmark.planting import bodies, contacts, gears, joints, servos, signals
from fimpact.benchmark.planting.plant import Plant, Values

FREE, PRESS, BLOCK = "arm_free", "arm_contact", "block"
AXES, SERVO, LEG = "six_axis", "six_servo", "leg"
J = tuple(f"joint_{i}" for i in (1, 2, 3))
M = tuple(f"motor_{i}" for i in (1, 2, 3))
OUTER = ("link_2", "link_3")
ENCODERS = tuple(f"encoder_{i}" for i in (1, 2, 3))
HAND = ("wrist_force[0]", "wrist_force[1]")
IMU = ("imu[0]", "imu[2]")
CAMERA = ("camera_x", "camera_z", "camera_pitch")
ROBOTS_ENCODERS = dict.fromkeys(("six_axis", "six_servo"), tuple(f"encoder_{i}" for i in range(1, 7)))
ROBOTS_ENCODERS |= {"leg": ("rail_encoder", "hip_encoder", "knee_encoder", "imu[2]")}
GROUND = {PRESS: ("wall",), BLOCK: ("mat",), LEG: ("floor",)}
TOUCH = {PRESS: ("tip_wall",), BLOCK: ("mat",), LEG: ("foot_floor",)}
# m from a link's origin at which it carries what it should not
HELD = {(AXES, "link_3"): 0.39, (AXES, "link_6"): 0.12, (SERVO, "link_3"): 0.13, (SERVO, "link_5"): 0.08}
HELD |= {(LEG, "thigh"): 0.2}
EVERY: dict[str, tuple[str, ...]] = dict.fromkeys((FREE, PRESS, BLOCK, AXES, SERVO, LEG), ("world",))
SIX = range(1, 7)
ROBOTS_J = dict.fromkeys((AXES, SERVO), tuple(f"joint_{i}" for i in SIX)) | {LEG: ("hip", "knee")}
ROBOTS_M = dict.fromkeys((AXES, SERVO), tuple(f"motor_{i}" for i in SIX)) | {LEG: ("hip_motor", "knee_motor")}


def _arms(sites: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    return {FREE: sites, PRESS: sites}


JOINTS, MOTORS = _arms(J) | ROBOTS_J, _arms(M) | ROBOTS_M


def _one(name: str) -> Callable[..., Values]:
    return lambda size: {name: size}


def _joint(put, name: str, begin: float, most: float, **rest) -> Plant:
    return Plant(put, JOINTS, _one(name), begin, most, **rest)


def _motor(put, name: str, begin: float, most: float, **rest) -> Plant:
    return Plant(put, MOTORS, _one(name), begin, most, **rest)


def _contact(put, sites, name: str, begin: float, most: float, **rest) -> Plant:
    return Plant(put, sites, _one(name), begin, most, mode="contact", **rest)


def _drawn(**ranges) -> Callable[..., Values]:
    """Shape numbers, each uniform in its range."""
    return lambda rng, rig, motion, site: {name: float(rng.uniform(*span)) for name, span in ranges.items()}


def _with_shape(name: str) -> Callable[..., Values]:
    """The size under `name`, the shape as it is."""
    return lambda size, **shape: {name: size, **shape}


def _times(size: float, **shape) -> Values:
    """Every shape number times the size."""
    return {name: size * value for name, value in shape.items()}


def _shares(rng, *names: str) -> Values:
    """Numbers between 0.2 and 1."""
    return {name: float(rng.uniform(0.2, 1)) for name in names}


def _uneven(first: str, second: str) -> Callable[..., Values]:
    """Two shares of the size, either one the smaller."""

    def form(rng, rig, motion, site) -> Values:
        low = rng.uniform(0.2, 0.6)
        return {first: 1.0, second: low} if rng.random() < 0.5 else {first: low, second: 1.0}

    return form


def _peak(rng, rig, motion, site) -> Values:
    return {"peak": float(np.abs(motion.ctrl[:, :, rig.naive.actuator(site).id]).max())}


def _phase(rng, rig, motion, site) -> Values:
    angle = rng.uniform(0, 2 * np.pi)
    return {"sine": np.sin(angle), "cosine": np.cos(angle), "cycles": float(rng.choice([6, 8, 12, 16, 24]))}


def _direction(rng, rig, motion, site) -> Values:
    angle = rng.uniform(0, 2 * np.pi)
    return {"x": np.cos(angle), "y": np.sin(angle)}


def _lean(rng, rig, motion, site) -> Values:
    way = {"y": 1.0} if rig.plane == "xz" else _direction(rng, rig, motion, site)
    return {f"tilt_{axis}": part for axis, part in way.items()}


def _post(rng, rig, motion, site) -> Values:
    angle, far = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 0.9)
    return {"anchor_x": far * np.cos(angle), "anchor_y": far * np.sin(angle), "anchor_z": 0.0}


def _axis(rng, rig, motion, site) -> Values:
    return {"turn_y" if rig.plane == "xz" else "turn_z": 1.0}


# What a rig cannot tell apart in any motion is one effect with two names there, and is planted under the first of them
# in the catalogue. On a pivot without gravity, mass, its place, inertia and a rotor are one number, and so are drag and
# damping; a round tip that is larger is a wall that is nearer; sensors that are all late are motors that are, and where
# nothing is commanded a motion that has begun earlier.
# The wrist's force jumps with the commands, at the very instants at which it is read: however short, a delay of it, or
# a drift of its clock, would read the time before the jump. Neither is planted there. Behind a servo or a heavy gear a
# joint follows its own motor alone: an encoder that is late is a command that is, one that is off is a torque, and a
# gain on the position of one that has hardly another is the whole gain.
PLANTS = {
    "coulomb": _joint(joints.coulomb, "friction", 0.01, 0.6, power=1),
    "viscous": _joint(joints.viscous, "damping", 0.02, 0.6, power=1),
    "direction_dependent_coulomb": Plant(
        joints.asymmetric_coulomb, JOINTS, _times, 0.01, 0.6, _uneven("forward", "backward"), power=1
    ),
    "stribeck": Plant(
        joints.stribeck,
        JOINTS,
        lambda size, share, speed: {"coulomb": size * (1 - share), "excess": size * share, "speed": speed},
        0.01,
        0.8,
        _drawn(share=(0.5, 0.8), speed=(0.2, 0.8)),
        power=1,
    ),
    "load_dependent_friction": _joint(joints.load_friction, "coefficient", 0.01, 0.4),
    "dahl": Plant(joints.dahl, JOINTS, _with_shape("friction"), 0.01, 0.6, _drawn(displacement=(0.03, 0.15)), power=1),
    "quadratic_damping": _joint(joints.quadratic_damping, "damping", 0.002, 0.3, power=1),
    "backlash": _joint(gears.backlash, "gap", 0.002, 0.15, stiff=8),
    "joint_elasticity": _joint(gears.joint_elasticity, "compliance", 0.001, 0.1, power=-1),
    "torque_ripple": Plant(
        joints.torque_ripple,
        JOINTS,
        lambda size, sine, cosine, cycles: {"sine": size * sine, "cosine": size * cosine, "cycles": cycles},
        0.01,
        0.6,
        _phase,
        power=1,
    ),
    "efficiency": Plant(joints.efficiency, JOINTS, _times, 0.01, 0.5, _uneven("driving", "driven")),
    "transmission_coupling": Plant(
        joints.transmission_coupling,
        dict.fromkeys((AXES, SERVO), ("joint_5<-joint_4", "joint_6<-joint_5")),
        _times,
        0.01,
        0.6,
        lambda rng, rig, motion, site: {"inertia": 0.02} | _shares(rng, "damping", "friction"),
        power=1,
    ),
    "gain": _motor(signals.gain, "change", 0.01, 0.5, signed=True),
    "saturation": Plant(signals.saturation, MOTORS, lambda size, peak: {"limit": peak / (1 + size)}, 0.3, 4.0, _peak),
    "command_delay": _motor(signals.command_delay, "delay", 0.001, 0.05),
    "actuator_lag": _motor(signals.actuator_lag, "time", 0.001, 0.08),
    "rotor_inertia": _joint(joints.rotor_inertia, "inertia", 5e-4, 0.1, power=1),
    "torque_offset": _motor(signals.torque_offset, "offset", 0.003, 0.8, signed=True, power=1),
    "servo_kp": Plant(signals.servo_kp, {LEG: ROBOTS_M[LEG]}, _one("change"), 0.01, 0.5, signed=True),
    "servo_kv": Plant(signals.servo_kv, {LEG: ROBOTS_M[LEG]}, _one("change"), 0.02, 0.8, signed=True),
    "deadband": Plant(servos.deadband, {SERVO: ROBOTS_M[SERVO]}, _one("width"), 0.01, 0.3),
    "target_resolution": Plant(signals.target_resolution, {SERVO: ROBOTS_M[SERVO]}, _one("step"), 0.01, 0.2),
    "payload": Plant(
        bodies.payload,
        _arms(OUTER) | {AXES: ("link_3", "link_6"), SERVO: ("link_3", "link_5"), LEG: ("thigh",)},
        _with_shape("mass"),
        0.02,
        1.0,
        lambda rng, rig, motion, site: {"place": HELD.get((rig.name, site), 0.3)},
        power=1,
    ),
    "com_shift": Plant(bodies.com_shift, _arms(OUTER), _times, 3e-3, 0.12, _direction),
    "inertia": Plant(bodies.inertia, _arms(OUTER), _one("change"), 0.05, 3.0),
    "spring": Plant(joints.spring, JOINTS, _with_shape("stiffness"), 0.01, 4.0, _drawn(rest=(-0.5, 0.5)), power=1),
    "hardening_spring": _joint(joints.hardening_spring, "cubic", 0.02, 8.0, power=1),
    "cable_pull": Plant(bodies.cable_pull, _arms(OUTER), _with_shape("stiffness"), 0.05, 30.0, _post),
    "gravity_tilt": Plant(
        bodies.gravity_tilt,
        EVERY,
        _times,
        1e-3,
        0.2,
        _lean,
        True,
    ),
    "gravity_scale": Plant(
        bodies.gravity_scale, dict.fromkeys((BLOCK, LEG), ("world",)), _one("change"), 2e-3, 0.2, signed=True
    ),
    "base_gives_way": Plant(
        bodies.base_gives_way, dict.fromkeys((AXES, SERVO), ("base",)), _one("compliance"), 1e-3, 0.05, power=-1
    ),
    "linear_drag": Plant(bodies.linear_drag, _arms(OUTER) | {BLOCK: ("block",)}, _one("coefficient"), 0.01, 5.0),
    "quadratic_drag": Plant(bodies.quadratic_drag, _arms(OUTER) | {BLOCK: ("block",)}, _one("coefficient"), 0.01, 5.0),
    "ground_height": _contact(contacts.ground_height, GROUND, "height", 1e-4, 0.02, signed=True),
    "ground_tilt": _contact(contacts.ground_tilt, GROUND, "tilt_y", 1e-3, 0.15, signed=True),
    "sliding_friction": _contact(contacts.sliding_friction, TOUCH, "change", 0.01, 0.29, signed=True),
    "contact_stiffness": _contact(contacts.contact_stiffness, TOUCH, "change", 0.02, 0.8, signed=True),
    "contact_damping": _contact(contacts.contact_damping, TOUCH, "change", 0.02, 0.8, signed=True),
    "rolling_friction": _contact(contacts.rolling_friction, TOUCH, "coefficient", 1e-4, 0.02),
    "rounded_edge": _contact(contacts.rounded_edge, {BLOCK: ("mat",)}, "radius", 1e-4, 0.02),
    "sensor_bias": Plant(
        signals.bias,
        {FREE: ENCODERS[1:], PRESS: ENCODERS[1:] + HAND, BLOCK: IMU, LEG: ("imu[2]",)},
        _one("offset"),
        0.01,
        5.0,
        signed=True,
    ),
    "sensor_scale": Plant(
        signals.scale,
        {FREE: ENCODERS, PRESS: (*ENCODERS, *HAND, "wrist_force"), BLOCK: (*CAMERA, *IMU, "imu")} | ROBOTS_ENCODERS,
        _one("change"),
        0.005,
        0.3,
        signed=True,
    ),
    "sensor_delay": Plant(
        signals.sensor_delay,
        {FREE: ENCODERS, PRESS: ENCODERS, BLOCK: (*CAMERA, "imu"), LEG: ("rail_encoder", "imu")},
        _one("delay"),
        3e-4,
        0.03,
    ),
    "misalignment": Plant(
        signals.misalignment, {PRESS: ("wrist_force",), BLOCK: ("imu",)}, _times, 0.01, 0.5, _axis, True
    ),
    "clock_drift": Plant(
        signals.clock_drift, dict.fromkeys((FREE, BLOCK), ("all",)), _one("rate"), 3e-4, 0.05, signed=True
    ),
}
