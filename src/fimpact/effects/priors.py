"""How large each effect usually is: standard deviations of its amplitudes, as data sheets and handbooks give them.

The `prior` of every entry of the catalogue is made here; the `prior_source` beside it says whence. All are functions of
(scales, model, site) that give a size for each amplitude, or make such a function.
"""

from collections.abc import Callable

import mujoco
import numpy as np

from fimpact.effects import sites, typical, wiring
from fimpact.effects.base import Scales, Values

Prior = Callable[[Scales, mujoco.MjModel, str], Values]

THIN = 0.03  # of a body's size: no second moment counts as smaller than that of a plate so thick
ZERO = {  # rad, m/s^2, rad/s: offsets of encoders set by a mark, and of inertial sensors in data sheets
    int(mujoco.mjtSensor.mjSENS_JOINTPOS): 0.03,
    int(mujoco.mjtSensor.mjSENS_ACCELEROMETER): 0.5,
    int(mujoco.mjtSensor.mjSENS_GYRO): 0.05,
}
PLACE = 0.01  # of the mechanism: what lengths and places are measured to
DRIFTS = 0.1  # of what a sensor shows: offset of any other kind


def fixed(**sizes: float) -> Prior:
    """The same sizes everywhere."""
    return lambda scales, model, site: dict(sizes)


def of_length(**shares: float) -> Prior:
    """Shares of the size of the mechanism."""
    return lambda scales, model, site: {name: share * scales.length for name, share in shares.items()}


def of_targets(**shares: float) -> Prior:
    """Shares of a degree, or of a tenth of a millimetre, by which a servo takes its targets."""
    return lambda scales, model, site: {name: share * typical.target(model, site) for name, share in shares.items()}


def late(name: str) -> Prior:
    """The delay of a bus or a filter."""
    return lambda scales, model, site: {name: typical.delay(scales)}


def up_to_applied(*names: str, power: int = 0) -> Prior:
    """The force applied at the rms speed, for a friction that goes with this power of speed."""

    def prior(scales, model, site):
        size = typical.applied(scales, model, site) / typical.speed(scales, model, site) ** power
        return dict.fromkeys(names, size)

    return prior


def drag(power: int) -> Prior:
    """The force applied at the pace of the mechanism, for a drag that goes with this power of speed."""

    def prior(scales, model, site):
        return {"coefficient": typical.max_force(scales, model) / typical.max_speed(scales, model) ** power}

    return prior


def gap(scales, model, site):
    """Play of a gear, some minutes of arc to a degree."""
    return {"gap": 0.02 if _turns(model, site) else 2e-4}


def compliance(scales, model, site):
    """Wind-up of a gear or belt at the force applied, up to a degree."""
    wound = 0.02 if _turns(model, site) else 1e-3
    return {"compliance": wound / typical.applied(scales, model, site)}


def ripple(scales, model, site):
    """A tenth of the force applied."""
    return dict.fromkeys(("sine", "cosine"), 0.1 * typical.applied(scales, model, site))


def coupling(scales, model, site):
    """The rotor and the friction of a neighbour's drive."""
    joint, _, neighbour = site.partition(sites.DRAGS)
    force, speed = typical.applied(scales, model, joint), typical.speed(scales, model, neighbour)
    return {"inertia": typical.inertia(scales, model, joint), "damping": force / speed, "friction": force}


def limit(scales, model, site):
    """The largest force of an actuator: a limit that shows lies near it."""
    return {"limit": typical.max_actuator_force(scales, model, site)}


def rotor(scales, model, site):
    """Twice the inertia that a joint may feel of its drive."""
    return {"inertia": 2 * typical.inertia(scales, model, site)}


def torque_offset(scales, model, site):
    """A fifth of an actuator's rms force."""
    return {"offset": 0.2 * typical.rms_actuator_force(scales, model, site)}


def droop(scales, model, site):
    """Of a tenth at the largest force of all motors together."""
    gears = np.abs(model.actuator_gear[:, 0])
    motors = [i for joint in sites.driven(model) for i in wiring.drives(model, joint)]
    most = sum(gears[i] * typical.max_actuator_force(scales, model, model.actuator(i).name) for i in motors)
    return {"droop": float(0.1 / max(most, typical.FLOOR))}


def spring(name: str, power: int) -> Prior:
    """A spring that takes a third of the force applied over the joint's travel."""

    def prior(scales, model, site):
        stretch = typical.stretch(scales, model, site) if power > 1 else typical.travel(scales, model, site)
        return {name: 0.3 * typical.applied(scales, model, site) / stretch**power}

    return prior


def cable(scales, model, site):
    """A cable that takes a third of the largest force over the size of the mechanism."""
    return {"stiffness": 0.3 * typical.max_force(scales, model) / scales.length}


def base_compliance(scales, model, site):
    """A mount that gives by half a degree under the weight stretched out."""
    return {"compliance": 0.01 / (scales.mass * scales.gravity * scales.length)}


def extra_mass(scales, model, site):
    """As much as the link that carries it, or as the mean of all."""
    return {"mass": float(max(model.body(site).mass[0], _mean_mass(scales, model)))}


def shifts(scales, model, site):
    """Of a centre of mass, a fifth of the body."""
    return dict.fromkeys("xyz", 0.2 * typical.size(scales, model, site))


def rigid_body(scales, model, site):
    """Of bodies lighter than the mean, the mass is as uncertain as the mean's: nobody weighs cables and screws."""
    row = model.body(site)
    least = row.mass * (THIN * typical.size(scales, model, site)) ** 2
    size = np.sqrt(np.maximum(typical.second_moments(row.inertia), least))
    spread = [float(0.3 * size["xyz".index(a)] * size["xyz".index(b)]) for _, a, b in typical.MOMENTS]
    mass = 0.2 * extra_mass(scales, model, site)["mass"]
    return {"mass": mass, **shifts(scales, model, site), **dict(zip(typical.MOMENTS, spread, strict=True))}


def sensor_bias(scales, model, site):
    """Zero marks of encoders, data sheets of inertial sensors, and of other sensors a tenth of what they show."""
    sensor = model.sensor(wiring.base(site))
    kind = int(sensor.type[0])
    slides = kind == mujoco.mjtSensor.mjSENS_JOINTPOS and model.jnt_type[sensor.objid[0]] == wiring.SLIDE
    if slides or kind == mujoco.mjtSensor.mjSENS_FRAMEPOS:
        return {"offset": PLACE * scales.length}
    return {"offset": ZERO.get(kind) or DRIFTS * typical.shown(scales)}


def _turns(model, joint) -> bool:
    return model.joint(joint).type[0] == wiring.HINGE


def _mean_mass(scales, model) -> float:
    return scales.mass / max(np.count_nonzero((model.body_weldid != 0) & (model.body_mass > 0)), 1)
