"""Natural scales of a recording, never zero: probing amplitudes are small beside them, priors follow from them."""

import mujoco
import numpy as np

from fimpact.effects.base import SMALL as SMALL
from fimpact.effects.base import Scales
from fimpact.effects.wiring import HINGE, SLIDE, drives

FLOOR = 1e-3  # of a natural scale, where the recording shows none
THIN = 0.05  # of the mechanism: no body counts as smaller
MOMENTS = ("sxx", "syy", "szz", "sxy", "sxz", "syz")


def force(scales: Scales, model: mujoco.MjModel, joint: str) -> float:
    """Root mean square force of a joint, N or N m."""
    return float(
        max(scales.force[_dof(model, joint)], FLOOR * scales.mass * scales.gravity * _arm(scales, model, joint))
    )


def applied(scales: Scales, model: mujoco.MjModel, joint: str) -> float:
    """Root mean square force of a joint or of its motors behind their gears, whichever is larger, N or N m."""
    motors = drives(model, joint)
    given = np.abs(model.actuator_gear[motors, 0]) @ scales.drive[motors]
    return float(max(force(scales, model, joint), given))


def speed(scales: Scales, model: mujoco.MjModel, joint: str) -> float:
    """Root mean square speed of a joint, m/s or rad/s."""
    least = FLOOR * np.sqrt(scales.gravity * scales.length) / _arm(scales, model, joint)
    return float(max(scales.speed[_dof(model, joint)], least))


def travel(scales: Scales, model: mujoco.MjModel, joint: str) -> float:
    """Standard deviation of a joint's position, m or rad."""
    return float(max(scales.travel[_dof(model, joint)], FLOOR * scales.length / _arm(scales, model, joint)))


def inertia(scales: Scales, model: mujoco.MjModel, joint: str) -> float:
    """Inertia that a joint may feel of its drive, kg m^2 or kg: its own, or where that is more, what the force applied
    accelerates as the joint was accelerated, up to the inertia at the heaviest joint of the kind."""
    own = 1 / np.maximum(model.dof_invweight0, 1e-9)
    alike = model.jnt_type[model.dof_jntid] == model.joint(joint).type[0]
    rate = speed(scales, model, joint) ** 2 / travel(scales, model, joint)
    moved = min(applied(scales, model, joint) / rate, own[alike].max())
    return float(max(own[_dof(model, joint)], moved))


def mean_position(scales: Scales, model: mujoco.MjModel, joint: str) -> float:
    """Mean position of a joint, m or rad."""
    return float(scales.middle[_dof(model, joint)])


def rms_actuator_force(scales: Scales, model: mujoco.MjModel, actuator: str) -> float:
    """Root mean square force of an actuator, before its gear, N or N m."""
    return _actuation(scales.drive, model, actuator)


def max_actuator_force(scales: Scales, model: mujoco.MjModel, actuator: str) -> float:
    """Largest force of an actuator, before its gear, N or N m."""
    return _actuation(scales.summit, model, actuator)


def max_force(scales: Scales, model: mujoco.MjModel) -> float:
    """The largest force on a degree of freedom, as a force in N at the size of the mechanism."""
    return float(max((scales.force / _arms(scales, model)).max(), FLOOR * scales.mass * scales.gravity))


def max_speed(scales: Scales, model: mujoco.MjModel) -> float:
    """The largest speed of a degree of freedom, as a speed in m/s at the size of the mechanism."""
    return float(max((scales.speed * _arms(scales, model)).max(), FLOOR * np.sqrt(scales.gravity * scales.length)))


def delay(scales: Scales) -> float:
    """Typical delay of a bus or a filter: three samples, but between 10 and 50 ms."""
    return late(scales.period)


def late(period: float) -> float:
    """The same, of a time between samples in s."""
    return float(np.clip(3 * period, 0.01, 0.05))


def instant(scales: Scales) -> float:
    """A time, s, to which rows of a log are stamped: what happens within a row of it is not known better."""
    return SMALL * scales.period


def size(scales: Scales, model: mujoco.MjModel, body: str) -> float:
    """Longest side of the box that has the mass and the inertia of a body, m."""
    row = model.body(body).id
    moments, mass = model.body_inertia[row], model.body_mass[row]
    side = np.sqrt(max(6 * (moments.sum() - 2 * moments.min()) / mass, 0.0))
    return float(max(side, THIN * scales.length))


def normal(model: mujoco.MjModel) -> np.ndarray | None:
    """The direction, (3,), in which nothing moves if the mechanism is planar, else None."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turns, slides = data.xaxis[model.jnt_type == HINGE], data.xaxis[model.jnt_type == SLIDE]
    if len(turns) == 0 or len(turns) + len(slides) < model.njnt:
        return None
    planar = np.allclose(np.cross(turns, turns[0]), 0, atol=1e-6) and np.allclose(slides @ turns[0], 0, atol=1e-6)
    return turns[0] if planar else None


def directions(model: mujoco.MjModel, frame: np.ndarray | None = None) -> list[int]:
    """Axes of `frame` (3, 3, its columns the axes in the world; None: the world) along which something can move."""
    across = normal(model)
    if across is None:
        return [0, 1, 2]
    still = int(np.argmax(np.abs(across if frame is None else frame.T @ across)))
    return [axis for axis in range(3) if axis != still]


def reference(model, body: str) -> tuple[np.ndarray, np.ndarray]:
    """Centre of mass, (3,), and axes, (3, 3), of a body in the reference configuration."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    row = data.body(body)
    return row.xipos, row.xmat.reshape(3, 3)


def stretch(scales: Scales, model: mujoco.MjModel, joint: str) -> float:
    """How far a joint is from where its spring rests, m or rad."""
    away = mean_position(scales, model, joint) - model.qpos_spring[model.joint(joint).qposadr[0]]
    return float(np.hypot(away, travel(scales, model, joint)))


def target(model: mujoco.MjModel, actuator: str) -> float:
    """Unit of targets in which parts of a degree and parts of a tenth of a millimetre are alike."""
    turns = model.joint(model.actuator(actuator).trnid[0]).type[0] == HINGE
    return float(np.radians(1)) if turns else 1e-4


def shown(scales: Scales) -> float:
    """A typical standard deviation of the channels: the laws are exactly linear, so only its order counts."""
    known = scales.measured[scales.measured > 0]
    return max(float(np.median(known)), FLOOR) if known.size else FLOOR


def second_moments(principal: np.ndarray) -> np.ndarray:
    """Second moments of mass, (3,), of principal moments of inertia (3,), kg m^2: positive for what has a density."""
    return principal.sum() / 2 - principal


def _actuation(forces: np.ndarray, model, actuator: str) -> float:
    row = model.actuator(actuator)
    return float(max(forces[row.id], FLOOR * max(abs(row.gainprm[0]), FLOOR)))


def _dof(model, joint: str) -> int:
    return model.joint(joint).dofadr[0]


def _arm(scales: Scales, model, joint: str) -> float:
    return scales.length if model.joint(joint).type[0] == HINGE else 1.0


def _arms(scales: Scales, model) -> np.ndarray:
    """Length that turns each degree of freedom's force into N: 1 where it is a translation, (nv,)."""
    arms = np.ones(model.nv)
    for joint in range(model.njnt):
        first, kind = model.jnt_dofadr[joint], model.jnt_type[joint]
        spins = {HINGE: [0], SLIDE: [], int(mujoco.mjtJoint.mjJNT_BALL): [0, 1, 2]}.get(int(kind), [3, 4, 5])
        arms[[first + i for i in spins]] = scales.length
    return arms
