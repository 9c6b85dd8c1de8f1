"""Ways in which the positions and the commands may have been read wrongly: units, signs, two of them exchanged."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import mujoco
import numpy as np

from fimpact.cases import enums
from fimpact.cases.consistency.kinematics import Log
from fimpact.cases.consistency.measured_motion import Motion
from fimpact.cases.consistency.ties import DECLARED, Reading

DEGREE = np.pi / 180
TURNS, SMALLEST = 4 * np.pi, 0.02  # rad: how far a joint without limits goes at most, and any that is logged at least
COUNT = 2 * np.pi / 4096  # of the usual encoder of a hobby servo
UNIT, SIGN = "correct the unit", "use `scale: -1`"


@dataclass(frozen=True)
class Positions:
    """How positions are read. scales: factor and offset of joints. swapped: two of them. time: factor."""

    order: Reading = DECLARED
    scales: tuple[tuple[str, float, float], ...] = ()
    swapped: tuple[str, str] | None = None
    time: float = 1.0

    def states(self, model: mujoco.MjModel, motion: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions, speeds and accelerations of a motion, read so."""
        q, v, a = motion.q.copy(), motion.v / self.time, motion.a / self.time**2
        for joint, factor, offset in self.scales:
            at, dof = model.joint(joint).qposadr[0], model.joint(joint).dofadr[0]
            q[:, at] = q[:, at] * factor + offset
            v[:, dof] *= factor
            a[:, dof] *= factor
        if self.swapped:
            at, dof = ([getattr(model.joint(name), key)[0] for name in self.swapped] for key in ("qposadr", "dofadr"))
            for values, pair in ((q, at), (v, dof), (a, dof)):
                values[:, pair] = values[:, pair[::-1]]
        return q, v, a


@dataclass(frozen=True)
class Misreading(Reading):
    """How positions and commands are read. factors: of commands. swapped: two of them. unsigned: one without sign."""

    positions: Positions = Positions()
    factors: tuple[tuple[int, float], ...] = ()
    swapped: tuple[int, int] | None = None
    unsigned: int | None = None

    def commands(self, ctrl: np.ndarray) -> np.ndarray:
        """Commands (n, nu), read so."""
        out = ctrl.copy()
        for actuator, factor in self.factors:
            out[:, actuator] *= factor
        if self.swapped:
            out[:, list(self.swapped)] = out[:, list(self.swapped[::-1])]
        return out


def misread(reading: Reading) -> Misreading:
    """The misreading that a reading is; one of an orientation's order is that of positions."""
    if isinstance(reading, Misreading):
        return reading
    return Misreading(reading.cause, reading.doubt, reading.remedy, Positions(order=reading))


def misreadings(log: Log) -> Iterator[Misreading]:
    """Every misreading that is tried, the likeliest first."""
    columns = {name: place[0] for name, place in log.columns().items() if len(place) == 1}
    for joint, column in columns.items():
        yield from _joint_readings(log, joint, np.concatenate([run.measured[:, column] for run in log.recording.runs]))
    hinges = [joint for joint in columns if log.model.joint(joint).type[0] == enums.HINGE]
    if len(hinges) > 1:
        every = Positions(scales=tuple((joint, DEGREE, 0.0) for joint in hinges))
        yield Misreading("the angles are in degrees but declared as radians", "units", UNIT, every)
    yield from _command_readings(log)
    ways = (("in ms but declared as s", 1e-3), ("in s but declared as ms", 1e3))
    for way, factor in ways:
        yield Misreading(f"the time is {way} (wrong by 1000)", "units", UNIT, Positions(time=factor))
    for one, other in combinations(columns, 2):
        if log.model.joint(one).type == log.model.joint(other).type:
            cause = f"the measurements of '{one}' and '{other}' are swapped"
            yield Misreading(cause, "swapped", "exchange them", Positions(swapped=(one, other)))


def _joint_readings(log: Log, name: str, values: np.ndarray) -> Iterator[Misreading]:
    """Of one joint with these measured `values`: those under which it would stay where it can be, and move."""
    hinge = log.model.joint(name).type[0] == enums.HINGE
    limited = bool(log.model.jnt_limited[log.model.joint(name).id])
    low, high = log.model.joint(name).range if limited else (-TURNS, TURNS) if hinge else (-np.inf, np.inf)
    slack = 0.1 * (high - low) if np.isfinite(low) else 0.0
    least, most = np.nanmin(values), np.nanmax(values)
    for cause, doubt, remedy, factor, offset in _scales(name, hinge, (low, high) if limited else None):
        ends = sorted((least * factor + offset, most * factor + offset))
        if low - slack <= ends[0] and ends[1] <= high + slack and (ends[1] - ends[0] > SMALLEST or not hinge):
            yield Misreading(cause, doubt, remedy, Positions(scales=((name, factor, offset),)))


def _scales(name: str, hinge: bool, limits: tuple[float, float] | None) -> Iterator[tuple[str, str, str, float, float]]:
    """Cause, kind, remedy, factor and offset of other ways to read a joint."""
    if hinge:
        yield f"the angle of '{name}' is in degrees but declared as radians", "units", UNIT, DEGREE, 0.0
        yield f"the angle of '{name}' is in radians but declared as degrees", "units", UNIT, 1 / DEGREE, 0.0
        yield f"the angle of '{name}' is in mrad but declared as radians (wrong by 1000)", "units", UNIT, 1e-3, 0.0
        yield f"the angle of '{name}' is in counts of 4096 around 2048", "units", UNIT, COUNT, -np.pi
    else:
        yield f"the unit of '{name}' is wrong by 1000 (mm declared as m)", "units", UNIT, 1e-3, 0.0
        yield f"the unit of '{name}' is wrong by 1000 (m declared as mm)", "units", UNIT, 1e3, 0.0
    low, high = limits or (0.0, 0.0)
    for least, most in ((-100, 100), (0, 100)) if limits else ():
        gain = (high - low) / (most - least)
        cause = f"'{name}' is normalised to {least}..{most} over the joint's range"
        remedy = f"write `unit: percent, gain: {gain:.5g} {'rad' if hinge else 'm'}/percent`"
        yield cause, "units", remedy, gain, low - gain * least
    yield f"'{name}' has the wrong sign", "sign", SIGN, -1.0, 0.0


def _command_readings(log: Log) -> Iterator[Misreading]:
    model = log.model
    names = [model.actuator(actuator).name for actuator in range(model.nu)]
    ctrl = np.concatenate([run.ctrl for run in log.recording.runs])
    for actuator, name in enumerate(names):
        for factor, size in ((1e-3, "large"), (1e3, "small")):
            cause = f"the unit of the command of '{name}' is wrong by 1000 (too {size})"
            yield Misreading(cause, "units", UNIT, factors=((actuator, factor),))
        cause = f"the command of '{name}' has the wrong sign"
        yield Misreading(cause, "sign", SIGN, factors=((actuator, -1.0),))
        if ctrl[:, actuator].min() >= 0 or ctrl[:, actuator].max() <= 0:
            cause = f"the command of '{name}' has a size but no direction"
            yield Misreading(cause, "sign", "log it with its sign", unsigned=actuator)
    for factor, size in ((1e-3, "large"), (1e3, "small")):
        if model.nu > 1:
            every = tuple((actuator, factor) for actuator in range(model.nu))
            yield Misreading(f"the unit of all commands is wrong by 1000 (too {size})", "units", UNIT, factors=every)
    for one, other in combinations(range(model.nu), 2):
        cause = f"the commands of '{names[one]}' and '{names[other]}' are swapped"
        yield Misreading(cause, "swapped", "exchange them", swapped=(one, other))
