"""Masses: more of it than the model knows, or in another place."""

import mujoco
import numpy as np

from fimpact.effects import amounts, sites
from fimpact.effects.base import Coefficient, Effect
from fimpact.effects.native import exporting

INERTIAL = "Atkeson, An, Hollerbach, Int. J. Robotics Research 5(3), 1986"


def payload(model, site, mass, place):
    """A point mass joined to the body: parallel axes, then the principal axes of the sum."""
    if mass == 0:
        return
    body = model.body(site).id
    own, centre = model.body_mass[body], model.body_ipos[body].copy()
    total, spot = own + mass, place * _outward(model, body)
    between = spot - centre
    inertia = _full_inertia(model, body) + own * mass / total * (
        between @ between * np.eye(3) - np.outer(between, between)
    )
    model.body_mass[body], model.body_ipos[body] = total, centre + mass / total * between
    _set_inertia(model, body, inertia)


def com_shift(model, site, x, y, z):
    """The inertial frame moves in the body's axes."""
    model.body_ipos[model.body(site).id] += x, y, z


def inertia(model, site, change):
    """All three principal moments are scaled."""
    model.body_inertia[model.body(site).id] *= 1 + change


def _outward(model, body: int) -> np.ndarray:
    centre = model.body_ipos[body]
    far = np.linalg.norm(centre)
    return centre / far if far > 1e-6 else np.array([1.0, 0.0, 0.0])


def _full_inertia(model, body: int) -> np.ndarray:
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[body])
    axes = axes.reshape(3, 3)
    return axes * model.body_inertia[body] @ axes.T


def _set_inertia(model, body: int, full: np.ndarray) -> None:
    moments, axes = np.linalg.eigh(full)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    # MuJoCo lists principal moments from large to small; reversing the axes would mirror them, so turn one round.
    moments, axes = moments[::-1], axes[:, ::-1] * [1, -1, 1]
    model.body_inertia[body] = moments
    mujoco.mju_mat2Quat(model.body_iquat[body], axes.flatten())


def _payload_probes(scales, model, site):
    centre = np.linalg.norm(model.body(site).ipos)
    far = 2 * float(centre) if centre > 1e-6 else scales.length / 4
    return [{"mass": amounts.SMALL * scales.mass, "place": place} for place in (far / 2, far)]


def _com_probes(scales, model, site):
    still = dict.fromkeys("xyz", 0.0)
    moving = amounts.directions(model, amounts.reference(model, site)[1])
    return [still | {"xyz"[axis]: amounts.SMALL / 2 * scales.length} for axis in moving]


EFFECTS = (
    Effect(
        name="payload",
        family="structure",
        equation="m' = m + Δm, a point mass at distance r from the body's origin towards its centre of mass",
        sentence="The link carries a mass that the model does not have: a tool, a battery, a cable loom.",
        reference=INERTIAL,
        enters="model",
        coefficients=(Coefficient("mass", "kg", low=0.0), Coefficient("place", "m", shape=True)),
        sites=sites.bodies,
        probes=_payload_probes,
        law=payload,
        neutral={"mass": 0.0, "place": 0.0},
        export=exporting(payload),
    ),
    Effect(
        name="com_shift",
        family="structure",
        equation="c' = c + (x, y, z), in the body's frame",
        sentence="The body's centre of mass is not where the drawing puts it.",
        reference=INERTIAL,
        enters="model",
        coefficients=(Coefficient("x", "m"), Coefficient("y", "m"), Coefficient("z", "m")),
        sites=sites.bodies,
        probes=_com_probes,
        law=com_shift,
        neutral={"x": 0.0, "y": 0.0, "z": 0.0},
        export=exporting(com_shift),
    ),
    Effect(
        name="inertia",
        family="structure",
        equation="I' = (1 + ε) I, about the centre of mass",
        sentence="The body is harder or easier to spin than its mass suggests: its mass is spread differently.",
        reference=INERTIAL,
        enters="model",
        coefficients=(Coefficient("change", "1", low=-0.95, high=100.0),),
        sites=sites.bodies,
        probes=lambda scales, model, site: [{"change": amounts.SMALL}],
        law=inertia,
        neutral={"change": 0.0},
        export=exporting(inertia),
    ),
)
