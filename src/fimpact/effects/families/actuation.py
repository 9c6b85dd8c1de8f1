"""Actuators that give more, less, later or something else than they are told."""

import mujoco
import numpy as np
from scipy.signal import lfilter

from fimpact.effects import priors, sites, typical, wiring
from fimpact.effects.base import MOTOR, Coefficient, Effect
from fimpact.effects.law_inputs import Signal
from fimpact.effects.native import exporting
from fimpact.effects.sites import ALL

CONSTANTS = "data sheets give torque constants and amplifier gains to 5 to 10 %"
LATE = "buses and filters hold back by a few samples, at most some 50 ms"
LEAST, MOST, LEVELS = 0.3, 0.99, 5  # of the largest force, between which limits are tried, and how many


def gain(model, site, change):
    """Gain and bias together: what the whole drive delivers is scaled."""
    row = model.actuator(site).id
    model.actuator_gainprm[row, :3] *= 1 + change
    model.actuator_biasprm[row, :3] *= 1 + change


def saturation(model, site, limit):
    """MuJoCo's force range, inside the one that the model has."""
    if not np.isfinite(limit):
        return
    row = model.actuator(site).id
    low, high = model.actuator_forcerange[row] if model.actuator_forcelimited[row] else (-np.inf, np.inf)
    model.actuator_forcelimited[row] = True
    model.actuator_forcerange[row] = max(low, -limit), min(high, limit)


def command_delay(ctrl, signal: Signal, site, delay):
    """Between steps by linear interpolation; before the start of the run a servo holds its first target, and nothing
    else is commanded.

    MuJoCo's own actuator delay does the same, but cannot be shorter than a time step: it is not used.
    """
    out = np.array(ctrl, float)
    whole, part = divmod(delay / _step(signal), 1.0)
    kept, count = _actuators(signal, site), ctrl.shape[1]
    before = np.repeat(signal.before(out)[:, :, kept], min(int(whole), count) + 1, axis=1)
    padded = np.concatenate([before, out[:, :, kept]], axis=1)
    out[:, :, kept] = (1 - part) * padded[:, 1 : 1 + count] + part * padded[:, :count]
    return out


def actuator_lag(ctrl, signal: Signal, site, time):
    """First-order filter, from rest or from a servo's first target; its pole is chosen so that it holds back `time`
    times each step of the command. Noise of the log passes as it is: a filter that took it away would fit better
    wherever there is some."""
    out, step = np.array(ctrl, float), _step(signal)
    kept, keep = _actuators(signal, site), time / (time + step)
    before = keep * signal.before(out)[:, :, kept]
    noise = 0.0 if signal.noise is None else signal.noise[:, :, kept]
    out[:, :, kept] = noise + lfilter([1 - keep], [1, -keep], out[:, :, kept] - noise, axis=1, zi=before)[0]
    return out


def rotor_inertia(model, site, inertia):
    """MuJoCo's armature."""
    model.dof_armature[model.joint(site).dofadr[0]] += inertia


def torque_offset(model, site, offset):
    """The constant part of an affine actuator."""
    row = model.actuator(site).id
    model.actuator_biastype[row] = wiring.AFFINE[1]
    model.actuator_biasprm[row, 0] += offset


def _export_lag(spec, site, time):
    if time <= 0:
        return
    step, parameters = spec.option.timestep, np.zeros(10)
    parameters[0] = step / np.log1p(step / time)
    for actuator in spec.actuators if site == ALL else [spec.actuator(site)]:
        actuator.dyntype, actuator.dynprm, actuator.actearly = mujoco.mjtDyn.mjDYN_FILTEREXACT, parameters, True


def _step(signal: Signal) -> float:
    return float(signal.time[0, 1] - signal.time[0, 0]) if signal.time.shape[1] > 1 else np.inf


def _actuators(signal: Signal, site) -> list[int]:
    # Not Signal.column: a channel may have an actuator's name.
    return list(range(len(signal.actuators))) if site == ALL else [signal.actuators.index(site)]


def _saturation_probes(scales, model, site):
    """From what the motion needed, which a limit cannot have been below, to what it hardly touches."""
    most = typical.max_actuator_force(scales, model, site)
    least = scales.needed[model.actuator(site).id] or LEAST * most
    return [{"limit": float(limit)} for limit in np.geomspace(min(least, MOST * most), MOST * most, LEVELS)]


def _late_probes(name):
    """From half a sample to what is too late to be believed: a servo at its limit shows no derivative."""
    return lambda scales, model, site: [
        {name: float(late)} for late in np.geomspace(0.5 * scales.period, 2 * typical.delay(scales), 3)
    ]


