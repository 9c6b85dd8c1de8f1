"""Between motor and joint: play, elasticity, ripple and losses."""

import numpy as np

from fimpact.effects import gears, priors, sites, typical
from fimpact.effects.base import TRANSMISSION, Coefficient, Effect
from fimpact.effects.drives import motor_force
from fimpact.effects.law_inputs import State
from fimpact.effects.sites import DRAGS

# Per turn; further apart, what lies between two of them would be seen by neither. With fewer than four, which is what a
# motor of two pole pairs has, a ripple is as smooth as a spring.
CYCLES = range(4, 26, 2)


def torque_ripple(state: State, site, sine, cosine, cycles):
    """Force that repeats with the angle."""
    dof, angle, _ = state.joint(site)
    return state.on_joint(dof, sine * np.sin(cycles * angle) + cosine * np.cos(cycles * angle))


def efficiency(state: State, site, driving, driven):
    """Friction whose limit depends on whether the motor drives the joint or is driven by it."""
    force = motor_force(state, site)
    ahead, back = driving * np.abs(force), driven * np.abs(force)
    return np.where(force > 0, ahead, back), np.where(force < 0, ahead, back)


def transmission_coupling(state: State, site, inertia, damping, friction):
    """The neighbour's acceleration, speed and direction pull at the joint."""
    joint, _, neighbour = site.partition(DRAGS)
    moving, _, speed = state.joint(neighbour)
    acceleration = state.acceleration(moving, ("coupling", site))
    force = inertia * acceleration + damping * speed + friction * np.sign(speed)
    return state.on_joint(state.joint(joint)[0], -force)


def _gap_probes(scales, model, site):
    return [{"gap": typical.SMALL * typical.travel(scales, model, site)}]


def _compliance_probes(scales, model, site):
    wound = typical.SMALL * typical.travel(scales, model, site) / typical.force(scales, model, site)
    # A force sensor sees the least of it, an encoder only what is more than its noise.
    return [{"compliance": part * wound, "retardation": scales.period} for part in (1.0, 0.1)]


def _ripple_probes(scales, model, site):
    small = typical.SMALL * typical.force(scales, model, site)
    sine, cosine = {"sine": small, "cosine": 0.0}, {"sine": 0.0, "cosine": small}
    return [phase | {"cycles": float(n)} for n in CYCLES for phase in (sine, cosine)]


def _loss_probes(scales, model, site):
    half = typical.SMALL / 2
    return [{"driving": typical.SMALL, "driven": half}, {"driving": half, "driven": typical.SMALL}]


def _coupling_probes(scales, model, site):
    sizes = priors.coupling(scales, model, site)
    return [dict.fromkeys(sizes, 0.0) | {name: typical.SMALL * size} for name, size in sizes.items()]


EFFECTS = (
    Effect(
        name="backlash",
        family="transmission",
        equation="q_encoder = q + d,  |d| ≤ b/2;  I_rotor (d̈ + q̈) = τ_motor within it, d = ± b/2 while pushed there",
        sentence="Play in the gear: the motor-side encoder leads the link by half the gap, to the side it pushes.",
        reference="Nordin, Gutman, Automatica 38(10), 2002",
        enters="gear",
        coefficients=(Coefficient("gap", "rad", low=0.0),),
        sites=sites.encoded,
        probes=_gap_probes,
        law=gears.loose,
        neutral={"gap": 0.0},
        linear=False,
        prior=priors.gap,
        prior_source="gear data sheets: a few arc minutes for planetary gears, a degree for hobby servos",
        order=TRANSMISSION,
        side_by_side=True,
    ),
    Effect(
        name="joint_elasticity",
        family="transmission",
        equation="q_encoder = q + d,  I_rotor (d̈ + q̈) = τ_motor − (d + T ḋ)/C",
        sentence="An elastic gear or belt: the motor-side encoder runs ahead of the link by its wind-up.",
        reference="Spong, J. Dyn. Syst. Meas. Control 109(4), 1987",
        enters="gear",
        coefficients=(
            Coefficient("compliance", "rad/(N m)", low=0.0),
            Coefficient("retardation", "s", low=0.0, shape=True),
        ),
        sites=sites.encoded,
        probes=_compliance_probes,
        law=gears.elastic,
        neutral={"compliance": 0.0, "retardation": 1.0},
        linear=False,
        prior=priors.compliance,
        prior_source="data sheets of strain wave gears and belts: up to a degree of wind-up at the torque they carry",
        order=TRANSMISSION,
        side_by_side=True,
    ),
    Effect(
        name="torque_ripple",
        family="transmission",
        equation="τ = a sin(N q) + b cos(N q)",
        sentence="Cogging: a torque that repeats N times per turn, from the motor's poles or the gear's teeth.",
        reference="Holtz, Springob, IEEE Trans. Ind. Electron. 43(2), 1996",
        enters="force",
        coefficients=(
            Coefficient("sine", "N m"),
            Coefficient("cosine", "N m"),
            Coefficient("cycles", "1/turn", low=float(CYCLES.start), high=200.0, shape=True),
        ),
        sites=sites.hinges,
        probes=_ripple_probes,
        law=torque_ripple,
        neutral={"sine": 0.0, "cosine": 0.0, "cycles": 1.0},
        prior=priors.ripple,
        prior_source="data sheets of motors: cogging and ripple of some 1 to 10 % of the torque",
        order=TRANSMISSION,
    ),
    Effect(
        name="efficiency",
        family="transmission",
        equation="τ = (1 − λ₁) τ_motor where the motor drives, (1 + λ₂) τ_motor where the joint drives the motor",
        sentence="Gear losses that differ between driving and being driven, as in worm gears and screws.",
        reference="Wang, Kim, Directional efficiency in geared transmissions, ICRA 2015",
        enters="friction",
        coefficients=(
            Coefficient("driving", "1", low=0.0, high=0.9),
            Coefficient("driven", "1", low=0.0, high=10.0),
        ),
        sites=sites.driven,
        probes=_loss_probes,
        law=efficiency,
        neutral={"driving": 0.0, "driven": 0.0},
        contains=("load_dependent_friction",),
        prior=priors.fixed(driving=0.3, driven=0.3),
        prior_source="data sheets of gears give efficiencies of 70 % and more",
        order=TRANSMISSION,
        refines=("coulomb", "load_dependent_friction"),
    ),
    Effect(
        name="transmission_coupling",
        family="transmission",
        equation="τ_a = −(Ic q̈_b + dc q̇_b + Fc sign(q̇_b)), site a<-b",
        sentence="A joint is dragged by its neighbour's motion, through a belt, a differential or a shared gear.",
        reference="Khalil, Dombre, Modeling, Identification and Control of Robots, 2002, ch. 9",
        enters="force",
        coefficients=(
            Coefficient("inertia", "kg m²"),
            Coefficient("damping", "N m s/rad"),
            Coefficient("friction", "N m"),
        ),
        sites=sites.neighbours,
        probes=_coupling_probes,
        law=transmission_coupling,
        neutral={"inertia": 0.0, "damping": 0.0, "friction": 0.0},
        prior=priors.coupling,
        prior_source="what couples two joints is part of the neighbour's drive: its friction and its rotor",
        order=TRANSMISSION,
    ),
)
