"""What the actuators of a joint deliver, and dry friction that a simulation step can carry."""

import copy

import mujoco
import numpy as np

from fimpact.effects.base import State
from fimpact.effects.sites import drives

FRICTION = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
SLOWEST = 4  # steps: a faster friction row would ring, because a force is held over a step


def motor_force(state: State, site: str) -> np.ndarray:
    """Force, (n,), of the actuators on joint `site` as they leave the gear, N or N m."""
    model, total = state.model, np.zeros(len(state.qpos))
    _, position, speed = state.joint(site)
    for i in drives(model, site):
        gear, gain, bias = model.actuator_gear[i, 0], model.actuator_gainprm[i], model.actuator_biasprm[i]
        affine = np.stack([np.ones_like(speed), gear * position, gear * speed])
        force = (gain[:3] @ affine if model.actuator_gaintype[i] else gain[0]) * state.ctrl[:, i]
        force = force + (bias[:3] @ affine if model.actuator_biastype[i] else 0.0)
        low, high = model.actuator_forcerange[i] if model.actuator_forcelimited[i] else (-np.inf, np.inf)
        total += gear * np.clip(force, low, high)
    return total


def dry(state: State, key: tuple, site: str, forward, backward) -> np.ndarray:
    """Friction force, (n,), at joint `site` that does not exceed `forward` at positive, `backward` at negative speed.

    It is MuJoCo's own dry friction under the forces of the moment: a sign function would chatter and a smooth one
    creep. Unequal limits are equal ones beside a constant force. `key` names what the law keeps between steps.
    """
    dof, _, _ = state.joint(site)
    if key not in state.memory:
        twin = copy.copy(state.model)
        if twin.dof_solref[dof, 0] > 0:
            twin.dof_solref[dof, 0] = max(twin.dof_solref[dof, 0], SLOWEST * state.step)
        state.memory[key] = twin, mujoco.MjData(twin), float(twin.dof_frictionloss[dof])
    twin, data, own = state.memory[key]
    level, constant = np.broadcast_arrays((forward + backward) / 2, (backward - forward) / 2)
    force = np.zeros(len(state.qpos))
    for row in np.flatnonzero(np.isfinite(state.qvel).all(1) & (level > 0)):
        data.qpos[:], data.qvel[:], data.ctrl[:] = state.qpos[row], state.qvel[row], state.ctrl[row]
        data.qfrc_applied[dof] = constant[row]
        force[row] = constant[row] + _held(twin, data, dof, own + level[row])
        if own > 0:
            data.qfrc_applied[dof] = 0
            force[row] -= _held(twin, data, dof, own)
    return force


def _held(model, data, dof: int, limit: float) -> float:
    """What MuJoCo's dry friction of `limit` answers on one degree of freedom."""
    model.dof_frictionloss[dof] = limit
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_fwdActuation(model, data)
    mujoco.mj_fwdAcceleration(model, data)
    mujoco.mj_fwdConstraint(model, data)
    row = (data.efc_type == FRICTION) & (data.efc_id == dof)
    return float(data.efc_force[row].sum())
