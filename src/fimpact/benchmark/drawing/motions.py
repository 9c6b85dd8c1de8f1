"""Motions: what the robot is told to do, planned on the naive model so that it stays within reach."""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.ndimage import gaussian_filter1d

from fimpact.benchmark.drawing import campaigns
from fimpact.benchmark.rigs.rig import Rig

CALM = 0.02  # s over which commands are smoothed: torques that jump make forces and accelerations jump
PACE = 2.5  # rad/s, of a joint that only ever advances
SETTLED = 0.1  # s, in which a run begun at a pace of its own takes up its path
REACH = 0.63  # m, where the tip touches the wall


@dataclass(frozen=True)
class Motion:
    """Believed starts (runs, 2 nv) and commands (runs, T, nu) of all runs, and which are held out (runs,)."""

    start: np.ndarray
    ctrl: np.ndarray
    held_out: np.ndarray


def draw_motion(
    rig: Rig, rng: np.random.Generator, style: str = "lively", joint: int = 0, model: mujoco.MjModel | None = None
) -> Motion:
    """Motions of every run; half of the held-out ones are faster or elsewhere.

    Args:
        style: one of `EXCITATIONS`, about motor `joint`; "lively" is the usual one, the others make twins.
        model: what the controller moves, at the naive model's step; None: the naive model.
    """
    held_out = np.arange(rig.training + rig.held_out) >= rig.training
    fast = np.arange(len(held_out)) >= rig.training + rig.held_out // 2
    if rig.throws():
        start = np.stack([_throw(rng, f, style) for f in fast])
        return Motion(start, np.zeros((len(fast), rig.samples, 0)), held_out)
    time = np.arange(rig.samples) * rig.period
    paths = [PATHS[rig.name](rng, time, f, run) for run, f in enumerate(fast)]
    paths = [EXCITATIONS[style](rng, time, path, joint) for path in paths]
    pace = np.zeros(rig.naive.nu) if style != "oneway" else PACE * np.eye(rig.naive.nu)[joint]
    start = np.stack([_start(rig, path, pace) for path in paths])
    ctrl = _commands(rig, paths, pace, rig.naive if model is None else model)
    return Motion(start, _bang_bang(rng, ctrl, joint) if style == "bang" else ctrl, held_out)


def _start(rig: Rig, path: np.ndarray, pace: np.ndarray) -> np.ndarray:
    """State (2 nv,) in which a run begins."""
    if rig.name == "leg":
        return np.r_[campaigns.standing(path[0]), 0.0, pace]
    return np.r_[path[0], pace]


def _commands(rig: Rig, paths: list[np.ndarray], pace: np.ndarray, model: mujoco.MjModel) -> np.ndarray:
    """Targets, or the torques of a controller that has the model follow the paths, (runs, T, nu)."""
    if rig.serves():
        return np.stack(paths)
    ctrl = np.stack([_follow(rig, path, pace, model) for path in paths])
    return gaussian_filter1d(ctrl, CALM / rig.period, axis=1)


def _waves(rng, time, amplitude, low, high, terms=3):
    phase, rate = rng.uniform(0, 2 * np.pi, terms), rng.uniform(low, high, terms)
    share = rng.dirichlet(np.ones(terms))
    return amplitude * (share * np.sin(2 * np.pi * rate * time[:, None] + phase)).sum(1)


def _swing(rng, time, fast, run):
    """Free swinging of three joints about a posture, (T, 3), rad."""
    quick, centre = (1.5 if fast else 1.0), rng.uniform(-0.7, 0.7, 3)
    size = rng.uniform(0.7, 1.1, 3)
    return centre + np.stack([_waves(rng, time, a, 0.4 * quick, 1.8 * quick) for a in size], axis=1)


