"""Where something is, whatever it is called: an actuator is at its joint, a body's joint carries it."""

from collections.abc import Sequence

import mujoco
import numpy as np

ON_JOINT = mujoco.mjtTrn.mjTRN_JOINT


def places(model: mujoco.MjModel, channels: Sequence[str], site: str) -> set[str]:
    """Names that mean the place `site`: joints, contact pairs or channels; empty for what is everywhere."""
    names = _channels(channels, site)
    if names:
        return names
    site = site.partition("<-")[0]  # of a joint that a neighbour drags
    for find in (_joint, _actuator, _pair, _body):
        if found := find(model, site):
            return found
    return set()


def _channels(channels: Sequence[str], site: str) -> set[str]:
    return {channel for channel in channels if site in (channel, channel.partition("[")[0])}


def _id(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> int:
    return mujoco.mj_name2id(model, kind, name)


def _joint(model: mujoco.MjModel, site: str) -> set[str]:
    return {site} if _id(model, mujoco.mjtObj.mjOBJ_JOINT, site) >= 0 else set()


def _actuator(model: mujoco.MjModel, site: str) -> set[str]:
    which = _id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, site)
    known = which >= 0 and model.actuator_trntype[which] == ON_JOINT
    return {model.joint(model.actuator_trnid[which, 0]).name} if known else set()


def _pair(model: mujoco.MjModel, site: str) -> set[str]:
    """A contact pair itself, or all pairs of a geom."""
    if _id(model, mujoco.mjtObj.mjOBJ_PAIR, site) >= 0:
        return {site}
    geom = _id(model, mujoco.mjtObj.mjOBJ_GEOM, site)
    touching = (model.pair_geom1 == geom) | (model.pair_geom2 == geom)
    return {model.pair(i).name for i in np.flatnonzero(touching)} if geom >= 0 else set()


def _body(model: mujoco.MjModel, site: str) -> set[str]:
    """Joints of a body, or of the nearest body that carries it and moves."""
    body = _id(model, mujoco.mjtObj.mjOBJ_BODY, site)
    while body > 0 and not model.body_jntnum[body]:
        body = model.body_parentid[body]
    if body <= 0:
        return set()
    first = model.body_jntadr[body]
    return {model.joint(i).name for i in range(first, first + model.body_jntnum[body])}
