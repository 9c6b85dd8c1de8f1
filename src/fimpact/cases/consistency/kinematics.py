"""How a log is compared with the kinematics of its model, and the tie of each joint's speed and position.

What several ties share is here: the log as they see it, the delay at which two signals agree best, and what is then
left unexplained. What sensors must read is in `sensor_ties`, what servos were told to do in `servo_ties`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import mujoco
import numpy as np
from scipy import fft

from fimpact.cases import enums
from fimpact.cases.channels import Channel
from fimpact.cases.consistency.measured_motion import SMOOTHERS, derivative, filled, position_sources
from fimpact.cases.consistency.ties import PUNCTUAL, Left, Reading, Tie, least, unexplained
from fimpact.cases.initial_state import position_columns
from fimpact.recordings import Recording

SCALE = 1.3  # a sensor's own scale may be this much off, and its axes lean by the sine of 0.3
LATE = 0.1  # s: a sensor's own delay; it is looked for by a diagnosis, and no other clock
APART = 2.0  # s: clocks that are further apart are not sought
DEGREES, RPM, THOUSAND = 180 / np.pi, 30 / np.pi, 1000.0
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
            if channel.type == enums.FRAMEQUAT and _straight(self.model, channel.sensor):
                turned[body_of(self.model, channel.sensor)] = self.places[channel.sensor]
        return position_sources(self.model, position_columns(self.model, self.seen), turned)


Parts = list[tuple[np.ndarray, np.ndarray]]  # of each run: what was measured (T, k), and what should have been


def compared(parts: Parts, period: float, within: tuple[float, float], scale: float, offset: float) -> Left:
    """What is left of measured vectors at the best delay `within` two, s, with each component of the expected ones
    scaled, leaning and offset as an honest sensor is."""
    delay = lag(parts, period, within)
    y, p = shifted(parts, delay)
    return fitted(y, p, scale, offset, delay * period)


def fitted(y: np.ndarray, p: np.ndarray, scale: float, offset: float, delay: float) -> Left:
    """What is left of measured vectors `y`, (T, k), at a delay, s, that is already taken out."""
    lean, ones = scale - 1, np.ones(len(y))
    rows = []
    for k in range(y.shape[1]):
        own = [(p[:, j], 1 / scale, scale) if j == k else (p[:, j], -lean, lean) for j in range(p.shape[1])]
        rows.append((y[:, k], [*own, (ones, -offset, offset)]))
    return unexplained(rows, delay)


def shifted(parts: Parts, delay: int) -> tuple[np.ndarray, np.ndarray]:
    """Measured `delay` samples later than expected, where both are known."""
    both = [(y[max(0, delay) : len(y) + min(0, delay)], p[max(0, -delay) : len(p) - max(0, delay)]) for y, p in parts]
    y, p = (np.concatenate(one) for one in zip(*both, strict=True))
    known = np.isfinite(y).all(axis=1) & np.isfinite(p).all(axis=1)
    return y[known], p[known]


def lag(parts: Parts, period: float, within: tuple[float, float]) -> int:
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


def allowed(reading: Reading, clock: Reading) -> tuple[float, float]:
    """Delays, s, that a reading allows."""
    return {clock: (-APART, APART), PUNCTUAL: (0.0, 0.0)}.get(reading, (-LATE, LATE))


def body_of(model: mujoco.MjModel, name: str) -> int:
    """The body that a sensor of a body or a site is on; -1: of another kind of object."""
    sensor = model.sensor(name)
    kind, at = int(sensor.objtype[0]), int(sensor.objid[0])
    return int(model.site_bodyid[at]) if kind == enums.SITE else at if kind in (enums.BODY, enums.XBODY) else -1


def _straight(model: mujoco.MjModel, name: str) -> bool:
    """Whether the axes of a sensor are those of its body."""
    sensor = model.sensor(name)
    kind, at = int(sensor.objtype[0]), int(sensor.objid[0])
    turn = {enums.SITE: model.site_quat, enums.BODY: model.body_iquat}.get(kind)
    return kind == enums.XBODY or (turn is not None and abs(turn[at, 0]) == 1.0)


def reordered(log: Log, measured: np.ndarray, order: Reading) -> np.ndarray:
    """`measured` (T, ny) with every orientation read in another order."""
    if order not in ORDERS:
        return measured
    out = measured.copy()
    for channel in log.seen:
        if channel.type == enums.FRAMEQUAT:
            place = log.places[channel.sensor]
            out[:, place] = in_order(measured[:, place], order)
    return out


def in_order(quats: np.ndarray, order: Reading) -> np.ndarray:
    """Quaternions (T, 4), their columns read in another order or inverted."""
    places, sign = ORDERS[order]
    return quats[:, places] * np.array([1, sign, sign, sign])


def speed_ties(log: Log) -> Iterator[Tie]:
    """The speed of each joint against the derivative of its position, and against those of the other joints."""
    positions = {c.joint: c.sensor for c in log.seen if c.type == enums.JOINTPOS}
    for channel in log.seen:
        if channel.type == enums.JOINTVEL and channel.joint in positions:
            yield _speed_tie(log, channel, positions)


def _speed_tie(log: Log, channel: Channel, positions: dict[str, str]) -> Tie:
    speed, position, period = channel.sensor, positions[channel.joint], log.recording.period
    others = [name for joint, name in positions.items() if joint != channel.joint]
    swaps = {Reading(f"it is that of '{o}': columns are swapped", "swapped", "exchange them"): o for o in others}
    hinge = log.model.joint(channel.joint).type[0] == enums.HINGE
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
        within = allowed(reading, CLOCK)
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
