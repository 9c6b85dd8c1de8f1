"""Motors that give what their command says, and a constant more, at once."""

import mujoco
import numpy as np

from fimpact.effects.wiring import ON_JOINT
from fimpact.smoothing.states import BALL, FREE

NONE = mujoco.mjtBias.mjBIAS_NONE


def is_plain(model: mujoco.MjModel, motor: int) -> bool:
    """Whether a motor gives a hinge or a slide what its command says, and perhaps a constant more, at once."""
    joint = model.actuator_trnid[motor, 0]
    return bool(
        model.actuator_trntype[motor] == ON_JOINT
        and model.jnt_type[joint] not in (FREE, BALL)
        and not model.jnt_actfrclimited[joint]
        and model.actuator_dyntype[motor] == mujoco.mjtDyn.mjDYN_NONE
        and model.actuator_gaintype[motor] == mujoco.mjtGain.mjGAIN_FIXED
        and (model.actuator_biastype[motor] == NONE or (_is_affine(model, motor) and not _feedback(model, motor).any()))
    )


def _is_affine(model: mujoco.MjModel, motor: int) -> bool:
    return model.actuator_biastype[motor] == mujoco.mjtBias.mjBIAS_AFFINE


def _feedback(model: mujoco.MjModel, motor: int) -> np.ndarray:
    return model.actuator_biasprm[motor, 1:3]  # of position and speed


def given_by(model: mujoco.MjModel, motor: int, ctrl: np.ndarray) -> np.ndarray:
    """Force of a plain motor on its joint under commands `ctrl`, within its limits."""
    if model.actuator_ctrllimited[motor]:
        ctrl = np.clip(ctrl, *model.actuator_ctrlrange[motor])
    force = model.actuator_gainprm[motor, 0] * ctrl
    if _is_affine(model, motor):
        force = force + model.actuator_biasprm[motor, 0]
    if model.actuator_forcelimited[motor]:
        force = np.clip(force, *model.actuator_forcerange[motor])
    return force * model.actuator_gear[motor, 0]
