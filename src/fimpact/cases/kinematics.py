"""Ties of kinematics: what each sensor must read in the measured motion, and what servos were told to do."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache

import mujoco
import numpy as np
from scipy import fft
from scipy.optimize import linear_sum_assignment

from fimpact.cases import kinds
from fimpact.cases.channels import Channel
from fimpact.cases.motion import SMOOTHERS, Motion, derivative, filled, moved, position_sources, turns
from fimpact.cases.start import position_columns
from fimpact.cases.ties import DECLARED, MODEL_ERROR, NOTHING, PUNCTUAL, Left, Reading, Tie, least, unexplained
from fimpact.recordings import Recording

SCALE = 1.3  # a sensor's own scale may be this much off, and its axes lean by the sine of 0.3
LATE = 0.1  # s: a sensor's own delay; it is looked for by a diagnosis, and no other clock
SERVO = 2.0  # a servo under load may go that many times too far or short
APART = 2.0  # s: clocks that are further apart are not sought
SAMPLES = 1500  # in which the model is placed
DEGREES, RPM, THOUSAND = 180 / np.pi, 30 / np.pi, 1000.0
OFFSET = {kinds.ACCELEROMETER: 1.0, kinds.FORCE: np.inf, kinds.TORQUE: np.inf, kinds.FRAMEPOS: np.inf}  # honest, SI
ORDERS = {  # columns of an orientation in the order in which they would be w, x, y, z, and a sign of x, y, z
    Reading("its columns are x, y, z, w, as ROS writes them", "order", "list them w, x, y, z"): ((3, 0, 1, 2), 1),
    Reading("it is inverted (of the world in the body)", "order", "invert it: the signs of x, y, z"): (
        (0, 1, 2, 3),
        -1,
    ),
}
CLOCK = Reading("the clocks of the two differ", "clock", "correct the time of one of them")


@dataclass(frozen=True)
class Log:
    """A recording on its grid, as ties see it: its runs in at most `GROUPS` groups that are judged one by one."""

    recording: Recording
    model: mujoco.MjModel
    seen: list[Channel]
    groups: tuple[tuple[int, ...], ...]
    places: dict[str, list[int]] = field(default_factory=dict)

    GROUPS = 10

    @staticmethod
    def of(recording: Recording, model: mujoco.MjModel, seen: list[Channel]) -> "Log":
        """The log of a recording."""
        parts = np.array_split(np.arange(len(recording.runs)), min(Log.GROUPS, len(recording.runs)))
        ends = np.cumsum([len(one.columns) for one in seen])
        places = {one.sensor: list(range(end - len(one.columns), end)) for one, end in zip(seen, ends, strict=True)}
        return Log(recording, model, seen, tuple(tuple(map(int, part)) for part in parts), places)

    @property
    def names(self) -> tuple[str, ...]:
        """Of each group: that of its run, or of its first and last."""
        name = [run.name for run in self.recording.runs]
        return tuple(name[g[0]] if len(g) == 1 else f"{name[g[0]]}' to '{name[g[-1]]}" for g in self.groups)

    def columns(self) -> dict[str, list[int]]:
        """Columns of the position of each joint that is measured, and of the orientation of each such free one."""
        turned = {}
        for channel in self.seen:
            if channel.type == kinds.FRAMEQUAT and _straight(self.model, channel.sensor):
                turned[body_of(self.model, channel.sensor)] = self.places[channel.sensor]
        return position_sources(self.model, position_columns(self.model, self.seen), turned)


Parts = list[tuple[np.ndarray, np.ndarray]]  # of each run: what was measured (T, k), and what should have been


def compared(parts: Parts, period: float, within: tuple[float, float], scale: float, offset: float) -> Left:
    """What is left of measured vectors at the best delay `within` two, s, with each component of the expected ones
    scaled, leaning and offset as an honest sensor is."""
    delay = _delay(parts, period, within)
    y, p = _shifted(parts, delay)
    return _fitted(y, p, scale, offset, delay * period)


def _fitted(y: np.ndarray, p: np.ndarray, scale: float, offset: float, delay: float) -> Left:
    lean, ones = scale - 1, np.ones(len(y))
    rows = []
    for k in range(y.shape[1]):
        own = [(p[:, j], 1 / scale, scale) if j == k else (p[:, j], -lean, lean) for j in range(p.shape[1])]
        rows.append((y[:, k], [*own, (ones, -offset, offset)]))
    return unexplained(rows, delay)


def _shifted(parts: Parts, delay: int) -> tuple[np.ndarray, np.ndarray]:
    """Measured `delay` samples later than expected, where both are known."""
    both = [(y[max(0, delay) : len(y) + min(0, delay)], p[max(0, -delay) : len(p) - max(0, delay)]) for y, p in parts]
    y, p = (np.concatenate(one) for one in zip(*both, strict=True))
    known = np.isfinite(y).all(axis=1) & np.isfinite(p).all(axis=1)
    return y[known], p[known]


def _delay(parts: Parts, period: float, within: tuple[float, float]) -> int:
    """Samples by which the measured come later than the expected, where they correlate best."""
    low, high = (int(np.round(one / period)) for one in within)
    size = fft.next_fast_len(2 * max(len(y) for y, _ in parts) - 1, real=True)
    low, high = max(low, -size // 6), min(high, size // 6)
    both, one, other = (np.zeros(size) for _ in range(3))
    for y, p in parts:
        (y, seen), (p, known) = _centred(y), _centred(p)
        both += sum(_correlated(y[:, k], p[:, k], size) for k in range(y.shape[1]))
        one += _correlated(np.sum(y**2, axis=1), known, size)
        other += _correlated(seen, np.sum(p**2, axis=1), size)
    shifts = np.arange(low, high + 1)
    power = np.maximum(one * other, 0.0)[shifts]
    alike = np.where(power > 1e-12 * power.max(initial=0.0), both[shifts] / np.sqrt(np.maximum(power, 1e-300)), -1.0)
    best = np.flatnonzero(alike >= alike.max() - 1e-9)
    return int(shifts[best[np.argmin(np.abs(shifts[best]))]])


def _centred(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vectors (T, k) about their mean, 0 where they are not known, and where they are, (T,)."""
    known = np.isfinite(values).all(axis=1)
    out = np.zeros_like(values)
    if known.any():
        out[known] = values[known] - values[known].mean(axis=0)
    return out, known.astype(float)


