"""A first case from an MJCF and a log: column names matched to joints, actuators and sensors by their words."""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml

from fimpact.cases import kinds
from fimpact.cases.channels import ctrl_unit, sensor_unit
from fimpact.cases.errors import CaseError
from fimpact.cases.model import Naive, read_model
from fimpact.cases.names import OPEN, best, named, unit, words
from fimpact.cases.readers import Column, read_table
from fimpact.cases.units import same_dimension

WORDS = {
    "position": {"pos", "position", "angle", "q", "qpos", "theta", "phi", "encoder", "height"},
    "velocity": {"vel", "velocity", "speed", "rate", "qd", "dq", "qvel", "omega", "thetadot"},
    "command": {
        "tau",
        "torque",
        "force",
        "effort",
        "cmd",
        "command",
        "ctrl",
        "u",
        "current",
        "voltage",
        "con",
        "input",
    },
}
WISHES = {"des", "desired", "ref", "reference", "target", "goal", "setpoint", "sp", "error", "err"}  # not measured
TIMES = {"t", "time", "times", "stamp", "timestamp", "sec", "seconds"}
DRIVES = {"mN m", "N m", "Nm", "N", "V", "A"}  # units of commands, and of no position or speed


@dataclass
class First:
    """A case to be written, and what could not be matched."""

    case: dict
    open: list[str] = field(default_factory=list)

    def text(self) -> str:
        """The case as YAML, with what is open as comments on top."""
        head = [f"# open: {line}" for line in self.open]
        return "\n".join([*head, yaml.safe_dump(self.case, sort_keys=False, allow_unicode=True, width=110)])


def first_case(model: Path, log: Path, out: Path) -> First:
    """A case for `log` (its first 70 % to fit, the rest held out), with paths relative to the folder of `out`.

    Raises:
        CaseError: either file cannot be read, or no column belongs to anything in the MJCF.
    """
    naive, table = read_model(model), [c for c in read_table(log) if c.values.dtype.kind == "f" and len(c.values) > 1]
    time = next((column for column in table if words(column.name) & TIMES), None)
    rest = time and next((column for column in table if column.name in _rests(time.name)), None)
    first = First({"model": _relative(model, out), "runs": []})
    first.case["time"] = _time(time, rest, first)
    _match(naive, [column for column in table if column is not time and column is not rest], first)
    if not first.case.get("measurements"):
        names = ", ".join(column.name for column in table) or f"none with numbers{_texts(log)}"
        raise CaseError(f"no column of {log} names a joint or sensor of {model}; its columns: {names}; rename them")
    first.case["runs"] = _runs(time, log, out, first)
    first.case["unknowns"], first.case["window"] = [], 0.5
    first.open.append(
        "unknowns: list {field, site, sd} of what the MJCF only guesses, such as {field: mass, site: arm}"
    )
    return first


def _texts(log: Path) -> str:
    """What stands in place of numbers, such as decimal commas."""
    texts = [c for c in read_table(log) if c.values.dtype.kind != "f" and len(c.values)]
    return f", but text such as '{texts[-1].values[0]}' in '{texts[-1].name}'; write decimal points" if texts else ""


def _relative(path: Path, out: Path) -> str:
    try:
        return path.resolve().relative_to(out.resolve().parent).as_posix()
    except ValueError:
        return path.resolve().as_posix()


def _rests(name: str) -> list[str]:
    """Names that the column of fractions has beside one of whole seconds, in ROS 2 and 1."""
    stem, whole = re.fullmatch("(.*?)(secs?|)", name).groups()
    return [stem + rest for rest in ("nanosec", "nsecs")] if whole else []


def _time(time: Column | None, rest: Column | None, first: First) -> dict:
    if time is None:
        first.open.append("time: no column looks like a time; give its column and unit, or `rate:` in Hz")
        return {"column": OPEN, "unit": OPEN}
    if rest:
        return {"column": time.name, "unit": "s", "fraction": {"column": rest.name, "unit": "ns"}}
    if len(np.unique(time.values)) < len(time.values):
        first.open.append(f"time: '{time.name}' repeats itself; the fraction of a second may be in another column")
    found = unit(time.name)
    if found not in ("s", "ms", "us", "ns"):
        first.open.append(f"time.unit: the unit of '{time.name}'")
        found = OPEN
    return {"column": time.name, "unit": found}


