"""Softness of contacts and limits, which MuJoCo scales by the inverse inertia at rest of what they hold.

An edit of a body's inertia thus does more than a force along the motion: wherever that body touches, or a joint is at
its limit, it is held more softly or less.
"""

import copy

import mujoco
import numpy as np

from fimpact.effects.touching import can_touch
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.states import BALL, FREE, States

PART = 1e-3  # of an inverse inertia, by which it is changed for a difference quotient
Place = tuple[str, tuple[int, ...]]  # array of a model, and index in it


def held_by(track: Track, model: mujoco.MjModel, states: States) -> list[Place]:
    """Inverse inertias that scale what holds something in any of `states`."""
    return [*_of_contacts(track, model, states), *_of_limits(model, states)]


def _of_contacts(track: Track, model: mujoco.MjModel, states: States) -> list[Place]:
    if not can_touch(model):
        return []
    data, geoms = mujoco.MjData(model), set[int]()
    for qpos in states.qpos[track.touching(states, model)]:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        geoms.update(data.contact.geom.ravel().tolist())
    bodies = {int(model.geom_bodyid[geom]) for geom in geoms if geom >= 0}
    return [("body_invweight0", (body, 0)) for body in sorted(bodies)]


def _of_limits(model: mujoco.MjModel, states: States) -> list[Place]:
    found: list[Place] = []
    for joint in np.flatnonzero(model.jnt_limited & ~np.isin(model.jnt_type, (FREE, BALL))):
        (low, high), margin = model.jnt_range[joint], model.jnt_margin[joint]
        turned = states.qpos[:, model.jnt_qposadr[joint]]
        if (turned < low + margin).any() or (turned > high - margin).any():
            found.append(("dof_invweight0", (int(model.jnt_dofadr[joint]),)))
    return found


def ratios(places: list[Place], after: mujoco.MjModel, before: mujoco.MjModel) -> dict[Place, float]:
    """By which share of itself each inverse inertia differs, where it does."""
    found = {}
    for name, index in places:
        own, other = float(getattr(before, name)[index]), float(getattr(after, name)[index])
        if own > 0 and other != own:
            found[name, index] = other / own - 1
    return found


def with_softer(model: mujoco.MjModel, place: Place) -> tuple[mujoco.MjModel, float]:
    """A copy of `model` with one inverse inertia larger, and by which share of it."""
    softer, (name, index) = copy.copy(model), place
    getattr(softer, name)[index] *= 1 + PART
    return softer, PART
