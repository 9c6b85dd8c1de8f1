"""Sensors that tell the truth wrongly: shifted, scaled, late, turned, or on another clock."""

import mujoco
import numpy as np

from fimpact.effects import priors, sites, typical
from fimpact.effects.base import SENSING, Coefficient, Effect
from fimpact.effects.families.structure import quaternion
from fimpact.effects.law_inputs import Signal
from fimpact.effects.sites import ALL, measured_by
from fimpact.effects.wiring import component

LATE = "buses and filters hold back by a few samples, at most some 50 ms"
CHANNEL = "of the channel"  # in place of a unit: that of what the sensor measures
INSTANT = 1e-9  # of a step: what is nearer is one moment
IMU = "Tedaldi, Pretto, Menegatti, A robust and easy to implement method for IMU calibration, ICRA 2014"


def sensor_bias(measured, signal: Signal, site, offset):
    """A constant is added."""
    out = np.array(measured, float)
    out[:, :, measured_by(signal.channels, site)] += offset
    return out


def sensor_scale(measured, signal: Signal, site, change):
    """The reading is scaled about zero."""
    out = np.array(measured, float)
    out[:, :, measured_by(signal.channels, site)] *= 1 + change
    return out


def sensor_delay(measured, signal: Signal, site, delay):
    """The reading is that of an earlier time; less than nothing: that of a later one. Where nothing is commanded, all
    sensors together are late only against the state that is known at the start of a run: any other motion may begin at
    any time."""
    return _read_at(measured, signal, site, _delayed(signal, site, delay))


def clock_drift(measured, signal: Signal, site, rate):
    """What the log stamps with t was measured when (1 - rate) t had passed on the clock of the commands. Where nothing
    is commanded there is no such clock, and any motion may begin at any time: it counts from the first sample."""
    return _read_at(measured, signal, site, _drifted(signal, site, rate))


def misalignment(measured, signal: Signal, site, turn_x, turn_y, turn_z):
    """Readings in the axes of a sensor that is turned; of two components only the turn between them shows."""
    out, kept = np.array(measured, float), measured_by(signal.channels, site)
    axes, turn, matrix = (
        [component(signal.channels[i]) for i in kept],
        np.array([turn_x, turn_y, turn_z]),
        np.empty(9),
    )
    if len(axes) == 2:
        turn[axes] = 0
    mujoco.mju_quat2Mat(matrix, quaternion(turn))
    out[:, :, kept] = out[:, :, kept] @ matrix.reshape(3, 3)[np.ix_(axes, axes)]
    return out


def _delayed(signal: Signal, site, delay):
    late = np.full_like(signal.begin, delay)
    if site == ALL and not signal.actuators:
        late[signal.begin > 0] = 0.0
    return signal.time - late


def _drifted(signal: Signal, site, rate):
    return signal.time - rate * (signal.time if signal.actuators else signal.time - signal.begin)


def _read_at(measured, signal: Signal, site, wanted):
    out, kept = np.array(measured, float), measured_by(signal.channels, site)
    if signal.time.shape[1] > 1:
        period = signal.time[:, 1:2] - signal.time[:, :1]
        place = (wanted - signal.time[:, :1]) / period
        # No position jumps with a command: it is read between samples.
        jumps = np.array([signal.parts > 1 and not signal.joint_of[column] for column in kept], bool)
        smooth, rough = (list(np.array(kept, int)[own]) for own in (~jumps, jumps))
        if smooth:
            out[:, :, smooth] = interpolate(out[:, :: signal.parts, smooth], place / signal.parts)
        if rough:
            out[:, :, rough] = _within(out[:, :, rough], place, signal.parts)
    return out


