"""What the actuators of a joint deliver."""

from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.effects.base import State
from fimpact.effects.sites import drives


@dataclass(frozen=True)
class Drive:
    """An actuator, by its index: gear ratio, gain and bias, (3,) each of 1, length and speed or a constant, limits of
    its force (low, high) and of its command (least, most)."""

    index: int
    gear: float
    gain: np.ndarray | float
    bias: np.ndarray | float
    low: float
    high: float
    least: float
    most: float


def motor_force(state: State, site: str) -> np.ndarray:
    """Force, (n,), of the actuators on joint `site` as they leave the gear, N or N m."""
    total = np.zeros(len(state.qpos))
    _, position, speed = state.joint(site)
    for drive in _drives(state, site):
        command = np.clip(state.ctrl[:, drive.index], drive.least, drive.most)
        force = _at(drive.gain, drive, position, speed) * command
        force = force + _at(drive.bias, drive, position, speed)
        total += drive.gear * np.clip(force, drive.low, drive.high)
    return total


def _at(factor: np.ndarray | float, drive: Drive, position: np.ndarray, speed: np.ndarray) -> np.ndarray | float:
    if isinstance(factor, float):
        return factor
    return factor @ np.stack([np.ones_like(speed), drive.gear * position, drive.gear * speed])


def _drives(state: State, site: str) -> list[Drive]:
    # Asking a model takes longer than all that follows, and no law changes its actuators.
    key = "drives", site
    if key not in state.memory:
        state.memory[key] = [_drive(state.model, i) for i in drives(state.model, site)]
    return state.memory[key]


def _drive(model: mujoco.MjModel, i: int) -> Drive:
    gain, bias = model.actuator_gainprm[i, :3].copy(), model.actuator_biasprm[i, :3].copy()
    low, high = model.actuator_forcerange[i] if model.actuator_forcelimited[i] else (-np.inf, np.inf)
    least, most = model.actuator_ctrlrange[i] if model.actuator_ctrllimited[i] else (-np.inf, np.inf)
    return Drive(
        i,
        float(model.actuator_gear[i, 0]),
        gain if model.actuator_gaintype[i] else float(gain[0]),
        bias if model.actuator_biastype[i] else 0.0,
        float(low),
        float(high),
        float(least),
        float(most),
    )
