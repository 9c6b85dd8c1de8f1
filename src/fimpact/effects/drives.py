"""What the actuators of a joint deliver."""

import numpy as np

from fimpact.effects.base import State
from fimpact.effects.sites import drives


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