def _within(steps: np.ndarray, place: np.ndarray, parts: int) -> np.ndarray:
    """Values, (n, T, k), of `steps` (n, T, k), of which `parts` are one sample, at fractional indices `place` (n, T).

    By straight lines, none of which leads from one sample to the next: there a command jumps, and what it moves. Before
    the first and beyond the last they rise as they do over a sample.
    """
    rows, last = np.arange(len(steps))[:, None], steps.shape[1] - 1
    inside = np.clip(place, 0, last + 1)
    index = np.minimum(np.floor(inside + INSTANT).astype(int), last)
    at = np.minimum(index, np.minimum(index // parts * parts + parts - 2, last - 1))
    found = steps[rows, at] + (inside - at)[..., None] * (steps[rows, at + 1] - steps[rows, at])
    begun, ended = steps[:, min(parts, last)] - steps[:, 0], steps[:, -1] - steps[:, max(last - parts, 0)]
    rise = np.where((place < 0)[..., None], begun[:, None], ended[:, None]) / min(parts, last)
    return found + (place - inside)[..., None] * rise


def interpolate(samples: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Values, (n, T, k), of `samples` (n, T, k) at fractional indices `place` (n, T).

    By cubics through four neighbours inside, by straight lines from the last two samples outside.
    """
    rows, last = np.arange(len(samples))[:, None], samples.shape[1] - 1
    ends = 2 * samples[:, :1] - samples[:, 1:2], 2 * samples[:, -1:] - samples[:, -2:-1]
    padded = np.concatenate([ends[0], samples, ends[1]], axis=1)
    index = np.clip(np.floor(place).astype(int), 0, last - 1)
    part, beyond = np.clip(place - index, 0, 1), place - np.clip(place, 0, last)
    weights = (
        -part * (part - 1) * (part - 2) / 6,
        (part + 1) * (part - 1) * (part - 2) / 2,
        -(part + 1) * part * (part - 2) / 2,
        (part + 1) * part * (part - 1) / 6,
    )
    inside = sum(weight[..., None] * padded[rows, index + k] for k, weight in enumerate(weights))
    return inside + beyond[..., None] * (samples[rows, index + 1] - samples[rows, index])


def _export_misalignment(spec, site, turn_x, turn_y, turn_z):
    """A turned copy of the MJCF site, because other sensors may share it; only where the sensor `rotates_with_site`."""
    sensor = spec.sensor(site)
    old, name = spec.site(sensor.objname), f"{sensor.objname}_{site}_turned"
    model = spec.compile()
    turned, row = np.empty(4), model.site(sensor.objname)
    mujoco.mju_mulQuat(turned, row.quat, quaternion(np.array([turn_x, turn_y, turn_z])))
    old.parent.add_site(name=name, pos=row.pos, quat=turned)
    sensor.objname = name


def _stamps(scales, model, site):
    """A sensor is not early; but a log may hold, beside each command, what all sensors read after it had acted."""
    together = site == ALL or len(scales.measured) <= model.sensor(site).dim[0]
    return {"delay": (-scales.period if together and model.nu else 0.0, 1.0)}


def _turn_probes(scales, model, site):
    still = {"turn_x": 0.0, "turn_y": 0.0, "turn_z": 0.0}
    return [still | {axis: typical.SMALL} for axis in still]


EFFECTS = (
    Effect(
        name="sensor_bias",
        family="sensing",
        equation="y' = y + b",
        sentence="The sensor shows something where it should show zero.",
        reference=IMU,
        enters="measurement",
        coefficients=(Coefficient("offset", CHANNEL),),
        sites=sites.columns,
        probes=lambda scales, model, site: [{"offset": typical.SMALL * typical.shown(scales)}],
        law=sensor_bias,
        neutral={"offset": 0.0},
        prior=priors.sensor_bias,
        prior_source="zero marks of encoders: 1 or 2 degrees; data sheets of inertial sensors; others a tenth",
        order=SENSING,
    ),
    Effect(
        name="sensor_scale",
        family="sensing",
        equation="y' = (1 + s) y",
        sentence="The sensor's calibration is off by a percentage.",
        reference=IMU,
        enters="measurement",
        coefficients=(Coefficient("change", "1", low=-0.9, high=9.0, sd=0.1),),
        sites=sites.scalable,
        probes=lambda scales, model, site: [{"change": typical.SMALL}],
        law=sensor_scale,
        neutral={"change": 0.0},
        prior=priors.fixed(change=0.05),
        prior_source="data sheets give sensitivities to some 5 %",
        order=SENSING,
    ),
    Effect(
        name="sensor_delay",
        family="sensing",
        equation="y'(t) = y(t − δ)",
        sentence="Readings arrive late: filters, buses and time stamps taken on arrival (δ < 0: all are logged early).",
        reference="Åström, Wittenmark, Computer-Controlled Systems, 1997, ch. 3",
        enters="measurement",
        coefficients=(Coefficient("delay", "s", low=-1.0, high=1.0),),
        sites=sites.sensors,
        probes=lambda scales, model, site: [{"delay": 0.2 * scales.period}],
        law=sensor_delay,
        neutral={"delay": 0.0},
        ranges=_stamps,
        prior=priors.late("delay"),
        prior_source=LATE,
        order=SENSING,
        least=lambda scales, model, site: {"delay": typical.instant(scales)},
        shifts_time=True,
    ),
    Effect(
        name="misalignment",
        family="sensing",
        equation="y' = R(turn)ᵀ y",
        sentence="The sensor is mounted at an angle, so that each axis reads a little of the others.",
        reference=IMU,
        enters="measurement",
        coefficients=tuple(Coefficient(f"turn_{axis}", "rad", low=-1.6, high=1.6) for axis in "xyz"),
        sites=sites.turnable,
        probes=_turn_probes,
        law=misalignment,
        neutral={"turn_x": 0.0, "turn_y": 0.0, "turn_z": 0.0},
        export=_export_misalignment,
        prior=priors.fixed(turn_x=0.05, turn_y=0.05, turn_z=0.05),
        prior_source="sensors are mounted by eye, to some 3 degrees",
        order=SENSING,
    ),
    Effect(
        name="clock_drift",
        family="sensing",
        equation="y'(t) = y((1 − r) t)",
        sentence="The logger's clock runs faster (or, r < 0, slower) than the controller's, so the two drift apart.",
        reference="Moon, Skelly, Towsley, Estimation and removal of clock skew, INFOCOM 1999",
        enters="measurement",
        coefficients=(Coefficient("rate", "s/s", low=-0.05, high=0.05),),
        sites=sites.everything,
        probes=lambda scales, model, site: [{"rate": 0.2 * scales.period / scales.duration}],
        law=clock_drift,
        neutral={"rate": 0.0},
        prior=priors.fixed(rate=1e-2),
        prior_source="quartz clocks are true to .01 %, software's to .1 %, stamps that count a loop's rounds to 1 %",
        order=SENSING,
        least=lambda scales, model, site: {"rate": typical.instant(scales) / scales.duration},
        shifts_time=True,
    ),
)
