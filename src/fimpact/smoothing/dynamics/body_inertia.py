"""Inertia of bodies: the parameters by which forces are linear, and the matrices that multiply them."""

import mujoco
import numpy as np


def carried_bodies(model: mujoco.MjModel, body: int) -> np.ndarray:
    """Which bodies hang on `body`, itself among them, (nb,)."""
    out = np.zeros(model.nbody, bool)
    out[body] = True
    for own in range(body + 1, model.nbody):
        out[own] = out[model.body_parentid[own]]
    return out


def inertial_parameters(model: mujoco.MjModel, body: int) -> np.ndarray:
    """Mass, first moments and moments of inertia about the body's origin, (10,), in its axes."""
    turned, mass, centre = np.empty(9), model.body_mass[body], model.body_ipos[body]
    mujoco.mju_quat2Mat(turned, model.body_iquat[body])
    axes = turned.reshape(3, 3)
    full = axes * model.body_inertia[body] @ axes.T
    full = full + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return np.array([mass, *(mass * centre), *np.diag(full), full[0, 1], full[0, 2], full[1, 2]])


def cross_matrix(rows: np.ndarray) -> np.ndarray:
    """Matrices, (N, 3, 3), of the cross product with each of `rows`, (N, 3)."""
    out = np.zeros((len(rows), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -rows[:, 2], rows[:, 1], -rows[:, 0]
    return out - out.swapaxes(1, 2)


def by_moments(rows: np.ndarray) -> np.ndarray:
    """Inertia times each of `rows` as a matrix, (N, 3, 6), of its moments xx, yy, zz, xy, xz, yz."""
    x, y, z = rows.T
    none = np.zeros_like(x)
    return np.array([[x, none, none, y, z, none], [none, y, none, x, none, z], [none, none, z, none, x, y]]).transpose(
        2, 0, 1
    )
