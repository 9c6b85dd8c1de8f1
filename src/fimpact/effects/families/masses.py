"""Masses: more of it than the model knows, or in another place."""

import mujoco
import numpy as np

from fimpact.effects import priors, sites, typical
from fimpact.effects.base import RIGID_BODIES, Coefficient, Effect
from fimpact.effects.native import exporting
from fimpact.effects.typical import MOMENTS, second_moments

INERTIAL = "Atkeson, An, Hollerbach, Int. J. Robotics Research 5(3), 1986"
CONSISTENT = "Wensing, Kim, Slotine, IEEE Robotics and Automation Letters 3(1), 2018"
DRAWN = "data sheets give masses to 20 %, centres of mass to a fifth of the body, moments of inertia to 30 %"
THINNEST = 1e-4  # least second moment, of the body's largest; least mass, of its own


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


def rigid_body(model, site, mass, x, y, z, **moments):
    """All ten inertial parameters: a mass spread as the model's is, a shift of the centre of mass in the body's axes,
    and a change of the second moments of mass about it, S = tr(I)/2 − I, along the model's principal axes of inertia.

    What no body can be is projected onto what one can: mass and second moments stay positive.
    """
    shift, change = np.array([x, y, z]), np.array([moments[name] for name in MOMENTS])
    if not (mass or shift.any() or change.any()):
        return
    body = model.body(site).id
    own, axes = model.body_mass[body], _axes(model, body)
    before = second_moments(model.body_inertia[body])
    total = max(own + mass, THINNEST * own)
    # A model at the border, as a rod without thickness, may stay there.
    least = min(THINNEST * before.max(), before.min())
    spread = _at_least(np.diag(before * total / own) + _symmetric(change), least)
    model.body_mass[body] = total
    model.body_ipos[body] += shift
    _set_inertia(model, body, axes @ (np.trace(spread) * np.eye(3) - spread) @ axes.T)


def _at_least(matrix: np.ndarray, least: float) -> np.ndarray:
    values, axes = np.linalg.eigh(matrix)
    return axes * np.maximum(values, least) @ axes.T


def _symmetric(entries: np.ndarray) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _axes(model, body: int) -> np.ndarray:
    """Principal axes of inertia, the columns of (3, 3), in the body's axes."""
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[body])
    return axes.reshape(3, 3)


def _outward(model, body: int) -> np.ndarray:
    centre = model.body_ipos[body]
    far = np.linalg.norm(centre)
    return centre / far if far > 1e-6 else np.array([1.0, 0.0, 0.0])


def _full_inertia(model, body: int) -> np.ndarray:
    axes = _axes(model, body)
    return axes * model.body_inertia[body] @ axes.T


def _set_inertia(model, body: int, full: np.ndarray) -> None:
    moments, axes = np.linalg.eigh(full)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    # MuJoCo lists principal moments from large to small; reversing the axes would mirror them, so turn one round.
    moments, axes = moments[::-1], axes[:, ::-1] * [1, -1, 1]
    model.body_inertia[body] = moments
    mujoco.mju_mat2Quat(model.body_iquat[body], axes.flatten())


def _payload_probes(scales, model, site):
    far = _end(scales, model, site)
    return [{"mass": typical.SMALL * scales.mass, "place": place} for place in (far / 2, far)]


def _end(scales, model, site) -> float:
    """How far a body reaches, as if it were a rod."""
    centre = np.linalg.norm(model.body(site).ipos)
    return 2 * float(centre) if centre > 1e-6 else scales.length / 4


def _carried(scales, model, site):
    """From where the body begins to half as far again as it reaches, where a tool holds what it holds."""
    return {"place": (0.0, 1.5 * _end(scales, model, site))}


def _com_probes(scales, model, site):
    still = dict.fromkeys("xyz", 0.0)
    moving = typical.directions(model, typical.reference(model, site)[1])
    return [still | {"xyz"[axis]: typical.SMALL / 2 * scales.length} for axis in moving]


def _rigid_probes(scales, model, site):
    """Of a planar mechanism only what moves: one second moment in the plane stands for both."""
    axes, sizes = typical.directions(model, typical.reference(model, site)[1]), priors.rigid_body(scales, model, site)
    seen = ["mass", *("xyz"[axis] for axis in axes), *(MOMENTS if len(axes) == 3 else [_largest(model, site)])]
    none = dict.fromkeys(sizes, 0.0)
    return [none | {name: typical.SMALL * sizes[name]} for name in seen]


def _largest(model, site) -> str:
    """The largest second moment in the plane of a planar mechanism."""
    body = model.body(site).id
    plane = typical.directions(model, typical.reference(model, site)[1] @ _axes(model, body))
    return MOMENTS[max(plane, key=lambda axis: second_moments(model.body_inertia[body])[axis])]


EFFECTS = (
    Effect(
        name="rigid_body",
        family="structure",
        equation="m' = m + Δm,  c' = c + (x, y, z),  S' = (m'/m) S + ΔS about c',  I = tr(S) − S",
        sentence="Mass, centre of mass and inertia of the body together are not those of its drawing.",
        reference=CONSISTENT,
        enters="model",
        coefficients=(
            Coefficient("mass", "kg"),
            *(Coefficient(axis, "m") for axis in "xyz"),
            *(Coefficient(name, "kg m²") for name in MOMENTS),
        ),
        sites=sites.bodies,
        probes=_rigid_probes,
        law=rigid_body,
        neutral=dict.fromkeys(("mass", *"xyz", *MOMENTS), 0.0),
        export=exporting(rigid_body),
        contains=("payload", "com_shift", "inertia"),
        prior=priors.rigid_body,
        prior_source=DRAWN,
        order=RIGID_BODIES,
    ),
    Effect(
        name="payload",
        family="structure",
        equation="m' = m + Δm, a point mass at distance r from the body's origin towards its centre of mass",
        sentence="The link carries a mass that the model does not have: a tool, a battery, a cable loom.",
        reference=INERTIAL,
        enters="model",
        coefficients=(Coefficient("mass", "kg", low=0.0), Coefficient("place", "m", shape=True, even=True)),
        sites=sites.bodies,
        probes=_payload_probes,
        law=payload,
        neutral={"mass": 0.0, "place": 0.0},
        export=exporting(payload),
        ranges=_carried,
        prior=priors.extra_mass,
        prior_source="tools, batteries and looms weigh up to as much as the link that carries them",
        order=RIGID_BODIES,
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
        prior=priors.shifts,
        prior_source=DRAWN,
        order=RIGID_BODIES,
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
        probes=lambda scales, model, site: [{"change": typical.SMALL}],
        law=inertia,
        neutral={"change": 0.0},
        export=exporting(inertia),
        prior=priors.fixed(change=0.3),
        prior_source=DRAWN,
        order=RIGID_BODIES,
    ),
)
