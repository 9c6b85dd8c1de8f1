"""How what a mechanism stands on may sway: a mass on a spring, shaken by the forces with which the mechanism moves.

What is fixed to the world in the model stands on a table, a stand or a cart in the laboratory. Such a mount answers the
mechanism's own reaction, and its acceleration acts on all masses as gravity does.
"""

from collections.abc import Iterator

import mujoco
import numpy as np
from scipy.signal import cont2discrete, lfilter

from fimpact.deciding import NOTHING
from fimpact.smoothing.columns import motion_scales
from fimpact.smoothing.dynamics.laws import middle
from fimpact.smoothing.dynamics.response import driven
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.smoother import Smoothed

SWINGS = 2  # in the longest run, at least
SAMPLES = 8  # in a swing, at least


def swaying(fit: Smoothed, count: int) -> Iterator[tuple[int, str, np.ndarray, np.ndarray]]:
    """For each axis of the world along which a mount may sway: the first degree of freedom on it, the axis, the
    generalised forces, (N, 2 count, nv), of mounts as heavy as the mechanism at `count` frequencies, in and out of
    phase, and the frequency of each, Hz."""
    track, held = fit.track, _held(fit.track.model)
    if not held.any():
        return
    pushed, reaction = _pushed(fit)
    longest = max(rows.stop - rows.start for rows in track.slices())
    # What swings slower than a pendulum as long as the mechanism does not hold it upright.
    falls = np.sqrt(np.linalg.norm(track.model.opt.gravity) / motion_scales(fit).length)
    slow, quick = (2 * np.pi / track.period / samples for samples in (longest / SWINGS, SAMPLES))
    slow = max(slow, falls)
    if quick <= slow:
        return
    rates = np.geomspace(slow, quick, count)
    loud = np.sqrt(np.mean(reaction**2, 0))
    for axis in np.flatnonzero(held & (loud > NOTHING * loud.max())):
        shaken = _shaken(track, reaction[:, axis], rates)
        yield 0, "xyz"[axis], -shaken[:, :, None] * pushed[:, axis, None], np.repeat(rates, 2) / (2 * np.pi)


def _held(model: mujoco.MjModel) -> np.ndarray:
    """Along which axes of the world, (3,), all is held by what it is mounted on: none along which a joint that no motor
    drives lets it go."""
    if mujoco.mjtJoint.mjJNT_FREE in model.jnt_type:
        return np.zeros(3, bool)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    idle = (model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE) & ~driven(model)[model.jnt_dofadr]
    return ~(np.abs(data.xaxis[idle]) > NOTHING).any(0)


def _pushed(fit: Smoothed) -> tuple[np.ndarray, np.ndarray]:
    """Generalised force that an acceleration of 1 m/s^2 along each axis of the world takes, (N, 3, nv), and the mean
    acceleration in each sample with which the mechanism pushes itself off, (N, 3), m/s^2."""
    track, after = fit.track, fit.track.next(fit.states)
    begun, ended = (np.einsum("kav,kv->ka", _centre(track, s.qpos), s.qvel) for s in (fit.states, after))
    mass = float(track.model.body_subtreemass[0])
    return mass * _centre(track, middle(track, fit.states)[0]), (begun - ended) / track.period


def _centre(track: Track, qpos: np.ndarray) -> np.ndarray:
    """Jacobian, (N, 3, nv), of the centre of all mass."""
    model, data = track.model, mujoco.MjData(track.model)
    found = np.zeros((track.count, 3, model.nv))
    for own, place in zip(found, qpos, strict=True):
        data.qpos[:] = place
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSubtreeCom(model, data, own, 0)
    return found


def _shaken(track: Track, pushes: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Acceleration of mounts, m/s^2, and their speed times their rate, (N, 2 rates), that `pushes`, (N,), shake."""
    found = np.zeros((len(pushes), 2 * len(rates)))
    damping = (rates[1] / rates[0] - 1) / 2  # a mount answers as far as to the next one
    for i, rate in enumerate(rates):
        mount = np.array([1.0, 0.0]), np.array([1.0, 2 * damping * rate, rate**2])  # from push to speed
        over, under, _ = cont2discrete(mount, track.period)
        for rows in track.slices():
            speed = lfilter(over[0], under, np.append(pushes[rows], 0.0))
            found[rows, 2 * i] = np.diff(speed) / track.period
            found[rows, 2 * i + 1] = rate * (speed[1:] + speed[:-1]) / 2
    return found
