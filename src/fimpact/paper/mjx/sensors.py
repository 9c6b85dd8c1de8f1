"""The paper's two sensor equations, on the data that `mjx.step` leaves behind.

After a step from x_i to x_{i+1} the data hold positions, mass matrix, bias and constraint forces at x_i,
and qpos and qvel at x_{i+1}; `velocity` is qvel at x_i.
"""

from fimpact.paper.mjx.engine import mjx, support

import jax
import jax.numpy as jnp

REGULARISER = 1e-9  # m^2; far below J_c J_c' away from a stretched arm, and keeps a stretched one finite


def contact_force(model: mjx.Model, data: mjx.Data, velocity: jax.Array, body: int, axes: tuple[int, ...]) -> jax.Array:
    """Contact force g = (J_c J_c')^-1 J_c (M qacc + b - u), qacc by finite difference.

    J_c is the Jacobian of the (nearest) contact point fixed to `body`, restricted to the world `axes`.
    Returns the force on the body, shape (len(axes),), N. Source: the paper's arm sensor.
    """
    jacobian = support.jac(model, data, data._impl.contact.pos[0], body)[0].T[jnp.array(axes)]
    acceleration = (data.qvel - velocity) / model.opt.timestep
    bias = data.qfrc_bias - data.qfrc_passive
    torque = support.full_m(model, data) @ acceleration + bias - data.qfrc_actuator - data.qfrc_applied
    gram = jacobian @ jacobian.T + REGULARISER * jnp.eye(len(axes))
    return jnp.linalg.solve(gram, jacobian @ torque)


def accelerometer(model: mjx.Model, data: mjx.Data, velocity: jax.Array, body: int, axes: tuple[int, ...]) -> jax.Array:
    """Acceleration g = Jdot_g qvel + J_g M^-1 (J_c' lambda - b + u) of a body's frame, less gravity.

    An accelerometer feels everything but gravity, and reads it in its own axes: the paper's coordinate
    acceleration is shifted by gravity and rotated into the body. Returns shape (len(axes),), m/s^2.
    """
    point = data.xpos[body]
    jacobian = support.jac(model, data, point, body)[0].T
    jacobian_dot = support.jac_dot(model, data, point, body)[0].T
    bias = data.qfrc_bias - data.qfrc_passive
    force = data.qfrc_constraint - bias + data.qfrc_actuator + data.qfrc_applied
    acceleration = jacobian_dot @ velocity + jacobian @ jnp.linalg.solve(support.full_m(model, data), force)
    return (data.xmat[body].T @ (acceleration - model.opt.gravity))[jnp.array(axes)]
