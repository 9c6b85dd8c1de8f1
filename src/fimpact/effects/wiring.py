"""What the actuators of a model drive, and what its sensors read."""

import mujoco
import numpy as np

HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
ON_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
PROPORTIONAL = (int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_AFFINE))
AFFINE = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))
OWN_AXES = tuple(
    int(getattr(mujoco.mjtSensor, f"mjSENS_{kind}"))
    for kind in ("ACCELEROMETER", "VELOCIMETER", "GYRO", "FORCE", "TORQUE", "MAGNETOMETER")
)


def drives(model: mujoco.MjModel, joint: str) -> list[int]:
    """Actuators on `joint` that `is_affine` allows."""
    target = (model.actuator_trntype == ON_JOINT) & (model.actuator_trnid[:, 0] == model.joint(joint).id)
    return [i for i in map(int, np.flatnonzero(target)) if is_affine(model, i)]


def is_affine(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator's force is an affine function of the command, length and velocity."""
    return model.actuator_gaintype[actuator] in PROPORTIONAL and model.actuator_biastype[actuator] in AFFINE


def fed_back(model: mujoco.MjModel, actuator: str) -> tuple[bool, bool]:
    """Whether an actuator feeds back its position, and its speed."""
    row = model.actuator(actuator).id
    position, speed = model.actuator_biasprm[row, 1:3] * (model.actuator_biastype[row] == AFFINE[1]) != 0
    return bool(position), bool(speed)


def has_servos(model: mujoco.MjModel) -> bool:
    """Whether motors hold positions: under them one kind of physics alone goes wrong at every joint, and the compound
    of what every geared drive has comes first."""
    return bool(model.actuator_biasprm[:, 1].any())


def encoded_joint(model: mujoco.MjModel, channel: str) -> str:
    """The joint whose position `channel` reads, or ""."""
    sensor = model.sensor(base(channel))
    known = sensor.type[0] == mujoco.mjtSensor.mjSENS_JOINTPOS
    return model.joint(sensor.objid[0]).name if known else ""


def rotates_with_site(model: mujoco.MjModel, sensor: str) -> bool:
    """Whether `sensor` reads along the axes of its MJCF site, and so turns with it; many read along the world's."""
    return any(s.name == sensor and s.type[0] in OWN_AXES for s in map(model.sensor, range(model.nsensor)))


def base(channel: str) -> str:
    """Name of the sensor that `channel` is, or is a component of."""
    return channel.partition("[")[0]


def component(channel: str) -> int:
    """Which component of its sensor `channel` is."""
    return int(channel.removesuffix("]").partition("[")[2] or 0)
