"""Advice of a motion, and the waves that it is made of."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.diagnosis.identifiability.motion_model import Motion
from fimpact.effects.sites import driven
from fimpact.effects.wiring import drives

SLOW = 4.0  # times slower is the slower of two speeds, and is the beginning of a sweep
ROUND = 0.98  # how sharply a joint turns back: 1 is at once


@dataclass(frozen=True)
class Advice:
    """A motion, None: what was recorded, as long again. joint: that moves alone, or "" where all do; how: in words,
    "there and back at 0.5 rad/s"."""

    joint: str
    how: str
    motion: Motion | None


LONGER = Advice("", "", None)  # as much again of what was recorded


@dataclass(frozen=True)
class Wave:
    """Positions of a joint, m or rad, at times in s, for so many seconds, and beyond them again."""

    at: Callable[[np.ndarray], np.ndarray]
    lasts: float


class Lazy:
    """What an iterator gives, as far as anybody asked."""

    def __init__(self, source: Iterator[Advice]):
        self.source = source
        self.known: list[Advice] = []

    def __iter__(self) -> Iterator[Advice]:
        yield from self.known
        for one in self.source:
            self.known.append(one)
            yield one


def commands_for(motion: Motion, model: mujoco.MjModel) -> np.ndarray | None:
    """Commands, (N, nu), under which the motors of `model` give what the motion needs."""
    out = np.zeros((motion.count, model.nu))
    needed, state = force_needed(motion, model), motion.state(model)
    for joint in driven(model):
        (dof, position, speed), motor = state.joint(joint), drives(model, joint)[0]
        gear, gain, bias = model.actuator_gear[motor, 0], model.actuator_gainprm[motor], model.actuator_biasprm[motor]
        follows = bias[:3] if model.actuator_biastype[motor] else np.zeros(3)
        force = needed[:, dof] / gear
        if model.actuator_forcelimited[motor] and np.abs(force).max() > np.abs(model.actuator_forcerange[motor]).max():
            return None
        out[:, motor] = (force - follows[0] - follows[1] * gear * position - follows[2] * gear * speed) / gain[0]
        low, high = model.actuator_ctrlrange[motor]
        if model.actuator_ctrllimited[motor] and not (low <= out[:, motor].min() and out[:, motor].max() <= high):
            return None
    return out


def force_needed(motion: Motion, model: mujoco.MjModel) -> np.ndarray:
    """Force, (N, nv), that motors have to give."""
    out, data = np.empty_like(motion.qvel), mujoco.MjData(model)
    for k in range(motion.count):
        data.qpos[:], data.qvel[:], data.qacc[:] = motion.qpos[k], motion.qvel[k], motion.qacc[k]
        mujoco.mj_inverse(model, data)
        out[k] = data.qfrc_inverse
    return out


def steady_wave(way: tuple[float, float], speed: float) -> Wave:
    """Twice there and back at nearly one speed."""
    (middle, half), lasts = way, 8 * way[1] / speed

    def at(time: np.ndarray) -> np.ndarray:
        return middle + half * np.arcsin(ROUND * np.sin(4 * np.pi * time / lasts)) / np.arcsin(ROUND)

    return Wave(at, lasts)


def sweeping_wave(way: tuple[float, float], speed: float) -> Wave:
    """To and fro, some five times, `SLOW` times as often at the end: at no time much faster than `speed`."""
    middle, first = way[0], speed / way[1]
    lasts = 20 * np.pi / first / (1 + SLOW)

    def at(time: np.ndarray) -> np.ndarray:
        rate = first * (1 + (SLOW - 1) * time / lasts)
        return middle + speed / rate * np.sin(first * time * (1 + (SLOW - 1) * time / lasts / 2))

    return Wave(at, lasts)
