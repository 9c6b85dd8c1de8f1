"""What a mechanism stands on, where it gives: a springy mount that is tipped by all that it carries."""

from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.effects.law_inputs import State

LEVEL = [0, 1]  # axes of the world about which a mount tips
SAME = 1e-6  # of a decay: two that differ by less are told apart by it


@dataclass(frozen=True)
class Carried:
    """What a mount carries, in n states, about the mount's origin in axes of the world.

    momentum: angular, for each unit of speed, (n, 3, nv). inertia: (n, 3, 3). centre: Jacobian of the centre of mass,
    (n, 3, nv). lever: from the origin to that centre, (n, 3). mass: kg.
    """

    momentum: np.ndarray
    inertia: np.ndarray
    centre: np.ndarray
    lever: np.ndarray
    mass: float


def tipping_mount(state: State, site: str, compliance, settling):
    """Force, (n, nv), where body `site` tips about its origin, in horizontal axes, by its weight and its momentum.

    Gravity then comes from another direction, and masses are left behind; a run begins where the mount holds the
    weight. What turns with the mount has no Coriolis force here, and what is of second order in its angle is left out.
    """
    compliance, settling = (np.reshape(value, (-1, 1)).astype(float) for value in (compliance, settling))
    if not compliance.any():
        return np.zeros_like(state.qvel)
    held = carried(state, site)
    weight = held.mass * across(state.model.opt.gravity)  # of what leans by so much, and its moment at such a lever
    weighs = held.lever @ weight
    state.memory.setdefault(("tip", site), (compliance * weighs[:, LEVEL], np.zeros((len(weighs), len(LEVEL)))))
    moment = weighs - spun(state, site, held.momentum)
    turn, gathers = tipped(state, site, held.inertia, moment, compliance, settling)
    return -np.einsum("niv,ni->nv", held.momentum, gathers) - np.einsum("niv,ni->nv", held.centre, turn @ weight)


def across(vector: np.ndarray) -> np.ndarray:
    """The matrix, (3, 3), by which rows are multiplied for their cross product with `vector` (3,)."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def carried(state: State, site: str) -> Carried:
    """All that stands on body `site` of the world, itself too."""
    model, data, n = state.model, state.kinematics, len(state.qpos)
    base = model.body(site).id
    mass = float(model.body_subtreemass[base])
    momentum, centre, own = np.empty((n, 3, model.nv)), np.empty((n, 3, model.nv)), np.zeros((3, model.nv))
    inertia, lever = np.empty((n, 3, 3)), np.empty((n, 3))
    for k, qpos in enumerate(state.qpos):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        xx, yy, zz, xy, xz, yz = data.crb[base, :6].tolist()
        lever[k] = data.subtree_com[base] - data.xpos[base]
        apart = across(lever[k])
        inertia[k] = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - mass * apart @ apart
        mujoco.mj_angmomMat(model, data, own, base)
        momentum[k] = own
        mujoco.mj_jacSubtreeCom(model, data, own, base)
        centre[k] = own
        momentum[k] += mass * apart @ own
    return Carried(momentum, inertia, centre, lever, mass)


def spun(state: State, site: str, momentum: np.ndarray) -> np.ndarray:
    """Moment, (n, 3), that changes the angular momentum: in a step, or where accelerations are not known, since the
    step before."""
    last, state.memory["momentum", site] = state.memory.get(("momentum", site), momentum), momentum
    if state.qacc is not None:
        rate = np.einsum("niv,nv->ni", momentum, state.qacc)
        return rate + np.einsum("niv,nv->ni", momentum - last, state.qvel) / state.step
    speed, state.memory["speed", site] = state.memory.get(("speed", site), state.qvel), state.qvel.copy()
    spin, before = (np.einsum("niv,nv->ni", own, v) for own, v in ((momentum, state.qvel), (last, speed)))
    return (spin - before) / state.step


def tipped(state: State, site: str, inertia, moment, compliance, settling) -> tuple[np.ndarray, np.ndarray]:
    """Mean angle, rad, and mean angular acceleration of a mount over a step, (n, 3) each.

    About each principal axis of what it carries it swings by itself, I d²θ/dt² + (T dθ/dt + θ) / C = moment, here
    solved for a moment that is held over the step.
    """
    moment = moment[:, LEVEL]
    sizes, axes = np.linalg.eigh(inertia[:, LEVEL][:, :, LEVEL])
    now = moment * compliance, *state.memory["tip", site]
    rests, angle, speed = ((own[:, None] @ axes)[:, 0] for own in now)
    # In two decays, which may be complex, from where it is to where it would rest.
    apart = np.sqrt((settling + 0j) ** 2 - 4 * sizes * compliance)
    apart = np.where(abs(apart) < SAME * settling, SAME * settling, apart)
    slow, quick = ((way * apart - settling) / (2 * sizes * compliance) for way in (1, -1))
    begins = (slow * (angle - rests) - speed) / (slow - quick)
    begins = angle - rests - begins, begins
    ends = [way * np.exp(own * state.step) for way, own in zip(begins, (slow, quick), strict=True)]
    mean = rests + ((ends[0] - begins[0]) / slow + (ends[1] - begins[1]) / quick).real / state.step
    after, faster = rests + (ends[0] + ends[1]).real, (slow * ends[0] + quick * ends[1]).real
    back = axes.swapaxes(1, 2)
    state.memory["tip", site] = tuple((own[:, None] @ back)[:, 0] for own in (after, faster))
    found = np.zeros((2, len(moment), 3))
    found[0][:, LEVEL], found[1][:, LEVEL] = (
        (own[:, None] @ back)[:, 0] for own in (mean, (faster - speed) / state.step)
    )
    return found[0], found[1]
