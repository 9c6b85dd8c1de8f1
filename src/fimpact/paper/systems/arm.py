"""Planar three-link arm in a horizontal plane, near a wall; the sensor is the contact force at its tip."""

from fimpact.paper.mjx.engine import mjx

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from fimpact.paper.mjx import sensors
from fimpact.paper.systems.base import Inputs, Sensor, System, interpolate, parameters

LINKS = (1, 2, 3)
NAMES = (*(f"inertia_{i}" for i in LINKS), *(f"length_{i}" for i in LINKS))
START = (-0.3, 0.9, 0.9)  # rad; the tip starts well clear of the wall


def arm(settings: dict) -> System:
    """Arm with unknown link inertias (kg m2, about each centre of mass) and link lengths (m)."""
    limit = np.full(len(LINKS), settings["inputs"]["torque"])
    return System(
        name="arm",
        settings=settings,
        parameters=parameters(settings["parameters"], NAMES),
        inputs=Inputs(
            tuple(f"torque_{i}" for i in LINKS), ("N m",) * len(LINKS), -limit, limit, settings["inputs"]["knots"]
        ),
        sensor=Sensor("contact force", "N", ("force_x", "force_y"), settings["noise"]),
        edit=edit,
        revise=revise,
        launch=launch,
        sense=sense,
        instrument=("force", (0, 1)),
    )


def rod_mass(inertia, length):
    """Mass of a uniform slender rod with this inertia about its centre: I = m L^2 / 12."""
    return 12.0 * inertia / length**2


def edit(spec: mujoco.MjSpec, theta: np.ndarray, settings: dict) -> None:
    """Write inertias, lengths, wall and contact softness into the MJCF."""
    inertia, length = theta[:3], theta[3:]
    for i, link in enumerate(LINKS):
        body = spec.body(f"link_{link}")
        body.mass, body.ipos = rod_mass(inertia[i], length[i]), [length[i] / 2, 0, 0]
        body.inertia = [1e-4, inertia[i], inertia[i]]
        spec.geom(f"rod_{link}").fromto = [0, 0, 0, length[i], 0, 0]
    spec.body("link_2").pos, spec.body("link_3").pos = [length[0], 0, 0], [length[1], 0, 0]
    spec.geom("tip").pos = [length[2], 0, 0]
    spec.geom("wall").pos = [0, settings["surface"], 0]
    contact, (pair,) = settings["contact"], spec.pairs
    pair.solref = [contact["timeconst"], contact["dampratio"]]
    pair.friction = [contact["friction"]] * 2 + list(pair.friction[2:])


def revise(model: mjx.Model, theta: jax.Array, settings: dict) -> mjx.Model:
    """The same parameters in an MJX model: every field that the lengths and inertias determine."""
    inertia, length = theta[:3], theta[3:]
    zero, thin = jnp.zeros(3), jnp.full(3, 1e-4)
    along = jnp.stack([length, zero, zero], 1)
    return model.replace(
        body_mass=model.body_mass.at[1:].set(rod_mass(inertia, length)),
        body_inertia=model.body_inertia.at[1:].set(jnp.stack([thin, inertia, inertia], 1)),
        body_ipos=model.body_ipos.at[1:].set(along / 2),
        body_pos=model.body_pos.at[2:].set(along[:2]),
        geom_pos=model.geom_pos.at[model.pair_geom2[0]].set(along[2]),
    )


def launch(system: System, design: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Start at rest at `START`; `design` holds the joint-torque knots in N m, shape (knots * 3,)."""
    torque = interpolate(design.reshape(-1, len(LINKS)), system.steps)
    return jnp.array(START), jnp.zeros(len(LINKS)), torque


def sense(model: mjx.Model, data: mjx.Data, velocity: jax.Array) -> jax.Array:
    """Contact force on the tip in the plane, shape (2,), N."""
    return sensors.contact_force(model, data, velocity, body=len(LINKS), axes=(0, 1))
