"""Measured channels and commands: the MJCF sensor or actuator of each column, and its factor to SI units."""

import re
from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.cases import enums
from fimpact.cases.errors import CaseError, one_of
from fimpact.cases.models.naive import Naive
from fimpact.cases.units import factor

UNITS = {
    enums.FRAMEPOS: "m",
    enums.FRAMEQUAT: "1",
    enums.BALLQUAT: "1",
    enums.FRAMELINVEL: "m/s",
    enums.FRAMEANGVEL: "rad/s",
    enums.VELOCIMETER: "m/s",
    enums.GYRO: "rad/s",
    enums.ACCELEROMETER: "m/s^2",
    enums.FORCE: "N",
    enums.TORQUE: "N m",
    enums.TOUCH: "N",
    enums.FRAMELINACC: "m/s^2",
    enums.FRAMEANGACC: "rad/s^2",
    enums.BALLANGVEL: "rad/s",
    enums.RANGEFINDER: "m",
    enums.SUBTREECOM: "m",
    enums.SUBTREELINVEL: "m/s",
    enums.CLOCK: "s",
}


@dataclass(frozen=True)
class Channel:
    """One sensor of the model and its columns.

    columns: one per component. factor, offset: SI value = (number + offset) factor. noise: sd in SI, NaN where
    unknown. time: its own time column or None. type: of the sensor. joint: whose position or speed it is, or "".
    turns: whether it is the angle of a hinge.
    """

    sensor: str
    columns: tuple[str | int, ...]
    factor: float
    offset: float
    noise: float
    time: str | int | None
    type: int
    joint: str
    turns: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its components, as `Recording.channels` has them."""
        return component_names(self.sensor, len(self.columns))


@dataclass(frozen=True)
class Command:
    """One actuator and its column. steps: held between samples, as a command is; False for a measured torque."""

    actuator: str
    column: str | int
    factor: float
    offset: float
    time: str | int | None
    steps: bool


def span(unit: str) -> tuple[float, float] | None:
    """Read a unit such as ``-100..100``: the numbers that stand for the ends of a range of the MJCF."""
    number = r"\s*([-+]?\d+(?:\.\d+)?)\s*"
    found = re.fullmatch(rf"{number}\.\.{number}", unit)
    ends = (float(found[1]), float(found[2])) if found else None
    return ends if ends and ends[0] != ends[1] else None


def _within(entry: dict, ends: tuple[float, float], limits, limited: bool, where: str, whose: str):
    """Factor and offset of numbers that run from one end of a range of the MJCF to the other.

    Raises:
        CaseError: the MJCF has no such range, or the case converts a second time.
    """
    if not limited:
        raise CaseError(
            f"{where}.unit is '{entry['unit']}', a share of {whose}, but the MJCF gives it none; add it there, or "
            "declare a unit of the file"
        )
    for key in {"gain", "counts_per_rev"} & set(entry):
        raise CaseError(
            f"{where} has {key} and the unit '{entry['unit']}', which converts by {whose}; remove one of them"
        )
    scale, width = entry.get("scale", 1.0), (limits[1] - limits[0]) / (ends[1] - ends[0])
    if not scale:
        raise CaseError(f"{where}.scale is 0; allowed: any other number, such as -1 for a reversed axis; correct it")
    return float(scale * width), float(entry.get("offset", 0.0) + (limits[0] / width - ends[0]) / scale)


def component_names(sensor: str, dim: int) -> tuple[str, ...]:
    """A sensor's name, or that of each component of a vector sensor."""
    return (sensor,) if dim == 1 else tuple(f"{sensor}[{i}]" for i in range(dim))


def channels(model: mujoco.MjModel, measurements: dict) -> list[Channel]:
    """Every measurement with its sensor in the model, which has them all by now."""
    return [_channel(model, key, entry, f"measurements.{key}") for key, entry in measurements.items()]


def _channel(model: mujoco.MjModel, key: str, entry: dict, where: str) -> Channel:
    sensor = model.sensor(key)
    columns = [entry["column"]] if "column" in entry else entry.get("columns", [])
    if len(columns) != sensor.dim[0] or ("column" in entry and "columns" in entry):
        raise CaseError(
            f"{where} has {len(columns)} columns, but its sensor has {sensor.dim[0]} components; "
            f"give {'`column`' if sensor.dim[0] == 1 else '`columns`, a list of as many'}"
        )
    type_ = int(sensor.type[0])
    unit, joint = sensor_unit(model, key)
    if (ends := span(entry["unit"])) and type_ == enums.JOINTPOS:
        limits, limited = model.joint(joint).range, bool(model.jnt_limited[model.joint(joint).id])
        scale, offset = _within(entry, ends, limits, limited, where, f"the range of joint '{joint}'")
    else:
        offset = entry.get("offset", 0.0)
        scale = entry.get("scale", 1.0) * factor(
            entry["unit"], unit, where, entry.get("gain"), entry.get("counts_per_rev")
        )
    if not scale:
        raise CaseError(f"{where}.scale is 0; allowed: any other number, such as -1 for a reversed axis; correct it")
    noise = abs(scale) * entry.get("noise", np.nan)
    turns = type_ == enums.JOINTPOS and unit == "rad"
    return Channel(key, tuple(columns), scale, offset, noise, entry.get("time"), type_, joint, turns)


