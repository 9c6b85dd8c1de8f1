"""Bodies that joints carry, along a smoothed motion: what pushes on them, and what slides to and fro in them.

Something loose in a body - a tool with play in its gripper, a part that came off - is pulled by gravity and by the
motion, moves freely until it meets an end, and stops there: while it moves, the body lacks what it would press with.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.deciding import NOTHING
from fimpact.smoothing.dynamics.laws import middle
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.smoother import Smoothed


@dataclass(frozen=True)
class Carried:
    """A body, with all that is fixed to it. dof: its last degree of freedom. push: generalised force of 1 N along each
    axis of the world at its centre of mass, (3, N, nv). axes: its own, in the world, (N, 3, 3). pull: how gravity and
    the motion pull along each of these at what is loose in it, (N, 3), m/s^2. mass: kg. diagonal: m, of a box with its
    inertia."""

    dof: int
    push: np.ndarray
    axes: np.ndarray
    pull: np.ndarray
    mass: float
    diagonal: float


def carried(fit: Smoothed) -> list[Carried]:
    """Every body that joints carry."""
    track, model = fit.track, fit.track.model
    (qpos, qvel), rate = middle(track, fit.states), (track.next(fit.states).qvel - fit.states.qvel) / track.period
    bodies = [body for body in range(1, model.nbody) if model.body_dofnum[body] and model.body_parentid[body]]
    shape, data = (len(bodies), track.count), mujoco.MjData(model)
    push, axes, felt = np.zeros((*shape, 3, model.nv)), np.zeros((*shape, 3, 3)), np.zeros((*shape, 6))
    for k in range(track.count):
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos[k], qvel[k], rate[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rnePostConstraint(model, data)  # accelerations, less gravity
        for i, body in enumerate(bodies):
            mujoco.mj_jacBodyCom(model, data, push[i, k], None, body)
            mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_BODY, body, felt[i, k], 0)
            axes[i, k] = data.xmat[body].reshape(3, 3).T
    pull = -np.einsum("ikab,ikb->ika", axes, felt[:, :, 3:])
    found = []
    for i, body in enumerate(bodies):
        fixed = model.body_weldid == body
        mass = float(model.body_mass[fixed].sum())
        diagonal = float(np.sqrt(6 * model.body_inertia[fixed].sum() / mass))
        last = int(model.body_dofadr[body] + model.body_dofnum[body] - 1)
        found.append(Carried(last, push[i].swapaxes(0, 1), axes[i], pull[i], mass, diagonal))
    return found


def sliding(track: Track, body: Carried, count: int) -> Iterator[tuple[str, np.ndarray]]:
    """For each axis of `body` along which something may slide, the generalised force, (N, gaps, nv), of 1 kg that does,
    between ends so far apart, in `count` steps, that it crosses in a sample, up to as far as the body is wide."""
    force = -np.einsum("kab,bkv->akv", body.axes, body.push)
    usual, loud = np.sqrt(np.mean(body.pull**2, 0)), np.sqrt(np.mean(force**2, (1, 2)))
    axes = np.flatnonzero((usual > NOTHING * usual.max()) & (loud > NOTHING * loud.max()))
    crossing = np.linspace(track.period, np.sqrt(2 * body.diagonal / usual[axes]), count, axis=1)
    moved = _accelerated(track, body.pull[:, axes, None], usual[axes, None] * crossing**2 / 2)
    for axis, own in zip(axes, moved.swapaxes(0, 1), strict=True):
        own = own[:, own.any(0)]
        if own.size:
            yield "xyz"[axis], own[:, :, None] * force[axis][:, None]


def _accelerated(track: Track, pull: np.ndarray, gaps: np.ndarray) -> np.ndarray:
    """Mean acceleration in each sample, (N, axes, gaps), of what `pull`, (N, axes, 1), moves between ends at which it
    stops, `gaps` apart, (axes, gaps)."""
    found = np.zeros((len(pull), *gaps.shape))
    for rows in track.slices():
        place, speed = np.sign(pull[rows.start]) * gaps / 2, np.zeros_like(gaps)
        for k in range(rows.start, rows.stop):
            free = speed + track.period * pull[k]
            place = place + track.period * (speed + free) / 2
            after = np.where(np.abs(place) < gaps / 2, free, 0.0)
            found[k] = (after - speed) / track.period
            place, speed = np.clip(place, -gaps / 2, gaps / 2), after
    return found
