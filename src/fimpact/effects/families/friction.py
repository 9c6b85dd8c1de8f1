"""Friction in joints: dry, viscous and everything between."""

import numpy as np

from fimpact.effects import priors, sites, typical, wiring
from fimpact.effects.base import FRICTION, Coefficient, Effect
from fimpact.effects.drives import motor_force
from fimpact.effects.law_inputs import State
from fimpact.effects.native import exact_dry_friction, exporting

MODELS = "Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994"
NO_MORE = "no more than the rms torque of the joint, or it would not move"
REMEMBERED = 0.1  # s: how long a joint that moves at the start of a run is taken to have moved already


def frictionloss(model, site, friction):
    """MuJoCo's dry friction, tight enough to turn over with the speed and to hold a resting joint."""
    dof = model.joint(site).dofadr[0]
    if friction:
        exact_dry_friction(model, dof)
    model.dof_frictionloss[dof] += friction


def viscous(model, site, damping):
    """MuJoCo's joint damping."""
    model.dof_damping[model.joint(site).dofadr[0]] += damping


def quadratic_damping(model, site, damping):
    """MuJoCo's second-order joint damping."""
    model.dof_dampingpoly[model.joint(site).dofadr[0], 0] += damping


def direction_dependent(model, site, forward, backward):
    """Both limits are a symmetric friction beside a constant force, moving or not.

    MuJoCo's field for that force is the motor's bias: a force range clips it, and sensors of the motor's force read it.
    """
    frictionloss(model, site, (forward + backward) / 2)
    motor = wiring.drives(model, site)[0]
    model.actuator_biastype[motor] = wiring.AFFINE[1]
    model.actuator_biasprm[motor, 0] -= (forward - backward) / 2 / model.actuator_gear[motor, 0]


def stribeck(state: State, site, coulomb, excess, speed):
    """Dry friction whose limit falls with speed."""
    limit = coulomb + excess * np.exp(-((state.joint(site)[2] / speed) ** 2))
    return limit, limit


def load_dependent(state: State, site, coefficient):
    """Dry friction whose limit follows the torque that the gear carries."""
    limit = coefficient * np.abs(motor_force(state, site))
    return limit, limit


def dahl(state: State, site, friction, displacement):
    """Exact solution of the bristle over a step of constant speed; its mean over the step acts."""
    dof, _, speed = state.joint(site)
    key = "dahl", site
    last = state.memory.get(key)
    # Where nothing is known of what was before: as if the joint had moved as it does now.
    last = np.tanh(speed * REMEMBERED / displacement) if last is None else last
    state.memory[key] = _bend(last, speed * state.step / displacement)
    return state.on_joint(dof, -friction * (last + state.memory[key]) / 2)


def _bend(last, way):
    """The bristle after a `way` in one direction, in units of its displacement."""
    ahead = np.sign(way)
    return ahead + (last - ahead) * np.exp(-np.abs(way))


def _amount(name):
    return lambda scales, model, site: [{name: typical.SMALL * typical.force(scales, model, site)}]


def _viscous_probes(scales, model, site):
    return [{"damping": typical.SMALL * typical.force(scales, model, site) / typical.speed(scales, model, site)}]


def _quadratic_probes(scales, model, site):
    return [{"damping": typical.SMALL * typical.force(scales, model, site) / typical.speed(scales, model, site) ** 2}]


def _direction_probes(scales, model, site):
    small = typical.SMALL * typical.force(scales, model, site)
    return [{"forward": small, "backward": small / 2}, {"forward": small / 2, "backward": small}]


def _stribeck_probes(scales, model, site):
    small, speed = typical.SMALL * typical.force(scales, model, site), typical.speed(scales, model, site)
    return [{"coulomb": small, "excess": small, "speed": part * speed} for part in (0.1, 0.3, 0.8)]


def _dahl_probes(scales, model, site):
    small, travel = typical.SMALL * typical.force(scales, model, site), typical.travel(scales, model, site)
    return [{"friction": small, "displacement": part * travel} for part in (0.03, 0.2, 1.0)]


