"""The air, the ground and gravity around the mechanism."""

import mujoco
import numpy as np

from fimpact.effects import priors, sites, typical
from fimpact.effects.base import Coefficient, Effect
from fimpact.effects.families.structure import quaternion
from fimpact.effects.law_inputs import State
from fimpact.effects.native import exporting

NO_MIDPHASE = mujoco.mjtDisableBit.mjDSBL_MIDPHASE
LEVEL = "floors and tables are level to 1 or 2 degrees"
DRAG = "Batchelor, An Introduction to Fluid Dynamics, Cambridge University Press, 1967"
PLACE = "Pfrommer, Halm, Posa, ContactNets, CoRL 2020"


def linear_drag(state: State, site, coefficient):
    """A force against the velocity of the body's centre of mass."""
    _, velocity, jacobian = state.body(site)
    return np.einsum("nij,ni->nj", jacobian, -coefficient * velocity)


def quadratic_drag(state: State, site, coefficient):
    """A force against the velocity of the body's centre of mass, with the square of its size."""
    _, velocity, jacobian = state.body(site)
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    return np.einsum("nij,ni->nj", jacobian, -coefficient * speed * velocity)


def ground_height(model, site, height):
    """The geom moves along its own z axis, which is a plane's normal."""
    if height:
        geom = model.geom(site).id
        model.geom_pos[geom] += height * _axis(model, geom, 2)
        without_midphase(model)


def ground_tilt(model, site, tilt_x, tilt_y):
    """The geom turns about its own x and y axes, where it stands."""
    if tilt_x or tilt_y:
        geom, before = model.geom(site).id, model.geom(site).quat.copy()
        mujoco.mju_mulQuat(model.geom_quat[geom], before, quaternion(np.array([tilt_x, tilt_y, 0.0])))
        without_midphase(model)


def gravity_scale(model, site, change):
    """Gravity, or the length with which it is measured, is off by a factor."""
    model.opt.gravity *= 1 + change


def without_midphase(model) -> None:
    """A geom has moved: MuJoCo's tree of bounding boxes is that of the compiled model, and may miss contacts."""
    model.opt.disableflags |= NO_MIDPHASE


def _axis(model, geom: int, axis: int) -> np.ndarray:
    out = np.empty(3)
    mujoco.mju_rotVecQuat(out, np.eye(3)[axis], model.geom_quat[geom])
    return out


def _drag_probes(power):
    def probes(scales, model, site):
        size = typical.SMALL * typical.max_force(scales, model) / typical.max_speed(scales, model) ** power
        return [{"coefficient": size}]

    return probes


def _tilt_probes(scales, model, site):
    across, still = typical.normal(model), {"tilt_x": 0.0, "tilt_y": 0.0}
    row, data = model.geom(site), mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    axes = data.geom_xmat[row.id].reshape(3, 3)[:, :2]
    seen = (0, 1) if across is None else (int(np.argmax(np.abs(across @ axes))),)
    return [still | {f"tilt_{'xy'[axis]}": typical.SMALL / 2} for axis in seen]


EFFECTS = (
    Effect(
        name="linear_drag",
        family="environment",
        equation="F = −c v, at the body's centre of mass",
        sentence="A thick fluid or a dragging skirt brakes the body in proportion to its speed.",
        reference=DRAG,
        enters="force",
        coefficients=(Coefficient("coefficient", "N s/m", low=0.0),),
        sites=sites.bodies,
        probes=_drag_probes(1),
        law=linear_drag,
        neutral={"coefficient": 0.0},
        prior=priors.drag(1),
        prior_source="drag takes no more than the force applied, or nothing would move",
    ),
    Effect(
        name="quadratic_drag",
        family="environment",
        equation="F = −c |v| v, at the body's centre of mass",
        sentence="Air or water brakes the body with the square of its speed.",
        reference=DRAG,
        enters="force",
        coefficients=(Coefficient("coefficient", "N s²/m²", low=0.0),),
        sites=sites.bodies,
        probes=_drag_probes(2),
        law=quadratic_drag,
        neutral={"coefficient": 0.0},
        prior=priors.drag(2),
        prior_source="drag takes no more than the force applied, or nothing would move",
    ),
    Effect(
        name="ground_height",
        family="environment",
        equation="p' = p + h n",
        sentence="The surface lies further out along its normal (or, h < 0, further in) than the model says.",
        reference=PLACE,
        enters="model",
        coefficients=(Coefficient("height", "m"),),
        sites=sites.grounds,
        touching=True,
        probes=lambda scales, model, site: [{"height": typical.SMALL / 10 * scales.length}],
        law=ground_height,
        neutral={"height": 0.0},
        export=exporting(ground_height),
        prior=priors.of_length(height=0.01),
        prior_source="measured with a tape, to a hundredth of the mechanism's size",
    ),
    Effect(
        name="ground_tilt",
        family="environment",
        equation="R' = R R(tilt), about the surface's own x and y axes",
        sentence="The surface leans a little.",
        reference=PLACE,
        enters="model",
        coefficients=tuple(Coefficient(f"tilt_{axis}", "rad", low=-1.0, high=1.0) for axis in "xy"),
        sites=sites.grounds,
        touching=True,
        probes=_tilt_probes,
        law=ground_tilt,
        neutral={"tilt_x": 0.0, "tilt_y": 0.0},
        export=exporting(ground_tilt),
        prior=priors.fixed(tilt_x=0.03, tilt_y=0.03),
        prior_source=LEVEL,
    ),
    Effect(
        name="gravity_scale",
        family="environment",
        equation="g' = (1 + ε) g",
        sentence="Free fall is faster or slower than gravity says: a length scale or a clock is off.",
        reference=PLACE,
        enters="model",
        coefficients=(Coefficient("change", "1", low=-0.9, high=9.0, sd=0.1),),
        sites=sites.heavy,
        probes=lambda scales, model, site: [{"change": typical.SMALL / 2}],
        law=gravity_scale,
        neutral={"change": 0.0},
        export=exporting(gravity_scale),
        prior=priors.fixed(change=0.01),
        prior_source="gravity varies by .5 % on Earth, lengths and clocks are known to 1 %",
    ),
)
