"""The tie of each vector sensor, such as a gyro, and the motion that the measured positions show.

The model is put through that motion and tells what the sensor must read, as it is declared and in each way in which
it may have been logged wrongly: other units, signs, axes or clocks, gravity taken out, another order of a quaternion.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np
from scipy.optimize import linear_sum_assignment

from fimpact.cases import enums
from fimpact.cases.channels import Channel
from fimpact.cases.consistency.kinematics import (
    CLOCK,
    DEGREES,
    LATE,
    ORDERS,
    SCALE,
    THOUSAND,
    Log,
    Parts,
    allowed,
    body_of,
    compared,
    fitted,
    in_order,
    lag,
    reordered,
    shifted,
)
from fimpact.cases.consistency.measured_motion import SMOOTHERS, Motion, derivative, filled, moved, turns
from fimpact.cases.consistency.ties import DECLARED, MODEL_ERROR, NOTHING, Left, Reading, Tie, least

SAMPLES = 1500  # in which the model is placed
OFFSET = {enums.ACCELEROMETER: 1.0, enums.FORCE: np.inf, enums.TORQUE: np.inf, enums.FRAMEPOS: np.inf}  # honest, SI


@dataclass(frozen=True)
class Expected:
    """What a sensor should read (T, k), the axes of its frame in the world (T, 3, 3), and what weight adds (T, k)."""

    value: np.ndarray
    axes: np.ndarray
    weight: np.ndarray


def _turned(axes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.einsum("tij,tj->ti", axes, vectors)


def _back(axes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.einsum("tji,tj->ti", axes, vectors)


WORLD = Reading("it is in the axes of the world, not the sensor's own", "axes", "turn it into the sensor's axes")
OWN = Reading("it is in the body's own axes, not the world's", "axes", "use a sensor with its own axes, such as a gyro")
WITHOUT = Reading(
    "gravity was taken out", "gravity", "log the raw acceleration, or put gravity back: at rest it is 9.81 up"
)
LINEAR = Reading("gravity was taken out and it is in the axes of the world", "gravity", "log the raw acceleration")
SIGN = Reading("it has the wrong sign", "sign", "use `scale: -1`")
AXES = Reading("its axes are exchanged or reversed", "axes", "correct the order and signs of its columns")
IN_DEGREES = Reading("it is in degrees but declared as radians", "units", "correct its unit")
IN_RADIANS = Reading("it is in radians but declared as degrees", "units", "correct its unit")
LARGE = Reading("its unit is wrong by 1000 (too large)", "units", "correct its unit")
SMALL = Reading("its unit is wrong by 1000 (too small)", "units", "correct its unit")
IN_G = Reading("it is in g but declared as m/s^2", "units", "write `unit: g_n`")
TIMES_G = Reading("it is in m/s^2 but declared as g", "units", "write `unit: m/s^2`")
Expect = Callable[[Expected], np.ndarray]
PLAIN: dict[Reading, Expect] = {
    SIGN: lambda e: -e.value,
    LARGE: lambda e: THOUSAND * e.value,
    SMALL: lambda e: e.value / THOUSAND,
}
ANGULAR: dict[Reading, Expect] = {IN_DEGREES: lambda e: DEGREES * e.value, IN_RADIANS: lambda e: e.value / DEGREES}
IN_WORLD: dict[Reading, Expect] = {WORLD: lambda e: _turned(e.axes, e.value)}
IN_OWN: dict[Reading, Expect] = {OWN: lambda e: _back(e.axes, e.value)}
WEIGHTLESS: dict[Reading, Expect] = {
    WITHOUT: lambda e: e.value - e.weight,
    LINEAR: lambda e: _turned(e.axes, e.value - e.weight),
    IN_G: lambda e: e.value / 9.80665,
    TIMES_G: lambda e: e.value * 9.80665,
}
TRIED: dict[int, dict[Reading, Expect]] = {
    enums.GYRO: PLAIN | ANGULAR | IN_WORLD,
    enums.FRAMEANGVEL: PLAIN | ANGULAR | IN_OWN,
    enums.ACCELEROMETER: PLAIN | WEIGHTLESS | IN_WORLD,
    enums.VELOCIMETER: PLAIN | IN_WORLD,
    enums.FRAMELINVEL: PLAIN | IN_OWN,
    enums.FRAMEPOS: PLAIN,
    enums.FORCE: PLAIN | IN_WORLD,
    enums.TORQUE: PLAIN | IN_WORLD,
    enums.FRAMEQUAT: {},
}


def sensor_ties(log: Log) -> Iterator[Tie]:
    """Each vector sensor against what it must read in the motion that the positions show."""
    columns = log.columns()
    sources = {name for place in columns.values() for name in log.places if set(log.places[name]) <= set(place)}
    asked = [c for c in log.seen if c.type in TRIED and c.sensor not in sources and placed(log, c, columns)]
    if not asked:
        return
    expected = _expectations(log, asked, columns)
    quats = [c for c in log.seen if c.type == enums.FRAMEQUAT and c.sensor in sources]
    for channel in asked:
        yield _sensor_tie(log, channel, expected, quats)


def placed(log: Log, channel: Channel, columns: dict[str, list[int]]) -> bool:
    """Whether the positions of all joints that a sensor hangs on are measured; of a force, of all joints."""
    model = log.model
    body = body_of(model, channel.sensor)
    bodies = set(range(model.nbody)) if channel.type in (enums.FORCE, enums.TORQUE) else set()
    while body > 0:
        bodies.add(body)
        body = int(model.body_parentid[body])
    hung = [j for j in range(model.njnt) if int(model.jnt_bodyid[j]) in bodies]
    half = {name for name, place in columns.items() if len(place) == 4}
    straight = channel.type in (enums.FRAMEPOS, enums.FRAMELINVEL, enums.VELOCIMETER, enums.FORCE, enums.TORQUE)
    return bool(hung) and all(
        model.joint(j).name in columns and not (straight and model.joint(j).name in half) for j in hung
    )


def _expectations(log: Log, asked: list[Channel], columns: dict[str, list[int]]):
    """What the sensors should read in a group, through parabolas of a width, the orientation read in some order."""

    @cache
    def expected(order: Reading, group: int, width: int) -> dict[str, list[Expected]]:
        runs = [log.recording.runs[run] for run in log.groups[group]]
        count = sum(len(run.measured) for run in log.recording.runs)
        stride = max(1, count // SAMPLES)
        out: dict[str, list[Expected]] = {channel.sensor: [] for channel in asked}
        for run in runs:
            measured = reordered(log, run.measured, order)
            motion = moved(log.model, columns, measured, log.recording.period, width)
            for name, one in _read(log.model, motion, [c.sensor for c in asked], stride).items():
                out[name].append(one)
        return out

    return expected


def _read(model: mujoco.MjModel, motion: Motion, names: list[str], stride: int) -> dict[str, Expected]:
    """What sensors read in a motion, every `stride` samples, NaN in between."""
    data, count = mujoco.MjData(model), len(motion.q)
    out = {}
    for name in names:
        out[name] = Expected(*(np.full((count, *shape), np.nan) for shape in ((3,), (3, 3), (3,))))
    known = np.isfinite(np.column_stack([motion.q, motion.v, motion.a])).all(axis=1)
    for row in np.flatnonzero(known)[::stride]:
        _sense(model, data, motion.q[row], motion.v[row], motion.a[row])
        for name, one in out.items():
            one.value[row] = _reading_of(model, data, name)
            one.axes[row] = _axes(model, data, name)
            one.weight[row] = one.axes[row].T @ -model.opt.gravity
    return out


def _sense(model: mujoco.MjModel, data: mujoco.MjData, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> None:
    data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
    for stage in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_sensorPos, mujoco.mj_comVel, mujoco.mj_sensorVel):
        stage(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    mujoco.mj_sensorAcc(model, data)


def _reading_of(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> np.ndarray:
    """What a sensor reads; of an orientation, the rate about its own axes."""
    sensor, rate = model.sensor(name), np.zeros(6)
    if sensor.type[0] != enums.FRAMEQUAT:
        return data.sensor(name).data
    mujoco.mj_objectVelocity(model, data, int(sensor.objtype[0]), int(sensor.objid[0]), rate, 1)
    return rate[:3]


def _axes(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> np.ndarray:
    sensor = model.sensor(name)
    kind, at = int(sensor.objtype[0]), int(sensor.objid[0])
    if kind == enums.SITE:
        return data.site_xmat[at].reshape(3, 3)
    return (data.xmat if kind == enums.XBODY else data.ximat)[at].reshape(3, 3)


def _sensor_tie(log: Log, channel: Channel, expected, quats: list[Channel]) -> Tie:
    tried, name, period = TRIED[channel.type], channel.sensor, log.recording.period
    offset = OFFSET.get(channel.type, 0.2)
    quats = [channel] if channel.type == enums.FRAMEQUAT else quats
    ordered = tuple(_of(reading, quats[0].sensor) for reading in ORDERS) if quats else ()
    plain = {_of(reading, name): expect for reading, expect in tried.items()}
    axes, clock = _of(AXES, name), _of(CLOCK, name)

    def parts(reading: Reading, group: int, width: int) -> Parts:
        order = list(ORDERS)[ordered.index(reading)] if reading in ordered else DECLARED
        expect = plain.get(reading, lambda e: e.value)
        both = zip(log.groups[group], expected(order, group, width)[name], strict=True)
        return [(_shown(log, run, channel, order, width), expect(one)) for run, one in both]

    def left(reading: Reading, group: int) -> Left:
        within = allowed(reading, clock)
        several = [parts(reading, group, width) for width in SMOOTHERS]
        if reading == axes:
            return least(_permuted(one, period, offset) for one in several)
        return least(compared(one, period, within, SCALE, offset) for one in several)

    slack = MODEL_ERROR if channel.type in (enums.FORCE, enums.TORQUE) or _loose(log, channel) else 0.0
    readings = (*plain, axes, *ordered, clock)
    return Tie(f"'{name}' and the motion that the positions show", log.names, readings, left, slack, prompt=True)


def _loose(log: Log, channel: Channel) -> bool:
    """Whether an acceleration is of a body whose position is not measured."""
    return channel.type == enums.ACCELEROMETER and any(len(place) == 4 for place in log.columns().values())


def _of(reading: Reading, name: str) -> Reading:
    """A reading of a sensor that the line calls by its name."""
    words = reading.cause.removeprefix("it ") if reading.cause.startswith("it ") else ""
    own = f"'{name}' {words}" if words else f"of '{name}' {reading.cause.removeprefix('its ')}"
    return replace(reading, cause=own if reading.cause.startswith(("it ", "its ")) else reading.cause)


def _shown(log: Log, run: int, channel: Channel, order: Reading, width: int) -> np.ndarray:
    """What a sensor read in a run, (T, 3), as smooth as what is expected; of an orientation, the rate of turning."""
    measured = log.recording.runs[run].measured[:, log.places[channel.sensor]]
    if channel.type == enums.FRAMEQUAT:
        return turns(in_order(measured, order) if order in ORDERS else measured, log.recording.period, width)[1]
    return np.column_stack([derivative(filled(c), log.recording.period, 0, width) for c in measured.T])


def _permuted(parts: Parts, period: float, offset: float) -> Left:
    """What is left if the axes are exchanged or reversed in the way that fits best; nothing but the declared: all."""
    lengths = [tuple(np.linalg.norm(one, axis=1, keepdims=True) for one in both) for both in parts]
    delay = lag(lengths, period, (-LATE, LATE))
    y, p = shifted(parts, delay)
    if len(y) < 8:
        return NOTHING
    both = y.T @ p
    order = linear_sum_assignment(-np.abs(both))[1]
    signs = np.sign(both[np.arange(len(order)), order])
    if (order == np.arange(len(order))).all() and (signs > 0).all():
        return NOTHING
    return fitted(y, p[:, order] * signs, SCALE, offset, delay * period)