def _runs(time: Column | None, log: Path, out: Path, first: First) -> list[dict]:
    file, cut = _relative(log, out), OPEN
    first.open.append("runs: the end of this log is held out; a recording of its own judges better, so replace it")
    scale = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}.get(first.case["time"]["unit"])
    if time is None or scale is None:
        first.open.append("runs: stop of the one and start of the other, s after the first sample: about 70 % of it")
    else:
        cut = round(0.7 * float(np.nanmax(time.values) - np.nanmin(time.values)) * scale, 3) or 1.0
    judge = {"name": "judge", "file": file, "start": cut if cut == OPEN else round(cut + 1e-3, 3), "held_out": True}
    return [{"name": "fit", "file": file, "stop": cut}, judge]


def _match(naive: Naive, table: list[Column], first: First) -> None:
    commands, measurements, left = {}, {}, {}
    # What was wished for has the name of what was measured; it is taken where nothing else is there.
    for column in sorted(table, key=lambda column: bool(words(column.name) & WISHES)):
        kind = next((kind for kind, known in WORDS.items() if words(column.name) & known), "")
        actuator = named(column.name, naive.names("actuator"), table) if kind == "command" else ""
        sensor = best(column.name, _scalar_sensors(naive, kind)) if kind != "command" else ""
        joint = named(column.name, _simple_joints(naive), table) if kind in ("position", "velocity", "") else ""
        if not kind and not sensor and (not joint or unit(column.name) in DRIVES):
            actuator = best(column.name, naive.names("actuator"))
        key = f"{joint} {kind or 'position'}"
        if actuator and actuator not in commands:
            commands[actuator] = _command(naive, actuator, column.name, first)
            _by_number(column.name, actuator, first)
        elif sensor and sensor not in measurements:
            measurements[sensor] = _entry(
                column.name, f"measurements.{sensor}", sensor_unit(naive.model, sensor)[0], first
            )
        elif joint and key not in measurements:
            entry = _entry(column.name, f"measurements.{key}", _joint_unit(naive, joint, kind), first)
            measurements[key] = {"joint": joint, "quantity": kind or "position"} | entry
            _by_number(column.name, joint, first)
        else:
            taken = commands.get(actuator) or measurements.get(sensor) or (measurements.get(key) if joint else None)
            left[column.name] = f" (as '{taken['column']}')" if taken else ""
    _report(naive, commands, measurements, left, first)


def _report(naive: Naive, commands: dict, measurements: dict, left: dict[str, str], first: First) -> None:
    if commands:
        first.case["commands"] = commands
    first.case["measurements"] = measurements
    if left:
        listing = ", ".join(f"{name}{like}" for name, like in left.items())
        first.open.append(f"columns left out, which match nothing or the same as another: {listing}")
    for name in naive.names("actuator"):
        if name not in commands:
            first.open.append(f"commands.{name}: no column matches this actuator")
    seen = {entry.get("joint") for entry in measurements.values()}
    for name in naive.names("joint"):
        if name not in seen and not any(best(key, [name]) for key in measurements):
            first.open.append(f"measurements: no column matches joint '{name}'")


def _scalar_sensors(naive: Naive, kind: str) -> list[str]:
    """Sensors of one component, those of joints only if they measure a quantity of this `kind`, or it is not known."""
    other = {"position": kinds.JOINTVEL, "velocity": kinds.JOINTPOS}.get(kind, -1)
    sensors = [naive.model.sensor(name) for name in naive.names("sensor")]
    return [sensor.name for sensor in sensors if sensor.dim[0] == 1 and sensor.type[0] != other]


def _simple_joints(naive: Naive) -> list[str]:
    return [name for name in naive.names("joint") if naive.model.joint(name).type[0] in (kinds.SLIDE, kinds.HINGE)]


def _joint_unit(naive: Naive, joint: str, kind: str) -> str:
    length = "m" if naive.model.joint(joint).type[0] == kinds.SLIDE else "rad"
    return f"{length}/s" if kind == "velocity" else length


def _by_number(column: str, name: str, first: First) -> None:
    if not best(column, [name]):
        first.open.append(f"'{column}' was taken for '{name}' by its number alone: check it")


def _command(naive: Naive, actuator: str, column: str, first: First) -> dict:
    wanted = ctrl_unit(naive.model, actuator)
    entry = _entry(column, f"commands.{actuator}", None, first) | {"meaning": "command"}
    if wanted is None:
        first.open.append(f"commands.{actuator}.ctrl_unit: the unit in which the MJCF has it")
        entry["ctrl_unit"] = OPEN
    return entry


def _entry(column: str, where: str, wanted: str | None, first: First) -> dict:
    """The column with its unit; open where its name has none, or one that what is `wanted` cannot have."""
    found = unit(column)
    if found != "counts" and wanted and found != OPEN and not same_dimension(found, wanted):
        found = OPEN
    if found == OPEN:
        first.open.append(f"{where}.unit: the unit of '{column}'")
    return {"column": column, "unit": found}