def _correlated(late: np.ndarray, early: np.ndarray, size: int) -> np.ndarray:
    """Sum of products by the samples that one comes later, negative ones at the end."""
    return fft.irfft(fft.rfft(late, size) * np.conj(fft.rfft(early, size)), size)


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
    kinds.GYRO: PLAIN | ANGULAR | IN_WORLD,
    kinds.FRAMEANGVEL: PLAIN | ANGULAR | IN_OWN,
    kinds.ACCELEROMETER: PLAIN | WEIGHTLESS | IN_WORLD,
    kinds.VELOCIMETER: PLAIN | IN_WORLD,
    kinds.FRAMELINVEL: PLAIN | IN_OWN,
    kinds.FRAMEPOS: PLAIN,
    kinds.FORCE: PLAIN | IN_WORLD,
    kinds.TORQUE: PLAIN | IN_WORLD,
    kinds.FRAMEQUAT: {},
}


def sensor_ties(log: Log) -> Iterator[Tie]:
    """Each vector sensor against what it must read in the motion that the positions show."""
    columns = log.columns()
    sources = {name for place in columns.values() for name in log.places if set(log.places[name]) <= set(place)}
    asked = [c for c in log.seen if c.type in TRIED and c.sensor not in sources and placed(log, c, columns)]
    if not asked:
        return
    expected = _expectations(log, asked, columns)
    quats = [c for c in log.seen if c.type == kinds.FRAMEQUAT and c.sensor in sources]
    for channel in asked:
        yield _sensor_tie(log, channel, expected, quats)


def placed(log: Log, channel: Channel, columns: dict[str, list[int]]) -> bool:
    """Whether the positions of all joints that a sensor hangs on are measured; of a force, of all joints."""
    model = log.model
    body = body_of(model, channel.sensor)
    bodies = set(range(model.nbody)) if channel.type in (kinds.FORCE, kinds.TORQUE) else set()
    while body > 0:
        bodies.add(body)
        body = int(model.body_parentid[body])
    hung = [j for j in range(model.njnt) if int(model.jnt_bodyid[j]) in bodies]
    half = {name for name, place in columns.items() if len(place) == 4}
    straight = channel.type in (kinds.FRAMEPOS, kinds.FRAMELINVEL, kinds.VELOCIMETER, kinds.FORCE, kinds.TORQUE)
    return bool(hung) and all(
        model.joint(j).name in columns and not (straight and model.joint(j).name in half) for j in hung
    )


def body_of(model: mujoco.MjModel, name: str) -> int:
    """The body that a sensor of a body or a site is on; -1: of another kind of object."""
    sensor = model.sensor(name)
    kind, at = int(sensor.objtype[0]), int(sensor.objid[0])
    return int(model.site_bodyid[at]) if kind == kinds.SITE else at if kind in (kinds.BODY, kinds.XBODY) else -1