def sensor_unit(model: mujoco.MjModel, name: str) -> tuple[str | None, str]:
    """Unit of what a sensor measures, None where the MJCF does not tell it, and the joint whose position or speed that
    is, or ""."""
    sensor = model.sensor(name)
    type_ = int(sensor.type[0])
    if type_ in (enums.JOINTPOS, enums.JOINTVEL):
        joint = model.joint(sensor.objid[0])
        length = "m" if joint.type[0] == enums.SLIDE else "rad"
        return (length if type_ == enums.JOINTPOS else f"{length}/s"), joint.name
    return UNITS.get(type_, _acting_unit(model, sensor, type_)), ""


def _acting_unit(model: mujoco.MjModel, sensor, type_: int) -> str | None:
    """Unit of a sensor of what acts on a joint or of an actuator at one; None: of no such sensor."""
    if type_ == enums.JOINTACTFRC:
        joint = model.joint(sensor.objid[0])
    elif type_ in (enums.ACTPOS, enums.ACTVEL, enums.ACTFRC):
        actuator = model.actuator(sensor.objid[0])
        if actuator.trntype[0] not in enums.AT_JOINT:
            return None
        joint = model.joint(actuator.trnid[0])
    else:
        return None
    length, force = ("m", "N") if joint.type[0] == enums.SLIDE else ("rad", "N m")
    return {enums.ACTPOS: length, enums.ACTVEL: f"{length}/s"}.get(type_, force)


def commands(naive: Naive, table: dict) -> list[Command]:
    """Every actuator's command, in the order of the MJCF.

    Raises:
        CaseError: a name that is no actuator, an actuator without a command, or units that do not fit.
    """
    names = naive.names("actuator")
    for key in table:
        one_of(names, key, "actuator", f"commands.{key}")
    if len(names) < naive.model.nu:
        raise CaseError(f"MJCF {naive.path} has an actuator without a name; name every actuator")
    with_state = [name for name, states in zip(names, naive.model.actuator_actnum, strict=True) if states]
    if with_state:
        raise CaseError(
            f"MJCF {naive.path}: actuator '{with_state[0]}' has a state of its own (dyntype or timeconst), which no "
            "log shows; allowed: actuators without; leave it out: lags and delays are among what is looked for"
        )
    lacking = [name for name in names if name not in table]
    if lacking:
        raise CaseError(
            f"commands.{lacking[0]} is missing: the MJCF has this actuator; add its column, or remove the actuator"
        )
    return [_command(naive.model, name, table[name], f"commands.{name}") for name in names]


def _command(model: mujoco.MjModel, name: str, entry: dict, where: str) -> Command:
    if ends := span(entry["unit"]):
        whose = f"the range of actuator '{name}' or of its joint"
        scale, offset = _within(entry, ends, *_stroke(model, name), where, whose)
        return Command(name, entry["column"], scale, offset, entry.get("time"), True)
    wanted = entry.get("ctrl_unit") or ctrl_unit(model, name)
    if wanted is None:
        raise CaseError(f"{where}.ctrl_unit is missing: the MJCF does not tell the unit of this actuator; add it")
    meaning, gear = entry.get("meaning", "command"), float(model.actuator(name).gear[0])
    if meaning == "motor" and "ratio" not in entry and abs(gear) == 1.0:
        raise CaseError(f"{where}.ratio is missing: the torque is of the motor, before its gear; add the gear ratio")
    if meaning != "motor" and "ratio" in entry:
        raise CaseError(f"{where}.ratio is for meaning: motor, but meaning is {meaning}; remove it or correct meaning")
    if meaning == "link" and not gear:
        raise CaseError(f"{where}: the MJCF gives this actuator no gear on its first axis; allowed: meaning: command")
    scale = entry.get("scale", 1.0) * factor(entry["unit"], wanted, where, entry.get("gain"))
    scale *= _before_gear(meaning, entry.get("ratio", abs(gear)), gear)
    if not scale:
        raise CaseError(f"{where}.scale is 0; allowed: any other number, such as -1 for a reversed axis; correct it")
    return Command(name, entry["column"], scale, entry.get("offset", 0.0), entry.get("time"), meaning == "command")


def _stroke(model: mujoco.MjModel, name: str) -> tuple[np.ndarray, bool]:
    """What a normalised command spans, and whether the MJCF has it: the range of a servo's joint, else its own."""
    actuator = model.actuator(name)
    if ctrl_unit(model, name) in ("rad", "m") and model.jnt_limited[actuator.trnid[0]]:
        return model.jnt_range[actuator.trnid[0]], True
    return actuator.ctrlrange, bool(model.actuator_ctrllimited[actuator.id])


def _before_gear(meaning: str, ratio: float, gear: float) -> float:
    """By what a torque is multiplied to be what the MJCF multiplies by its gear: what acts on the joint is then the
    torque measured there, or that of the motor times its ratio, whatever the gear."""
    return {"command": 1.0, "motor": ratio / abs(gear or 1.0), "link": 1.0 / (gear or 1.0)}[meaning]


def ctrl_unit(model: mujoco.MjModel, name: str) -> str | None:
    """Unit of an actuator's control as its MJCF implies, or None where it does not."""
    actuator = model.actuator(name)
    if actuator.trntype[0] not in enums.AT_JOINT:
        return None
    slide = model.joint(actuator.trnid[0]).type[0] == enums.SLIDE
    gain, bias = actuator.gainprm[0], actuator.biasprm
    if actuator.biastype[0] == enums.NO_BIAS:
        return None if gain != 1.0 else "N" if slide else "N m"
    if gain and gain == -bias[1]:
        return "m" if slide else "rad"
    if gain and gain == -bias[2]:
        return "m/s" if slide else "rad/s"
    return None