EFFECTS = (
    Effect(
        name="coulomb",
        family="joint friction",
        equation="τ = −Fc sign(q̇);  at rest −Fc ≤ τ ≤ Fc",
        sentence="Dry friction: a constant torque against the motion, which also holds the joint at rest.",
        reference=MODELS,
        enters="model",
        coefficients=(Coefficient("friction", "N m", low=0.0),),
        sites=sites.joints,
        probes=_amount("friction"),
        law=frictionloss,
        neutral={"friction": 0.0},
        export=exporting(frictionloss),
        prior=priors.up_to_applied("friction"),
        prior_source=NO_MORE,
        order=FRICTION,
    ),
    Effect(
        name="viscous",
        family="joint friction",
        equation="τ = −d q̇",
        sentence="Viscous friction: grease or bearings brake the joint in proportion to its speed.",
        reference=MODELS,
        enters="model",
        coefficients=(Coefficient("damping", "N m s/rad", low=0.0),),
        sites=sites.joints,
        probes=_viscous_probes,
        law=viscous,
        neutral={"damping": 0.0},
        export=exporting(viscous),
        prior=priors.up_to_applied("damping", power=1),
        prior_source=NO_MORE,
        order=FRICTION,
    ),
    Effect(
        name="quadratic_damping",
        family="joint friction",
        equation="τ = −d |q̇| q̇",
        sentence="Friction that rises faster with speed than viscous friction, as in oil or air (or, d < 0, slower).",
        reference="Bittencourt, Gunnarsson, J. Dyn. Syst. Meas. Control 134(5), 2012",
        enters="model",
        coefficients=(Coefficient("damping", "N m s²/rad²"),),
        sites=sites.joints,
        probes=_quadratic_probes,
        law=quadratic_damping,
        neutral={"damping": 0.0},
        export=exporting(quadratic_damping),
        prior=priors.up_to_applied("damping", power=2),
        prior_source=NO_MORE,
        order=FRICTION,
        refines=("viscous",),
    ),
    Effect(
        name="direction_dependent_coulomb",
        family="joint friction",
        equation="τ = −F₊ where q̇ > 0, +F₋ where q̇ < 0;  at rest −F₊ ≤ τ ≤ F₋",
        sentence="Dry friction that differs between directions, as in preloaded gears: a mean beside a constant force.",
        reference="Gautier, Janot, Vandanjon, IEEE Trans. Control Systems Technology 21(2), 2013",
        enters="model",
        coefficients=(Coefficient("forward", "N m", low=0.0), Coefficient("backward", "N m", low=0.0)),
        sites=sites.driven,
        probes=_direction_probes,
        law=direction_dependent,
        neutral={"forward": 0.0, "backward": 0.0},
        export=exporting(direction_dependent),
        contains=("coulomb",),
        prior=priors.up_to_applied("forward", "backward"),
        prior_source=NO_MORE,
        order=FRICTION,
        refines=("coulomb",),
    ),
    Effect(
        name="stribeck",
        family="joint friction",
        equation="τ = −(Fc + ΔF exp(−(q̇/vs)²)) sign(q̇);  at rest |τ| ≤ Fc + ΔF",
        sentence="Dry friction that is stronger near rest and falls as the joint picks up speed: stick and slip.",
        reference=MODELS,
        enters="friction",
        coefficients=(
            Coefficient("coulomb", "N m", low=0.0),
            Coefficient("excess", "N m", low=0.0),
            Coefficient("speed", "rad/s", low=1e-4, shape=True),
        ),
        sites=sites.joints,
        probes=_stribeck_probes,
        law=stribeck,
        neutral={"coulomb": 0.0, "excess": 0.0, "speed": 1.0},
        contains=("coulomb",),
        prior=priors.up_to_applied("coulomb", "excess"),
        prior_source=NO_MORE,
        order=FRICTION,
        refines=("coulomb",),
    ),
    Effect(
        name="load_dependent_friction",
        family="joint friction",
        equation="τ = −μ |τ_motor| sign(q̇);  at rest |τ| ≤ μ |τ_motor|",
        sentence="Gear friction that grows with the torque that the gear carries.",
        reference="Bittencourt, Gunnarsson, J. Dyn. Syst. Meas. Control 134(5), 2012",
        enters="friction",
        coefficients=(Coefficient("coefficient", "1", low=0.0, high=1.0),),
        sites=sites.driven,
        probes=lambda scales, model, site: [{"coefficient": typical.SMALL}],
        law=load_dependent,
        neutral={"coefficient": 0.0},
        prior=priors.fixed(coefficient=0.3),
        prior_source="data sheets of gears give efficiencies of 70 % and more",
        order=FRICTION,
        refines=("coulomb",),
    ),
    Effect(
        name="dahl",
        family="joint friction",
        equation="τ = −Fc z,  dz/dt = (q̇ − |q̇| z) / s",
        sentence="Pre-sliding: friction bends like a spring over the distance s before it slips.",
        reference="Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, 1968",
        enters="force",
        coefficients=(
            Coefficient("friction", "N m", low=0.0),
            # What slips only after a radian or a metre is no friction: a spring tied to where the run began.
            Coefficient("displacement", "rad", low=1e-6, high=1.0, shape=True),
        ),
        sites=sites.joints,
        probes=_dahl_probes,
        law=dahl,
        neutral={"friction": 0.0, "displacement": 1.0},
        contains=("coulomb",),
        prior=priors.up_to_applied("friction"),
        prior_source=NO_MORE,
        order=FRICTION,
        refines=("coulomb",),
        side_by_side=True,
    ),
)
