"""Rigid-body terms of the planar systems as CasADi expressions.

Only numbers that the parameters do not touch (damping, gravity, radii) are read off the compiled MJCF.
`tests/paper/test_contact_implicit.py` holds them to MuJoCo.
"""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from fimpact.paper.systems.base import System


@dataclass(frozen=True)
class Terms:
    """One configuration's dynamics: M (nv, nv), generalised force without contact (nv,), gap of every contact (nc,) m,
    and the Jacobians of gap and slip (nc, nv)."""

    mass: ca.SX
    force: ca.SX
    gap: ca.SX
    normal: ca.SX
    tangent: ca.SX


@dataclass(frozen=True)
class Planar:
    """What transcription needs of a system: `terms` of (qpos, qvel, theta), `sense` of (qpos, qacc, normal and
    tangential contact forces), sizes, and sliding friction."""

    terms: Callable[[ca.SX, ca.SX, ca.SX], Terms]
    sense: Callable[[ca.SX, ca.SX, ca.SX, ca.SX], ca.SX]
    dofs: int
    contacts: int
    friction: float


def arm(system: System) -> Planar:
    """Three rods whose tip meets a wall along x; the normal force is along -y."""
    model, surface = system.compile(system.nominal), system.settings["surface"]
    radius, damping = float(model.geom("tip").size[0]), model.dof_damping.tolist()

    def terms(q: ca.SX, v: ca.SX, theta: ca.SX) -> Terms:
        inertia, length = theta[:3], theta[3:]
        mass, damped = 12 * inertia / length**2, ca.DM(damping) * v
        beyond = ca.vertcat(mass[1] + mass[2], mass[2], 0)  # the mass that each link carries at its end
        own = inertia + length**2 * (mass / 4 + beyond)
        lever = length * (mass / 2 + beyond)
        angle, speed = ca.cumsum(q), ca.cumsum(v)
        turning, push = ca.diag(own), ca.SX.zeros(3)  # of the links' own angles
        for i, k in ((0, 1), (1, 2), (0, 2)):
            between, shared = ca.sum1(q[i + 1 : k + 1]), length[i] * lever[k]
            turning[i, k] = turning[k, i] = shared * ca.cos(between)
            push[i] += shared * ca.sin(between) * speed[k] ** 2
            push[k] -= shared * ca.sin(between) * speed[i] ** 2
        each = ca.SX(np.tril(np.ones((3, 3))))  # d angle / d q
        rise, reach = length * ca.sin(angle), length * ca.cos(angle)
        gap, normal = surface - radius - ca.sum1(rise), -reach.T @ each
        # The point of the tip nearest to the wall, fixed to the last link, slides as the tip does less its turning.
        slip = -rise.T @ each - radius
        return Terms(each.T @ turning @ each, each.T @ push - damped, gap, normal, slip)

    def sense(q: ca.SX, acceleration: ca.SX, normal: ca.SX, tangent: ca.SX) -> ca.SX:
        return ca.vertcat(tangent, -normal)

    return Planar(terms, sense, 3, 1, system.settings["contact"]["friction"])


def block(system: System) -> Planar:
    """A block in x, z and pitch about y, whose four round corners meet a mat below."""
    model, surface = system.compile(system.nominal), system.settings["surface"]
    radius = float(model.geom("corner_1").size[0])
    gravity = float(-model.opt.gravity[2])
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))

    def terms(q: ca.SX, v: ca.SX, theta: ca.SX) -> Terms:
        mass, width, height = theta[0], theta[1], theta[2]
        turning = mass / 12 * (width**2 + height**2)
        cos, sin = ca.cos(q[2]), ca.sin(q[2])
        right = ca.vertcat(*(i * (width / 2 - radius) for i, _ in signs))
        up = ca.vertcat(*(k * (height / 2 - radius) for _, k in signs))
        below = -right * sin + up * cos - radius  # of the lowest point of each corner, from the centre
        beside = right * cos + up * sin
        one, none = ca.DM.ones(4), ca.DM.zeros(4)
        normal, tangent = ca.horzcat(none, one, -beside), ca.horzcat(one, none, below)
        push = ca.vertcat(0, -mass * gravity, 0)
        return Terms(ca.diag(ca.vertcat(mass, mass, turning)), push, q[1] + below - surface, normal, tangent)

    def sense(q: ca.SX, acceleration: ca.SX, normal: ca.SX, tangent: ca.SX) -> ca.SX:
        cos, sin, felt = ca.cos(q[2]), ca.sin(q[2]), acceleration[1] + gravity
        return ca.vertcat(cos * acceleration[0] - sin * felt, sin * acceleration[0] + cos * felt)

    return Planar(terms, sense, 3, 4, system.settings["contact"]["friction"])


PLANAR: dict[str, Callable[[System], Planar]] = {"arm": arm, "block": block}
