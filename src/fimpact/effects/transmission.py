"""Between motor and joint: play, elasticity, ripple and losses.

Backlash and elasticity are quasi-static and seen by a motor-side encoder: what lies between encoder and link is shifted
by the torque before the moment, the motor's less what turns the rotor itself.
"""

import numpy as np

from fimpact.effects import amounts, sites
from fimpact.effects.base import Coefficient, Effect, Signal, State
from fimpact.effects.drives import motor_force

CYCLES = range(2, 26, 2)  # per turn; further apart, what lies between two of them would be seen by neither
EASING = 0.1  # of the root mean square torque, below which play is not taken up


def backlash(measured, signal: Signal, site, gap):
    """The motor leads by half the gap in the direction in which it pushes."""

    def lead(force):
        return gap / 2 * np.tanh(force / (EASING * np.sqrt(np.mean(force**2)) + np.finfo(float).tiny))

    return _encoder(measured, signal, site, lead)


def joint_elasticity(measured, signal: Signal, site, compliance):
    """The motor leads by the wind-up of the gear."""
    return _encoder(measured, signal, site, lambda force: compliance * force)


def _encoder(measured, signal: Signal, site, lead):
    out = np.array(measured, float)
    for column, joint in enumerate(signal.joint_of):
        if joint == site and signal.driven_by[column] >= 0:
            turning = signal.rotor[column] * _acceleration(signal.time, out[:, :, column])
            force = signal.force[:, :, signal.driven_by[column]]
            # At the instant of a command the gear still gives way to the one before.
            held = np.concatenate([force[:, :1], force[:, :-1]], axis=1)
            out[:, :, column] += lead(held - turning)
    return out


def _acceleration(time, position):
    """Second differences, (n, T), in the middle of three samples; those at the ends are repeated."""
    out = np.zeros_like(position)
    if position.shape[1] > 2:
        out[:, 1:-1] = np.diff(position, 2) / (time[:, 1:2] - time[:, :1]) ** 2
        out[:, 0], out[:, -1] = out[:, 1], out[:, -2]
    return out


def torque_ripple(state: State, site, sine, cosine, cycles):
    """Force that repeats with the angle."""
    dof, angle, _ = state.joint(site)
    return state.on_joint(dof, sine * np.sin(cycles * angle) + cosine * np.cos(cycles * angle))


def efficiency(state: State, site, loss):
    """Friction whose limit depends on whether the motor drives the joint or is driven by it."""
    force = motor_force(state, site)
    driving, driven = loss * np.abs(force), loss / (1 - loss) * np.abs(force)
    return np.where(force > 0, driving, driven), np.where(force < 0, driving, driven)


def _gap_probes(scales, model, site):
    return [{"gap": amounts.SMALL * amounts.travel(scales, model, site)}]


def _compliance_probes(scales, model, site):
    return [{"compliance": amounts.SMALL * amounts.travel(scales, model, site) / amounts.force(scales, model, site)}]


def _ripple_probes(scales, model, site):
    small = amounts.SMALL * amounts.force(scales, model, site)
    sine, cosine = {"sine": small, "cosine": 0.0}, {"sine": 0.0, "cosine": small}
    return [phase | {"cycles": float(n)} for n in CYCLES for phase in (sine, cosine)]


EFFECTS = (
    Effect(
        name="backlash",
        family="transmission",
        equation="q_encoder = q + (b/2) tanh(τ/ε),  τ = τ_motor − I_rotor q̈,  ε = 0.1 rms(τ)",
        sentence="Play in the gear: the motor-side encoder leads the link by half the gap, to the side it pushes.",
        reference="Nordin, Gutman, Automatica 38(10), 2002",
        enters="measurement",
        coefficients=(Coefficient("gap", "rad", low=0.0),),
        sites=sites.encoded,
        probes=_gap_probes,
        law=backlash,
        neutral={"gap": 0.0},
        late=True,
    ),
    Effect(
        name="joint_elasticity",
        family="transmission",
        equation="q_encoder = q + (τ_motor − I_rotor q̈)/K",
        sentence="An elastic gear or belt: the motor-side encoder runs ahead of the link by its wind-up.",
        reference="Spong, J. Dyn. Syst. Meas. Control 109(4), 1987",
        enters="measurement",
        coefficients=(Coefficient("compliance", "rad/(N m)", low=0.0),),
        sites=sites.encoded,
        probes=_compliance_probes,
        law=joint_elasticity,
        neutral={"compliance": 0.0},
        late=True,
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
            Coefficient("cycles", "1/turn", low=0.5, high=200.0, shape=True),
        ),
        sites=sites.hinges,
        probes=_ripple_probes,
        law=torque_ripple,
        neutral={"sine": 0.0, "cosine": 0.0, "cycles": 1.0},
    ),
    Effect(
        name="efficiency",
        family="transmission",
        equation="τ = (1 − λ) τ_motor where the motor drives, τ_motor/(1 − λ) where the joint drives the motor",
        sentence="Gear losses: part of the motor's power does not reach the joint, and back-driving costs extra.",
        reference="Wang, Kim, Directional efficiency in geared transmissions, ICRA 2015",
        enters="friction",
        coefficients=(Coefficient("loss", "1", low=0.0, high=0.9),),
        sites=sites.driven,
        probes=lambda scales, model, site: [{"loss": amounts.SMALL}],
        law=efficiency,
        neutral={"loss": 0.0},
    ),
)