def _press(rng, time, fast, run):
    """Reach for the wall, press, slide and leave it, (T, 3), rad, by inverse kinematics of tip and last link."""
    quick = 1.4 if fast else 1.0
    deep = rng.uniform(0.0, 0.05) + _waves(rng, time, rng.uniform(0.08, 0.14), 0.5 * quick, 1.8 * quick)
    deep = deep - (deep[0] + 0.03) * np.exp(-time / 0.15)
    along = rng.uniform(0.1, 0.3) + _waves(rng, time, 0.15, 0.4 * quick, 1.5 * quick)
    lean = np.pi / 2 + _waves(rng, time, 0.5, 0.4 * quick, 1.5 * quick)
    return _postures(np.stack([along, REACH + deep], axis=1), lean)


def _postures(tip, lean):
    wrist = tip - 0.3 * np.stack([np.cos(lean), np.sin(lean)], axis=1)
    far = np.clip(np.hypot(*wrist.T), 0.05, 0.595)
    elbow = 2 * np.arccos(far / 0.6)
    shoulder = np.arctan2(wrist[:, 1], wrist[:, 0]) - elbow / 2
    return np.stack([shoulder, elbow, lean - shoulder - elbow], axis=1)


def _throw(rng, fast, style):
    """Start of one throw (6,): x, z, pitch and their rates."""
    quick = 1.8 if fast else 1.0
    side = 1.0 if style == "steady" else rng.choice([-1.0, 1.0])
    pace = rng.uniform(1.2, 1.3) if style == "steady" else rng.uniform(0.1, 1.2) * quick
    return np.array(
        [
            rng.uniform(-0.1, 0.1),
            rng.uniform(0.3, 0.45),
            rng.uniform(-np.pi, np.pi),
            side * pace,
            rng.uniform(-0.8, 0.2),
            rng.uniform(-8, 8) * quick,
        ]
    )


def _fast(rng, time, path, joint):
    return path


def _monotone(rng, time, path, joint):
    """The joint only ever advances, at a speed that varies, beside others that hardly move."""
    speed = PACE * (1 + _waves(rng, time, 0.3, 0.5, 1.5) * (1 - np.exp(-time / 0.1)))
    path = path.mean(0) + 0.3 * (path - path.mean(0))
    path[:, joint] = rng.uniform(-2, -1) + np.cumsum(speed) * (time[1] - time[0])
    return path


def _static(rng, time, path, joint):
    """The joint hardly leaves its posture, the same in every run."""
    path = path.copy()
    path[:, joint] = 0.8 + _waves(rng, time, 0.03, 0.5, 1.5)
    return path


def _slow(rng, time, path, joint):
    """Everything at a third of the usual pace."""
    return np.stack([np.interp(time / 3, time, column) for column in path.T], axis=1)


def _bang_bang(rng, ctrl, joint):
    """One motor knows only full torque, forward or backward, the same in every run."""
    out, level = ctrl.copy(), np.median(np.abs(ctrl[:, :, joint]))
    out[:, :, joint] = np.where(ctrl[:, :, joint] >= 0, level, -level)
    return out


EXCITATIONS = {
    "lively": _fast,
    "oneway": _monotone,
    "still": _static,
    "slow": _slow,
    "bang": _fast,
    "steady": _fast,
}


PATHS = {
    "arm_free": _swing,
    "arm_contact": _press,
    "six_axis": campaigns.six_axis,
    "six_servo": campaigns.six_servo,
    "leg": campaigns.leg,
}


def _follow(rig, path, pace, model):
    """Torques (T, nu) that make `model` follow `path` (T, nu), rad, from a speed of `pace` (nu,)."""
    data, steps, out = mujoco.MjData(model), round(rig.period / model.opt.timestep), np.empty_like(path)
    data.qpos[:], data.qvel[:] = path[0], pace
    late = np.exp(-np.arange(len(path)) * rig.period / SETTLED)[:, None]
    speed = np.gradient(path, rig.period, axis=0) * (1 - late) + pace * late
    for k in range(len(path)):
        wanted = rig.stiff * (path[k] - data.qpos) + rig.damp * (speed[k] - data.qvel)
        out[k] = np.clip(wanted, -rig.limit, rig.limit)
        data.ctrl[:] = out[k]
        mujoco.mj_step(model, data, steps)
    return out
