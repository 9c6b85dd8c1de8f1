"""A first case from an MJCF and a log: column names matched to joints, actuators and sensors by their words."""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml

from fimpact.cases import kinds
from fimpact.cases.channels import ctrl_unit
from fimpact.cases.errors import CaseError
from fimpact.cases.model import Naive, read_model
from fimpact.cases.readers import Column, read_table

OPEN = "?"  # where only the user knows the unit
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
TIMES = {"t", "time", "times", "stamp", "timestamp", "sec", "seconds"}
UNITS = (
    "deg/s",
    "rad/s",
    "mm/s",
    "m/s",
    "rpm",
    "mN m",
    "N m",
    "Nm",
    "deg",
    "rad",
    "rev",
    "counts",
    "mm",
    "ms",
    "us",
    "ns",
)
UNITS += ("m", "s", "N", "V", "A")
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
    first = First({"model": _relative(model, out), "runs": []})
    first.case["time"] = _time(time, first)
    _match(naive, [column for column in table if column is not time], first)
    if not first.case.get("measurements"):
        names = ", ".join(column.name for column in table) or "none with numbers"
        raise CaseError(f"no column of {log} names a joint or sensor of {model}; its columns: {names}; rename them")
    first.case["runs"] = _runs(time, log, out, first)
    first.case["unknowns"], first.case["window"] = [], 0.5
    first.open.append(
        "unknowns: list {field, site, sd} of what the MJCF only guesses, such as {field: mass, site: arm}"
    )
    return first


def words(name: str) -> set[str]:
    """Words of a column name in small letters; numbers count as words: ``pos_meas1 [deg]`` is pos, meas, 1, deg."""
    return set(re.findall(r"[^\W\d_]+|\d+", re.sub(r"(?<=[a-zß-ÿ])(?=[A-Z])", " ", name).lower()))


def unit(name: str) -> str:
    """The unit that a column name ends with, as in ``elbow [deg]``, ``elbow (deg)`` or ``elbow_deg``; else `OPEN`."""
    bracket = re.search(r"[\[(]([^\])]+)[\])]\s*$", name)
    ending = bracket.group(1) if bracket else name.rpartition("_")[2] if "_" in name else ""
    plain = {one.replace(" ", "").lower(): one for one in reversed(UNITS)}
    plain |= {"degs": "deg/s", "rads": "rad/s", "degrees": "deg", "radians": "rad"}
    return ending if ending in UNITS else plain.get(re.sub(r"[\s*·.]", "", ending).lower(), OPEN)


def _relative(path: Path, out: Path) -> str:
    try:
        return path.resolve().relative_to(out.resolve().parent).as_posix()
    except ValueError:
        return path.resolve().as_posix()


def _time(time: Column | None, first: First) -> dict:
    if time is None:
        first.open.append("time: no column looks like a time; give its column and unit, or `rate:` in Hz")
        return {"column": OPEN, "unit": OPEN}
    found = unit(time.name)
    if found not in ("s", "ms", "us", "ns"):
        first.open.append(f"time.unit: the unit of '{time.name}'")
        found = OPEN
    return {"column": time.name, "unit": found}


def _runs(time: Column | None, log: Path, out: Path, first: First) -> list[dict]:
    file = _relative(log, out)
    span = float(np.nanmax(time.values) - np.nanmin(time.values)) if time is not None else 0.0
    scale = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}.get(first.case["time"]["unit"], 1.0)
    cut = round(0.7 * span * scale, 3) or 1.0
    first.open.append("runs: the end of this log is held out; a recording of its own judges better, so replace it")
    judge = {"name": "judge", "file": file, "start": round(cut + 1e-3, 3), "held_out": True}
    return [{"name": "fit", "file": file, "stop": cut}, judge]


def _match(naive: Naive, table: list[Column], first: First) -> None:
    commands, measurements, left = {}, {}, []
    for column in table:
        kind = next((kind for kind, known in WORDS.items() if words(column.name) & known), "")
        actuator = _named(column.name, naive.names("actuator"), first) if kind == "command" else ""
        sensor = _best(column.name, _scalar_sensors(naive)) if kind != "command" else ""
        joint = _named(column.name, _simple_joints(naive), first) if kind in ("position", "velocity", "") else ""
        if not kind and not sensor and (not joint or unit(column.name) in DRIVES):
            actuator = _best(column.name, naive.names("actuator"))
        if actuator and actuator not in commands:
            commands[actuator] = _command(naive, actuator, column.name, first)
        elif sensor and sensor not in measurements:
            measurements[sensor] = _entry(column.name, f"measurements.{sensor}", first)
        elif joint and f"{joint} {kind or 'position'}" not in measurements:
            key = f"{joint} {kind or 'position'}"
            new = {"joint": joint, "quantity": kind or "position"} | _entry(column.name, f"measurements.{key}", first)
            measurements[key] = new
        else:
            left.append(column.name)
    first.open[:] = [line for line in first.open if not any(line.startswith(f"'{name}' was") for name in left)]
    _report(naive, commands, measurements, left, first)


def _report(naive: Naive, commands: dict, measurements: dict, left: list[str], first: First) -> None:
    if commands:
        first.case["commands"] = commands
    first.case["measurements"] = measurements
    if left:
        first.open.append(f"columns that match nothing, left out: {', '.join(left)}")
    for name in naive.names("actuator"):
        if name not in commands:
            first.open.append(f"commands.{name}: no column matches this actuator")
    seen = {entry.get("joint") for entry in measurements.values()}
    for name in naive.names("joint"):
        if name not in seen and not any(_best(key, [name]) for key in measurements):
            first.open.append(f"measurements: no column matches joint '{name}'")


def _scalar_sensors(naive: Naive) -> list[str]:
    return [name for name in naive.names("sensor") if naive.model.sensor(name).dim[0] == 1]


def _simple_joints(naive: Naive) -> list[str]:
    return [name for name in naive.names("joint") if naive.model.joint(name).type[0] in (kinds.SLIDE, kinds.HINGE)]


def _best(column: str, names: list[str]) -> str:
    """The name all whose words the column has, the one with most of them; of no words at all, none."""
    fitting = [name for name in names if words(name) and words(name) <= words(column)]
    return max(fitting, key=lambda name: (len(words(name)), -names.index(name)), default="")


def _named(column: str, names: list[str], first: First) -> str:
    """The name that fits, or that of the number in the column's name: ``pos2`` is the second joint of the MJCF."""
    numbers = [int(word) for word in words(column) if word.isdecimal()]
    found = _best(column, names)
    if found or len(numbers) != 1 or not 1 <= numbers[0] <= len(names):
        return found
    first.open.append(f"'{column}' was taken for '{names[numbers[0] - 1]}' by its number alone: check it")
    return names[numbers[0] - 1]


def _command(naive: Naive, actuator: str, column: str, first: First) -> dict:
    entry = _entry(column, f"commands.{actuator}", first) | {"meaning": "command"}
    if ctrl_unit(naive.model, actuator) is None:
        first.open.append(f"commands.{actuator}.ctrl_unit: the unit in which the MJCF has it")
        entry["ctrl_unit"] = OPEN
    return entry


def _entry(column: str, where: str, first: First) -> dict:
    found = unit(column)
    if found == OPEN:
        first.open.append(f"{where}.unit: the unit of '{column}'")
    return {"column": column, "unit": found}
