"""Springs and cables that the model does not know, and the way the whole stands."""

import mujoco
import numpy as np

from fimpact.effects import priors, sites, typical, wiring
from fimpact.effects.base import STRUCTURE, Coefficient, Effect
from fimpact.effects.law_inputs import State
from fimpact.effects.mounts import tipping_mount
from fimpact.effects.native import exporting

DOWN = np.array([0.0, 0.0, -9.81])  # m/s^2, for a model without gravity: a mechanism that lies in a horizontal plane
RESTS = (-4.0, -1.0, 0.0, 1.0, 4.0)  # of a joint's travel, from its mean position
CABLE = 3.0  # times the size of the mechanism: from further away a cable pulls at all of it alike, as gravity does
TAKES = "hoses, cables and balance springs take at most some third of the torque"
SETTLING = (1e-3, 1e-2, 1e-1)  # s, in which a mount comes to rest: of castings, of frames, of rubber
ALONG = 0.7  # cosine above which an axis counts as parallel


def spring(model, site, stiffness, rest):
    """Beside the joint's own spring: both together are one, at a rest position between."""
    joint = model.joint(site)
    own, place = model.jnt_stiffness[joint.id], joint.qposadr[0]
    total = own + stiffness
    if stiffness:
        model.qpos_spring[place] = (own * model.qpos_spring[place] + stiffness * rest) / total
        model.jnt_stiffness[joint.id] = total


def hardening_spring(model, site, cubic):
    """MuJoCo's third-order stiffness."""
    model.jnt_stiffnesspoly[model.joint(site).id, 1] += cubic


def cable_pull(state: State, site, stiffness, anchor_x, anchor_y, anchor_z):
    """A tendon of no length between a point of the world and the body's centre of mass."""
    position, _, jacobian = state.body(site)
    return np.einsum("nij,ni->nj", jacobian, -stiffness * (position - [anchor_x, anchor_y, anchor_z]))


def gravity_tilt(model, site, tilt_x, tilt_y, tilt_z):
    """Gravity turns by a rotation vector in world axes; the turned minus the upright one is added."""
    upright = model.opt.gravity.copy() if np.any(model.opt.gravity) else DOWN
    model.opt.gravity += turned(upright, np.array([tilt_x, tilt_y, tilt_z])) - upright


