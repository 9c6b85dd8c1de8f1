"""Parameters and design to measurements, by `lax.scan` over `mjx.step`."""

from fimpact.paper.mjx.engine import mjx, smooth, support

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from fimpact.paper.systems.base import System

SEVERAL = [int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)]  # degrees of freedom
ONLY_SLIDES = 2  # MuJoCo's mark of a body whose joints all slide; it then weighs its mass alone


def rollout(system: System, model: mjx.Model, theta: jax.Array, design: jax.Array) -> jax.Array:
    """Simulate one open-loop experiment and return what is measured, (T, ny), in the sensor's unit.

    Args:
        model: `system.template`.
        theta: parameters, shape (p,), physical units.
        design: flat inputs, shape (knots * inputs,), in the units of `system.inputs`.
    """
    model = with_parameters(system, model, theta)
    qpos, qvel, ctrl = system.launch(system, design)
    start = mjx.make_data(model).replace(qpos=qpos, qvel=qvel)

    def advance(data: mjx.Data, u: jax.Array) -> tuple[mjx.Data, jax.Array]:
        after = mjx.step(model, data.replace(ctrl=u))
        return after, system.sense(model, after, data.qvel)

    return jax.lax.scan(advance, start, ctrl)[1]


def with_parameters(system: System, model: mjx.Model, theta: jax.Array) -> mjx.Model:
    """`model` with `theta` written in, and the inverse weights that MuJoCo C derives when it compiles."""
    model = system.revise(model, theta, system.settings)
    of_bodies, of_dofs = _inverse_weights(model)
    return model.replace(body_invweight0=of_bodies, dof_invweight0=of_dofs)


def _inverse_weights(model: mjx.Model) -> tuple[jax.Array, jax.Array]:
    # Contact softness scales with body_invweight0, that of joint limits and dry friction with dof_invweight0, which
    # mj_setConst would recompute after a change of theta.
    data = mjx.make_data(model).replace(qpos=model.qpos0)
    data = smooth.crb(model, smooth.com_pos(model, smooth.kinematics(model, data)))
    mass = support.full_m(model, data)

    def weights(body: int) -> jax.Array:
        if model.body_simple[body] == ONLY_SLIDES:
            return jnp.stack([1.0 / model.body_mass[body], jnp.zeros(())])
        jacobian = jnp.stack(support.jac(model, data, data.xipos[body], body))
        return jnp.einsum("aij,aij->a", jacobian, jnp.linalg.solve(mass, jacobian)) / 3.0

    own = jnp.diag(jnp.linalg.inv(mass))
    alike = jnp.asarray(average_of_joint(model))
    return jnp.stack([jnp.zeros(2)] + [weights(body) for body in range(1, model.nbody)]), alike @ own


def average_of_joint(model: mjx.Model) -> np.ndarray:
    """Average over the three translations of a free joint and the three rotations of a free or ball joint, (nv, nv)."""
    kind, joint = model.jnt_type[model.dof_jntid], model.dof_jntid
    turns = np.arange(model.nv) - model.jnt_dofadr[joint] >= 3
    together = (joint[:, None] == joint) & (turns[:, None] == turns) & np.isin(kind, SEVERAL)
    together |= np.eye(model.nv, dtype=bool)
    return together / together.sum(1, keepdims=True)
