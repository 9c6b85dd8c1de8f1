"""Parameters and design to states and measurements, by `lax.scan` over `mjx.step`."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from fimpact.engine import mjx, smooth, support
from fimpact.systems.base import System

ONLY_SLIDES = 2  # MuJoCo's mark of a body whose joints all slide; it then weighs its mass alone


class Rollout(NamedTuple):
    """One experiment: qpos (T, nq), qvel (T, nv), measurement (T, ny), contact distance (T, ncon) in m."""

    qpos: jax.Array
    qvel: jax.Array
    measurement: jax.Array
    distance: jax.Array


def rollout(system: System, model: mjx.Model, theta: jax.Array, design: jax.Array) -> Rollout:
    """Simulate one open-loop experiment.

    Args:
        model: `system.template`, or a variant of it with relaxed or removed contact.
        theta: parameters, shape (p,), physical units.
        design: flat inputs, shape (knots * inputs,), in the units of `system.inputs`.
    """
    model = with_parameters(system, model, theta)
    qpos, qvel, ctrl = system.launch(system, design)
    start = mjx.make_data(model).replace(qpos=qpos, qvel=qvel)

    def advance(data: mjx.Data, u: jax.Array) -> tuple[mjx.Data, Rollout]:
        after = mjx.step(model, data.replace(ctrl=u))
        y = system.sense(model, after, data.qvel)
        return after, Rollout(data.qpos, data.qvel, y, after._impl.contact.dist)

    return jax.lax.scan(advance, start, ctrl)[1]


def with_parameters(system: System, model: mjx.Model, theta: jax.Array) -> mjx.Model:
    """`model` with `theta` written in, and the inverse weights that MuJoCo C derives when it compiles."""
    model = system.revise(model, theta, system.settings)
    return model.replace(body_invweight0=_inverse_weights(model))


def _inverse_weights(model: mjx.Model) -> jax.Array:
    # Contact softness scales with body_invweight0, which mj_setConst would recompute after a change of theta.
    data = mjx.make_data(model).replace(qpos=model.qpos0)
    data = smooth.crb(model, smooth.com_pos(model, smooth.kinematics(model, data)))
    mass = support.full_m(model, data)

    def weights(body: int) -> jax.Array:
        if model.body_simple[body] == ONLY_SLIDES:
            return jnp.stack([1.0 / model.body_mass[body], jnp.zeros(())])
        jacobian = jnp.stack(support.jac(model, data, data.xipos[body], body))
        return jnp.einsum("aij,aij->a", jacobian, jnp.linalg.solve(mass, jacobian)) / 3.0

    return jnp.stack([jnp.zeros(2)] + [weights(body) for body in range(1, model.nbody)])


def remove_contact(model: mjx.Model) -> mjx.Model:
    """The same program with contact that never acts: what a contact-blind designer believes."""
    return model.replace(pair_margin=jnp.full_like(model.pair_margin, -1e3))