def turned(vector: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """`vector` (3,) rotated by the rotation vector `rotation` (3,), rad."""
    out = np.empty(3)
    mujoco.mju_rotVecQuat(out, vector, quaternion(rotation))
    return out


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternion, (4,), of the rotation vector `rotation` (3,), rad."""
    out = np.array([1.0, 0.0, 0.0, 0.0])
    mujoco.mju_quatIntegrate(out, np.asarray(rotation, float), 1.0)
    return out


def _export_cable(spec, site, stiffness, anchor_x, anchor_y, anchor_z):
    body, name = spec.body(site), _free_name(spec, f"cable_{site}")
    centre = spec.compile().body_ipos[body.id]
    spec.worldbody.add_site(name=f"{name}_post", pos=[anchor_x, anchor_y, anchor_z])
    body.add_site(name=f"{name}_end", pos=centre)
    tendon = spec.add_tendon(name=name, stiffness=[stiffness, 0, 0], springlength=[0, 0])
    tendon.wrap_site(f"{name}_post")
    tendon.wrap_site(f"{name}_end")


def _free_name(spec, name: str) -> str:
    taken = {tendon.name for tendon in spec.tendons}
    return next(n for n in (name, *(f"{name}_{i}" for i in range(len(taken)))) if n not in taken)


def _spring_probes(scales, model, site):
    travel = typical.travel(scales, model, site)
    stiffness = typical.SMALL * typical.force(scales, model, site) / travel
    middle, sizes = typical.mean_position(scales, model, site), map(float, np.hypot(1, RESTS))
    # From a nearly constant pull over one that changes sign on the way to its opposite: rests between add up to these.
    return [{"stiffness": stiffness / n, "rest": middle + far * travel} for far, n in zip(RESTS, sizes, strict=True)]


def _rests(scales, model, site):
    """No hinge is further from any angle than half a turn, and no slide from any place than the mechanism is long."""
    half = np.pi if model.joint(site).type[0] == wiring.HINGE else scales.length
    middle = typical.mean_position(scales, model, site)
    far = max(half, max(RESTS) * typical.travel(scales, model, site))
    return {"rest": (middle - far, middle + far)}


def _hardening_probes(scales, model, site):
    return [{"cubic": typical.SMALL * typical.force(scales, model, site) / typical.stretch(scales, model, site) ** 3}]


def _cable_probes(scales, model, site):
    stiffness = typical.SMALL * typical.max_force(scales, model) / scales.length
    centre = typical.reference(model, site)[0]
    ways = [side * np.eye(3)[axis] for axis in typical.directions(model) for side in (-1, 1)]
    anchors = [centre + scales.length * way for way in ways]
    names = ("anchor_x", "anchor_y", "anchor_z")
    return [{"stiffness": stiffness, **dict(zip(names, map(float, anchor), strict=True))} for anchor in anchors]


def _anchors(scales, model, site):
    centre, far = typical.reference(model, site)[0], CABLE * scales.length
    return {f"anchor_{axis}": (x - far, x + far) for axis, x in zip("xyz", map(float, centre), strict=True)}


def _tilt_probes(scales, model, site):
    down = model.opt.gravity / np.linalg.norm(model.opt.gravity) if np.any(model.opt.gravity) else DOWN / 9.81
    axes, across = [axis for axis in range(3) if abs(down[axis]) < ALONG], typical.normal(model)
    if across is not None and abs(across @ down) < ALONG:
        axes = [int(np.argmax(np.abs(across)))]
    still = {"tilt_x": 0.0, "tilt_y": 0.0, "tilt_z": 0.0}
    return [still | {f"tilt_{'xyz'[axis]}": typical.SMALL / 2} for axis in axes]


def _base_probes(scales, model, site):
    """From a stiff stand to one on rubber."""
    compliance = typical.SMALL * priors.base_compliance(scales, model, site)["compliance"]
    return [{"compliance": compliance, "settling": settling} for settling in SETTLING]


EFFECTS = (
    Effect(
        name="spring",
        family="structure",
        equation="τ = −k (q − q₀)",
        sentence="Something elastic pulls the joint to a rest position: a hose, a cable loop, a balance spring.",
        reference="Siciliano, Khatib (eds.), Springer Handbook of Robotics, 2016, ch. 6",
        enters="model",
        coefficients=(Coefficient("stiffness", "N m/rad", low=0.0), Coefficient("rest", "rad", shape=True)),
        sites=sites.joints,
        probes=_spring_probes,
        law=spring,
        neutral={"stiffness": 0.0, "rest": 0.0},
        export=exporting(spring),
        ranges=_rests,
        prior=priors.spring("stiffness", 1),
        prior_source=TAKES,
        order=STRUCTURE,
    ),
    Effect(
        name="hardening_spring",
        family="structure",
        equation="τ = −k₃ (q − q_rest)³, with the joint's own rest position",
        sentence="A spring that stiffens as it is stretched, as hoses and rubber do.",
        reference="Kovacic, Brennan, The Duffing Equation, Wiley 2011",
        enters="model",
        coefficients=(Coefficient("cubic", "N m/rad³", low=0.0),),
        sites=sites.joints,
        probes=_hardening_probes,
        law=hardening_spring,
        neutral={"cubic": 0.0},
        export=exporting(hardening_spring),
        prior=priors.spring("cubic", 3),
        prior_source=TAKES,
        order=STRUCTURE,
    ),
    Effect(
        name="cable_pull",
        family="structure",
        equation="F = −k (x − a) at the body's centre of mass x, a fixed in the world",
        sentence="An elastic cable or hose from a fixed point pulls at the link.",
        reference="MuJoCo documentation, XML reference, tendon/spatial",
        enters="force",
        coefficients=(
            Coefficient("stiffness", "N/m", low=0.0),
            Coefficient("anchor_x", "m", shape=True),
            Coefficient("anchor_y", "m", shape=True),
            Coefficient("anchor_z", "m", shape=True),
        ),
        sites=sites.bodies,
        probes=_cable_probes,
        law=cable_pull,
        neutral={"stiffness": 0.0, "anchor_x": 0.0, "anchor_y": 0.0, "anchor_z": 0.0},
        export=_export_cable,
        ranges=_anchors,
        prior=priors.cable,
        prior_source=TAKES,
        order=STRUCTURE,
    ),
    Effect(
        name="gravity_tilt",
        family="structure",
        equation="g' = g + (R(tilt) − 1) g₀,  g₀ = g, or 9.81 m/s² along −z where the model has none",
        sentence="The base does not stand level, so gravity comes from a slightly different direction.",
        reference="Siciliano, Khatib (eds.), Springer Handbook of Robotics, 2016, ch. 6",
        enters="model",
        coefficients=tuple(Coefficient(f"tilt_{axis}", "rad", low=-1.6, high=1.6) for axis in "xyz"),
        sites=sites.world,
        probes=_tilt_probes,
        law=gravity_tilt,
        neutral={"tilt_x": 0.0, "tilt_y": 0.0, "tilt_z": 0.0},
        export=exporting(gravity_tilt),
        prior=priors.fixed(tilt_x=0.03, tilt_y=0.03, tilt_z=0.03),
        prior_source="floors and tables are level to 1 or 2 degrees",
        order=STRUCTURE,
    ),
    Effect(
        name="base_gives_way",
        family="structure",
        equation="I θ̈ + (T θ̇ + θ)/C = moment of all that stands on it,  τ = −Lᵀ θ̈ − Jᵀ M (θ × g), θ horizontal",
        sentence="The base is not rigid: the weight and the momentum of the mechanism tip it, and it swings back.",
        reference="Siciliano, Khatib (eds.), Springer Handbook of Robotics, 2016, ch. 11",
        enters="force",
        coefficients=(
            Coefficient("compliance", "rad/(N m)", low=0.0),
            Coefficient("settling", "s", low=0.0, shape=True),
        ),
        sites=sites.standing,
        probes=_base_probes,
        law=tipping_mount,
        neutral={"compliance": 0.0, "settling": 1.0},
        side_by_side=True,
        prior=priors.base_compliance,
        prior_source="mounts that give visibly, by half a degree under the weight stretched out, get stiffened",
        order=STRUCTURE,
    ),
)