def _rotor_probes(scales, model, site):
    own = 1 / max(float(model.dof_invweight0[model.joint(site).dofadr[0]]), 1e-9)
    return [{"inertia": typical.SMALL * own}]


def _offset_probes(scales, model, site):
    return [{"offset": typical.SMALL * typical.rms_actuator_force(scales, model, site)}]


EFFECTS = (
    Effect(
        name="gain",
        family="actuation",
        equation="τ = (1 + ε) τ_model",
        sentence="The motor gives a fixed percentage more or less torque than its data sheet says.",
        reference="Gautier, Briot, J. Dyn. Syst. Meas. Control 136(5), 2014",
        enters="model",
        coefficients=(Coefficient("change", "1", low=-0.9, high=9.0),),
        sites=sites.proportioned,
        probes=lambda scales, model, site: [{"change": typical.SMALL}],
        law=gain,
        neutral={"change": 0.0},
        export=exporting(gain),
        prior=priors.fixed(change=0.07),
        prior_source=CONSTANTS,
        order=MOTOR,
    ),
    Effect(
        name="saturation",
        family="actuation",
        equation="τ = clip(τ_model, −c, c)",
        sentence="The drive cannot give more than a certain torque, whatever it is told.",
        reference="Siciliano, Sciavicco, Villani, Oriolo, Robotics, Springer 2009, ch. 5",
        enters="model",
        coefficients=(Coefficient("limit", "N m", low=1e-9),),
        sites=sites.actuators,
        probes=_saturation_probes,
        law=saturation,
        neutral={"limit": np.inf},
        export=exporting(saturation),
        linear=False,
        prior=priors.limit,
        prior_source="a limit that shows lies near the largest torque that is asked for",
        order=MOTOR,
    ),
    Effect(
        name="command_delay",
        family="actuation",
        equation="u(t) = u_command(t − δ)",
        sentence="Commands reach the motor late, because of buses, drivers and control cycles.",
        reference="Hwangbo et al., Science Robotics 4(26), 2019",
        enters="command",
        coefficients=(Coefficient("delay", "s", low=0.0, high=1.0),),
        sites=sites.commands,
        probes=_late_probes("delay"),
        law=command_delay,
        neutral={"delay": 0.0},
        linear=False,
        prior=priors.late("delay"),
        prior_source=LATE,
        order=MOTOR,
        least=lambda scales, model, site: {"delay": typical.instant(scales)},
        shifts_time=True,
    ),
    Effect(
        name="actuator_lag",
        family="actuation",
        equation="T du/dt = u_command − u",
        sentence="Motor current or pressure follows its command with a time constant instead of at once.",
        reference="Siciliano, Sciavicco, Villani, Oriolo, Robotics, Springer 2009, ch. 5",
        enters="command",
        coefficients=(Coefficient("time", "s", low=0.0, high=10.0),),
        sites=sites.prompt,
        probes=_late_probes("time"),
        law=actuator_lag,
        neutral={"time": 0.0},
        export=_export_lag,
        linear=False,
        prior=priors.late("time"),
        prior_source=LATE,
        order=MOTOR,
        least=lambda scales, model, site: {"time": typical.instant(scales)},
        shifts_time=True,
    ),
    Effect(
        name="rotor_inertia",
        family="actuation",
        equation="τ = −I q̈",
        sentence="The spinning rotor, seen through the gear, adds inertia about the joint alone.",
        reference="Khalil, Dombre, Modeling, Identification and Control of Robots, 2002, ch. 9",
        enters="model",
        coefficients=(Coefficient("inertia", "kg m²", low=0.0),),
        sites=sites.joints,
        probes=_rotor_probes,
        law=rotor_inertia,
        neutral={"inertia": 0.0},
        export=exporting(rotor_inertia),
        prior=priors.rotor,
        prior_source="behind a gear of 100 a rotor outweighs its load; light joints have the motors of heavy ones",
        order=MOTOR,
    ),
    Effect(
        name="torque_offset",
        family="actuation",
        equation="τ = τ_model + τ₀",
        sentence="The drive pushes with a constant torque even at zero command, from a current sensor's offset.",
        reference="Gautier, Janot, Vandanjon, IEEE Trans. Control Systems Technology 21(2), 2013",
        enters="model",
        coefficients=(Coefficient("offset", "N m"),),
        sites=sites.actuators,
        probes=_offset_probes,
        law=torque_offset,
        neutral={"offset": 0.0},
        export=exporting(torque_offset),
        prior=priors.torque_offset,
        prior_source="offsets of current sensors are some per cent of their range",
        order=MOTOR,
        refines=("coulomb",),
    ),
)