def _straight(model: mujoco.MjModel, name: str) -> bool:
    """Whether the axes of a sensor are those of its body."""
    sensor = model.sensor(name)
    kind, at = int(sensor.objtype[0]), int(sensor.objid[0])
    turn = {kinds.SITE: model.site_quat, kinds.BODY: model.body_iquat}.get(kind)
    return kind == kinds.XBODY or (turn is not None and abs(turn[at, 0]) == 1.0)


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


def reordered(log: Log, measured: np.ndarray, order: Reading) -> np.ndarray:
    """`measured` (T, ny) with every orientation read in another order."""
    if order not in ORDERS:
        return measured
    out = measured.copy()
    for channel in log.seen:
        if channel.type == kinds.FRAMEQUAT:
            place = log.places[channel.sensor]
            out[:, place] = _order(measured[:, place], order)
    return out


def _order(quats: np.ndarray, order: Reading) -> np.ndarray:
    places, sign = ORDERS[order]
    return quats[:, places] * np.array([1, sign, sign, sign])


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
    if sensor.type[0] != kinds.FRAMEQUAT:
        return data.sensor(name).data
    mujoco.mj_objectVelocity(model, data, int(sensor.objtype[0]), int(sensor.objid[0]), rate, 1)
    return rate[:3]


def _axes(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> np.ndarray:
    sensor = model.sensor(name)
    kind, at = int(sensor.objtype[0]), int(sensor.objid[0])
    if kind == kinds.SITE:
        return data.site_xmat[at].reshape(3, 3)
    return (data.xmat if kind == kinds.XBODY else data.ximat)[at].reshape(3, 3)


def _sensor_tie(log: Log, channel: Channel, expected, quats: list[Channel]) -> Tie:
    tried, name, period = TRIED[channel.type], channel.sensor, log.recording.period
    offset = OFFSET.get(channel.type, 0.2)
    quats = [channel] if channel.type == kinds.FRAMEQUAT else quats
    ordered = tuple(_of(reading, quats[0].sensor) for reading in ORDERS) if quats else ()
    plain = {_of(reading, name): expect for reading, expect in tried.items()}
    axes, clock = _of(AXES, name), _of(CLOCK, name)

    def parts(reading: Reading, group: int, width: int) -> Parts:
        order = list(ORDERS)[ordered.index(reading)] if reading in ordered else DECLARED
        expect = plain.get(reading, lambda e: e.value)
        both = zip(log.groups[group], expected(order, group, width)[name], strict=True)
        return [(_shown(log, run, channel, order, width), expect(one)) for run, one in both]

    def left(reading: Reading, group: int) -> Left:
        within = _within(reading, clock)
        several = [parts(reading, group, width) for width in SMOOTHERS]
        if reading == axes:
            return least(_permuted(one, period, offset) for one in several)
        return least(compared(one, period, within, SCALE, offset) for one in several)

    slack = MODEL_ERROR if channel.type in (kinds.FORCE, kinds.TORQUE) or _loose(log, channel) else 0.0
    readings = (*plain, axes, *ordered, clock)
    return Tie(f"'{name}' and the motion that the positions show", log.names, readings, left, slack, prompt=True)


def _loose(log: Log, channel: Channel) -> bool:
    """Whether an acceleration is of a body whose position is not measured."""
    return channel.type == kinds.ACCELEROMETER and any(len(place) == 4 for place in log.columns().values())


def _within(reading: Reading, clock: Reading) -> tuple[float, float]:
    """Delays, s, that a reading allows."""
    return {clock: (-APART, APART), PUNCTUAL: (0.0, 0.0)}.get(reading, (-LATE, LATE))


def _of(reading: Reading, name: str) -> Reading:
    """A reading of a sensor that the line calls by its name."""
    words = reading.cause.removeprefix("it ") if reading.cause.startswith("it ") else ""
    own = f"'{name}' {words}" if words else f"of '{name}' {reading.cause.removeprefix('its ')}"
    return replace(reading, cause=own if reading.cause.startswith(("it ", "its ")) else reading.cause)


def _shown(log: Log, run: int, channel: Channel, order: Reading, width: int) -> np.ndarray:
    """What a sensor read in a run, (T, 3), as smooth as what is expected; of an orientation, the rate of turning."""
    measured = log.recording.runs[run].measured[:, log.places[channel.sensor]]
    if channel.type == kinds.FRAMEQUAT:
        return turns(_order(measured, order) if order in ORDERS else measured, log.recording.period, width)[1]
    return np.column_stack([derivative(filled(c), log.recording.period, 0, width) for c in measured.T])


def _permuted(parts: Parts, period: float, offset: float) -> Left:
    """What is left if the axes are exchanged or reversed in the way that fits best; nothing but the declared: all."""
    lengths = [tuple(np.linalg.norm(one, axis=1, keepdims=True) for one in both) for both in parts]
    delay = _delay(lengths, period, (-LATE, LATE))
    y, p = _shifted(parts, delay)
    if len(y) < 8:
        return NOTHING
    both = y.T @ p
    order = linear_sum_assignment(-np.abs(both))[1]
    signs = np.sign(both[np.arange(len(order)), order])
    if (order == np.arange(len(order))).all() and (signs > 0).all():
        return NOTHING
    return _fitted(y, p[:, order] * signs, SCALE, offset, delay * period)


def speed_ties(log: Log) -> Iterator[Tie]:
    """The speed of each joint against the derivative of its position, and against those of the other joints."""
    positions = {c.joint: c.sensor for c in log.seen if c.type == kinds.JOINTPOS}
    for channel in log.seen:
        if channel.type == kinds.JOINTVEL and channel.joint in positions:
            yield _speed_tie(log, channel, positions)


def _speed_tie(log: Log, channel: Channel, positions: dict[str, str]) -> Tie:
    speed, position, period = channel.sensor, positions[channel.joint], log.recording.period
    others = [name for joint, name in positions.items() if joint != channel.joint]
    swaps = {Reading(f"it is that of '{o}': columns are swapped", "swapped", "exchange them"): o for o in others}
    hinge = log.model.joint(channel.joint).type[0] == kinds.HINGE
    causes = FACTORS | ANGLES if hinge else FACTORS
    unsigned = Reading(f"'{speed}' has no sign", "sign", "give it the sign of the motion, or leave it out")

    def parts(reading: Reading, group: int, width: int) -> Parts:
        out = []
        for run in log.groups[group]:
            measured = log.recording.runs[run].measured
            of = log.places[swaps.get(reading, position)][0]
            rate = derivative(filled(measured[:, of]), period, 1, width) * causes.get(reading, 1.0)
            rate = np.abs(rate) if reading == unsigned else rate
            shown = derivative(filled(measured[:, log.places[speed][0]]), period, 0, width)
            out.append((shown[:, None], rate[:, None]))
        return out

    def left(reading: Reading, group: int) -> Left:
        within = _within(reading, CLOCK)
        return least(compared(parts(reading, group, w), period, within, SCALE, 0.0) for w in SMOOTHERS)

    what = f"the speed '{speed}' and the derivative of '{position}'"
    return Tie(what, log.names, (*causes, *swaps, unsigned, CLOCK), left, prompt=True)


FACTORS = {  # speed over the derivative of the position, and what it tells
    Reading(
        "a unit is wrong by 1000: the speed is too large, or the position too small or the time too large",
        "units",
        "correct the unit",
    ): THOUSAND,
    Reading(
        "a unit is wrong by 1000: the speed is too small, or the position too large or the time too small",
        "units",
        "correct the unit",
    ): 1 / THOUSAND,
    Reading("one of them has the wrong sign", "sign", "use `scale: -1`"): -1.0,
}
ANGLES = {
    Reading("the position is in degrees but declared as radians", "units", "correct the unit"): 1 / DEGREES,
    Reading(
        "the position is in radians but declared as degrees, or the speed in degrees but declared as radians",
        "units",
        "correct the unit",
    ): DEGREES,
    Reading("the position is in revolutions but declared as radians", "units", "correct the unit"): 2 * np.pi,
    Reading("the speed is in rpm but declared as rad/s", "units", "correct the unit"): RPM,
}
SERVO_LATE = 0.3  # s: of a servo that is slow, filtered or told over a bus
AHEAD = Reading(
    "commands and measurements are exchanged, or the clock of the commands is late: the motion comes before what was "
    "told",
    "swapped",
    "exchange the columns, or correct their time",
)


def servo_ties(log: Log) -> Iterator[Tie]:
    """The target of each position or velocity servo against what its joint did."""
    told = {}
    for actuator in range(log.model.nu):
        target = _target(log, actuator)
        if target:
            told[actuator] = target
    for actuator in told:
        yield _cause_tie(log, actuator, told[actuator])
        yield _servo_tie(log, actuator, told)


@dataclass(frozen=True)
class Target:
    """What a servo is told: the columns of its joint, whose derivative that is, and its control in units of those."""

    sensor: str
    joint: str
    rate: bool
    per_control: float


def _target(log: Log, actuator: int) -> Target | None:
    model = log.model
    bias, gain = model.actuator_biasprm[actuator], model.actuator_gainprm[actuator, 0]
    kind, fixed = int(model.actuator_biastype[actuator]), int(model.actuator_gaintype[actuator])
    if int(model.actuator_trntype[actuator]) not in kinds.AT_JOINT or (kind, fixed) != (kinds.AFFINE, kinds.FIXED):
        return None
    joint = model.joint(int(model.actuator_trnid[actuator, 0])).name
    gear, rate = model.actuator_gear[actuator, 0], bias[1] == 0
    follows = -bias[2] if rate else -bias[1]
    wanted = [c for c in log.seen if c.joint == joint]
    chosen = [c for c in wanted if (c.type == kinds.JOINTVEL) == rate] or (wanted if rate else [])
    if not chosen or not gear or follows <= 0:
        return None
    derived = rate and chosen[0].type == kinds.JOINTPOS
    return Target(chosen[0].sensor, joint, derived, gain / follows / gear)


def _servo_tie(log: Log, actuator: int, told: dict[int, Target]) -> Tie:
    target, name, period = told[actuator], log.model.actuator(actuator).name, log.recording.period
    swaps = {
        Reading(f"it is told to '{log.model.actuator(o).name}': columns are swapped", "swapped", "exchange them"): o
        for o in told
        if o != actuator and told[o].rate == target.rate
    }
    factors = _servo_factors(log, target, name)

    def left(reading: Reading, group: int) -> Left:
        within = (-APART, APART) if reading == CLOCK else (0.0, SERVO_LATE)
        of = swaps.get(reading, actuator)
        scale = told[of].per_control * factors.get(reading, 1.0)
        return _varying(_told_and_done(log, group, target, of, scale), period, within)

    what = f"the command of '{name}' and '{target.sensor}'"
    return Tie(what, log.names, (*factors, *swaps, CLOCK), left, MODEL_ERROR)


def _cause_tie(log: Log, actuator: int, target: Target) -> Tie:
    """An effect comes after its cause: the law has no error of its own."""
    period = log.recording.period

    def left(reading: Reading, group: int) -> Left:
        within = (-SERVO_LATE, -2 * period) if reading == AHEAD else (0.0, SERVO_LATE)
        return _varying(_told_and_done(log, group, target, actuator, target.per_control), period, within)

    what = f"the command of '{log.model.actuator(actuator).name}' and '{target.sensor}', which follows it,"
    return Tie(what, log.names, (AHEAD,), left)


def _told_and_done(log: Log, group: int, target: Target, actuator: int, scale: float) -> Parts:
    out = []
    for run in (log.recording.runs[run] for run in log.groups[group]):
        did = filled(run.measured[:, log.places[target.sensor][0]])
        did = derivative(did, log.recording.period, 1) if target.rate else did
        out.append((did[:, None], scale * run.ctrl[:, [actuator]]))
    return out


def _servo_factors(log: Log, target: Target, name: str) -> dict[Reading, float]:
    """Measured over told, and what it tells."""
    out = {
        Reading(f"'{target.sensor}' or the command of '{name}' has the wrong sign", "sign", "use `scale: -1`"): -1.0,
        Reading(f"the unit of '{target.sensor}' or of the command of '{name}' is wrong by 1000", "units"): THOUSAND,
        Reading(f"the unit of the command of '{name}' or of '{target.sensor}' is wrong by 1000", "units"): 1 / THOUSAND,
    }
    if log.model.joint(target.joint).type[0] == kinds.HINGE:
        here, there = f"'{target.sensor}'", f"the command of '{name}'"
        for one, other, factor in ((here, there, DEGREES), (there, here, 1 / DEGREES)):
            cause = f"{one} is in degrees but declared as radians, or {other} is in radians but declared as degrees"
            out[Reading(cause, "units", "correct the unit")] = factor
    return out


def _varying(parts: Parts, period: float, within: tuple[float, float]) -> Left:
    """As `compared`, of what varies alone: under load a servo stands off its target."""
    delay = _delay(parts, period, within)
    y, p = _shifted(parts, delay)
    if len(y) < 8:
        return NOTHING
    y, p = y - y.mean(axis=0), p - p.mean(axis=0)
    return unexplained([(y[:, 0], [(p[:, 0], 1 / SERVO, SERVO)])], delay * period)
