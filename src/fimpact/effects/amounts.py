"""Probing amplitudes: small in the natural scale of the recording, never zero."""

import mujoco
import numpy as np

from fimpact.effects.base import Scales
from fimpact.effects.sites import HINGE, SLIDE

SMALL = 0.02
FLOOR = 1e-3  # of a natural scale, where the recording shows none


def force(scales: Scales, model: mujoco.MjModel, joint: str) -> float:
    """Root mean square force of a joint, N or N m."""
    return float(
        max(scales.force[_dof(model, joint)], FLOOR * scales.mass * scales.gravity * _arm(scales, model, joint))
    )


def speed(scales: Scales, model: mujoco.MjModel, joint: str) -> float:
    """Root mean square speed of a joint, m/s or rad/s."""
    least = FLOOR * np.sqrt(scales.gravity * scales.length) / _arm(scales, model, joint)
    return float(max(scales.speed[_dof(model, joint)], least))


def travel(scales: Scales, model: mujoco.MjModel, joint: str) -> float:
    """Standard deviation of a joint's position, m or rad."""
    return float(max(scales.travel[_dof(model, joint)], FLOOR * scales.length / _arm(scales, model, joint)))


def middle(scales: Scales, model: mujoco.MjModel, joint: str) -> float:
    """Mean position of a joint, m or rad."""
    return float(scales.middle[_dof(model, joint)])


def drive(scales: Scales, model: mujoco.MjModel, actuator: str) -> float:
    """Root mean square force of an actuator, before its gear, N or N m."""
    return _actuation(scales.drive, model, actuator)


def summit(scales: Scales, model: mujoco.MjModel, actuator: str) -> float:
    """Largest force of an actuator, before its gear, N or N m."""
    return _actuation(scales.summit, model, actuator)


def push(scales: Scales, model: mujoco.MjModel) -> float:
    """The largest force on a degree of freedom, as a force in N at the size of the mechanism."""
    return float(max((scales.force / _arms(scales, model)).max(), FLOOR * scales.mass * scales.gravity))


def pace(scales: Scales, model: mujoco.MjModel) -> float:
    """The largest speed of a degree of freedom, as a speed in m/s at the size of the mechanism."""
    return float(max((scales.speed * _arms(scales, model)).max(), FLOOR * np.sqrt(scales.gravity * scales.length)))


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
