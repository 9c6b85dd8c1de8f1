"""Planar block thrown onto a mat; the sensor is an accelerometer in its centre."""

from fimpact.paper.mjx.engine import mjx

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from fimpact.paper.mjx import sensors
from fimpact.paper.systems.base import Inputs, Sensor, System, parameters

DEPTH = 0.06  # m, across the plane of motion; known, and without effect on the motion
CORNER_SIGNS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]], float)
THROW = ("pitch", "speed_x", "speed_z", "spin")
UNITS = ("rad", "m/s", "m/s", "rad/s")
IMU_BODY = 1
NAMES = ("mass", "width", "height")


def block(settings: dict) -> System:
    """Block with unknown mass (kg), width and height (m); the throw is its initial pitch and velocities."""
    limits = np.array([settings["inputs"][name] for name in THROW])
    return System(
        name="block",
        settings=settings,
        parameters=parameters(settings["parameters"], NAMES),
        inputs=Inputs(THROW, UNITS, limits[:, 0], limits[:, 1], 1),
        sensor=Sensor("accelerometer", "m/s^2", ("acceleration_x", "acceleration_z"), settings["noise"]),
        edit=edit,
        revise=revise,
        launch=launch,
        sense=sense,
        instrument=("imu", (0, 2)),
    )


def edit(spec: mujoco.MjSpec, theta: np.ndarray, settings: dict) -> None:
    """Write mass, width, height, mat height and mat stiffness into the MJCF."""
    mass, width, height = theta
    body, contact = spec.body("block"), settings["contact"]
    body.mass = mass
    body.inertia = mass / 12 * np.array([height**2 + DEPTH**2, width**2 + height**2, width**2 + DEPTH**2])
    spec.geom("body").size = [width / 2, DEPTH / 2, height / 2]
    radius = spec.geom("corner_1").size[0]
    for number, (sign_x, sign_z) in enumerate(CORNER_SIGNS, 1):
        spec.geom(f"corner_{number}").pos = [sign_x * (width / 2 - radius), 0, sign_z * (height / 2 - radius)]
    spec.geom("mat").pos = [0, 0, settings["surface"]]
    for pair in spec.pairs:
        # MuJoCo's direct solref is per unit mass; dividing by the mass gives a mat of k N/m and c N s/m.
        pair.solref = [-contact["stiffness"] / mass, -contact["damping"] / mass]
        pair.friction = [contact["friction"]] * 2 + list(pair.friction[2:])


def revise(model: mjx.Model, theta: jax.Array, settings: dict) -> mjx.Model:
    """The same parameters in an MJX model."""
    mass, width, height = theta
    contact, radius = settings["contact"], model.geom_size[model.pair_geom2[0], 0]
    offset = jnp.array([width / 2 - radius, height / 2 - radius]) * CORNER_SIGNS
    corners = jnp.stack([offset[:, 0], jnp.zeros(4), offset[:, 1]], 1)
    solref = jnp.array([-contact["stiffness"], -contact["damping"]]) / mass
    inertia = mass / 12 * jnp.array([height**2 + DEPTH**2, width**2 + height**2, width**2 + DEPTH**2])
    return model.replace(
        body_mass=model.body_mass.at[1].set(mass),
        body_inertia=model.body_inertia.at[1].set(inertia),
        geom_pos=model.geom_pos.at[model.pair_geom2].set(corners),
        pair_solref=jnp.broadcast_to(solref, model.pair_solref.shape),
    )


def launch(system: System, design: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Released at the origin with the designed pitch (rad), velocities (m/s) and spin (rad/s); no control."""
    pitch, speed_x, speed_z, spin = design
    return jnp.array([0.0, 0.0, pitch]), jnp.array([speed_x, speed_z, spin]), jnp.zeros((system.steps, 0))


def sense(model: mjx.Model, data: mjx.Data, velocity: jax.Array) -> jax.Array:
    """Proper acceleration of the block's centre in its own axes, shape (2,), m/s^2."""
    return sensors.accelerometer(model, data, velocity, body=IMU_BODY, axes=(0, 2))
