"""Columns of a log matched to joints, actuators and sensors of an MJCF, each column once.

Columns that say the same (``action.*``, ``q1`` to ``q6``) are a family and are matched together: by the names in them,
by their numbers, by their order where there are as many as joints, or as the only one.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from fimpact.cases import enums
from fimpact.cases.channels import ctrl_unit, sensor_unit
from fimpact.cases.drafting.column_names import best, named, words
from fimpact.cases.drafting.roles import KNOWN, Role, role
from fimpact.cases.models.naive import Naive
from fimpact.cases.readers.columns import Column, Table

NAME, NUMBER, ORDER, ONLY = "by its name", "by its number alone", "by its order alone", "as the only one"
RANKS = {"commanded": 0, "": 1, "measured": 2}  # of what may be a command
OF_CTRL = {"rad": "position", "m": "position", "rad/s": "velocity", "m/s": "velocity", "N m": "effort", "N": "effort"}
UNNAMED = Role("", "")
AXES = re.compile(r"(.*?)[_./ ]?([wxyz])(\s*[\[(].*)?")
VECTORS = {  # quantity of a body or site: the words of its columns, its sensors in an MJCF, its unit
    "position": ("p pos position translation", (enums.FRAMEPOS,), "m"),
    "orientation": ("q quat quaternion orientation rotation", (enums.FRAMEQUAT,), "1"),
    "rotation_rate": ("gyro gyr", (enums.GYRO,), "rad/s"),
    "angular_velocity": ("w omega angular", (enums.GYRO, enums.FRAMEANGVEL), "rad/s"),  # in whose axes, it does not say
    "acceleration": ("a acc accel acceleration", (enums.ACCELEROMETER, enums.FRAMELINACC), "m/s^2"),
    "velocity": ("v vel velocity linear", (enums.VELOCIMETER, enums.FRAMELINVEL), "m/s"),
    "force": ("f force", (enums.FORCE,), "N"),
    "torque": ("m torque moment tau", (enums.TORQUE,), "N m"),
}


@dataclass(frozen=True)
class Match:
    """Columns of one entry of a case.

    wanted: unit of the MJCF, None where it tells none. how: what they were matched by. place: what the entry says
    besides its columns and unit. joint: whose range bounds them, or "".
    """

    columns: tuple[Column, ...]
    wanted: str | None
    how: str = NAME
    place: dict = field(default_factory=dict)
    joint: str = ""


@dataclass
class Matches:
    """Commands and measurements by the keys of a case, and the columns that are neither."""

    commands: dict[str, Match] = field(default_factory=dict)
    measurements: dict[str, Match] = field(default_factory=dict)
    left: list[Column] = field(default_factory=list)

    def taken(self) -> set[int]:
        """Identities of the columns that are matched."""
        both = (*self.commands.values(), *self.measurements.values())
        return {id(column) for match in both for column in match.columns}


def matches(naive: Naive, table: Table) -> Matches:
    """Match every column of numbers that can be matched."""
    out = Matches()
    # What was recorded more often goes first.
    families = sorted(_families(table), key=lambda family: -len(family[0].values))
    for family in sorted(families, key=lambda family: RANKS.get(role(family[0]).side, 3)):
        for column, actuator, how in _assigned(family, _actuators(naive, role(family[0])), table):
            if actuator not in out.commands:
                out.commands[actuator] = _command(naive, column, actuator, how)
    for family in families:
        _measure(naive, out, [column for column in family if id(column) not in out.taken()], table)
    for key, match in _vectors(naive, [column for column in table if id(column) not in out.taken()]):
        out.measurements.setdefault(key, match)
    taken = out.taken()
    out.left = [column for column in table if id(column) not in taken]
    return out


def _families(table: Table) -> list[list[Column]]:
    out: dict[tuple, list[Column]] = {}
    for column in table:
        out.setdefault((column.group, role(column), frozenset(words(column.name) & KNOWN)), []).append(column)
    return list(out.values())


def _assigned(family: list[Column], labels: dict[str, str], table: Table) -> list[tuple[Column, str, str]]:
    """Each column of a family with what the label in it stands for, and how that was found."""
    targets = list(dict.fromkeys(labels.values()))
    by_name = [labels.get(_best(column, list(labels)), "") for column in family]
    both = list(zip(family, targets, strict=False))
    if not all(by_name) and len(family) == len(targets) > 1:
        numbers = [named(column.name, targets, table) for column in family]
        if not any(by_name) and all(numbers):
            return [(column, target, NUMBER) for column, target in zip(family, numbers, strict=True)]
        if all(name in ("", target) for name, target in zip(by_name, targets, strict=True)):
            return [(column, target, ORDER) for column, target in both]
    if not any(by_name):
        if len(family) == len(targets) == 1 and role(family[0]) != UNNAMED:
            return [(*both[0], ONLY)]
        return [(column, target, NUMBER) for column in family if (target := named(column.name, targets, table))]
    return [(column, target, NAME) for column, target in zip(family, by_name, strict=True) if target]


def _best(column: Column, labels: list[str]) -> str:
    """The label that a column's name has in it, or its topic, where that is the topic of one joint."""
    return best(column.name, labels) or (best(column.group, labels) if column.group.startswith("/") else "")


def _actuators(naive: Naive, of: Role) -> dict[str, str]:
    """Labels of actuators whose command a column of this role can be: their own names and those of their joints."""
    fitting = [name for name in naive.names("actuator") if _drives(of, _control(naive, name))]
    if of == UNNAMED:  # only an actuator's name can tell, and only where it is no joint's
        return {name: name for name in fitting if name not in naive.names("joint")}
    joints = {_joint_of(naive, name): name for name in reversed(fitting)}
    others = {joint: name for joint, name in joints.items() if joint and joint not in fitting}
    return {name: name for name in fitting} | others


def _drives(of: Role, control: str) -> bool:
    """Whether a column of this role can be the command of an actuator whose control is this quantity."""
    if of.side == "commanded":
        return of.quantity in ("", control) or (not control and of.quantity != "acceleration")
    return of.side != "neither" and (of == UNNAMED or (of.quantity == "effort" and control in ("effort", "")))


def _control(naive: Naive, actuator: str) -> str:
    """Quantity of an actuator's control, or "" where the MJCF does not tell it."""
    unit = ctrl_unit(naive.model, actuator)
    if unit is None and naive.model.actuator(actuator).biastype[0] == enums.NO_BIAS:
        return "effort" if _joint_of(naive, actuator) else ""
    return OF_CTRL.get(unit or "", "")


def _joint_of(naive: Naive, actuator: str) -> str:
    one = naive.model.actuator(actuator)
    return naive.model.joint(one.trnid[0]).name if one.trntype[0] in enums.AT_JOINT else ""


def _command(naive: Naive, column: Column, actuator: str, how: str) -> Match:
    meaning = "link" if role(column).side == "measured" else "command"
    servo = _control(naive, actuator) == "position"
    joint = _joint_of(naive, actuator) if servo else ""
    return Match((column,), ctrl_unit(naive.model, actuator), how, {"meaning": meaning}, joint)


def _measure(naive: Naive, out: Matches, family: list[Column], table: Table) -> None:
    """Match a family to sensors by name, and the rest of it to joints."""
    of = role(family[0]) if family else UNNAMED
    if of.side in ("commanded", "neither") or of.quantity == "acceleration":
        return
    sensors = _scalar_sensors(naive, of.quantity)
    rest = []
    for column in family:
        sensor = best(column.name, sensors)
        if sensor and sensor not in out.measurements:
            unit, joint = sensor_unit(naive.model, sensor)
            out.measurements[sensor] = Match((column,), unit, joint=joint if of.quantity != "velocity" else "")
        else:
            rest.append(column)
    labels = {name: name for name in _simple_joints(naive)} if of.quantity != "effort" else {}
    for column, joint, how in _assigned(rest, labels, table) if rest else ():
        quantity = of.quantity or "position"
        if f"{joint} {quantity}" not in out.measurements and (of != UNNAMED or how == NAME):
            length = "m" if naive.model.joint(joint).type[0] == enums.SLIDE else "rad"
            fast = quantity == "velocity"
            place, unit = {"joint": joint, "quantity": quantity}, f"{length}/s" if fast else length
            out.measurements[f"{joint} {quantity}"] = Match((column,), unit, how, place, "" if fast else joint)


def _scalar_sensors(naive: Naive, quantity: str) -> list[str]:
    """Sensors of one component, those of joints only if they measure this quantity, or it is not known."""
    other = {"position": enums.JOINTVEL, "velocity": enums.JOINTPOS}.get(quantity, -1)
    acting = (enums.JOINTPOS, enums.JOINTVEL) if quantity == "effort" else (other,)
    sensors = [naive.model.sensor(name) for name in naive.names("sensor")]
    return [sensor.name for sensor in sensors if sensor.dim[0] == 1 and sensor.type[0] not in acting]


def _simple_joints(naive: Naive) -> list[str]:
    return [name for name in naive.names("joint") if naive.model.joint(name).type[0] in (enums.SLIDE, enums.HINGE)]


def _vectors(naive: Naive, table: Table) -> Iterator[tuple[str, Match]]:
    """Columns x, y, z (and w) of one quantity, matched to the MJCF's only sensor of it, or to its only free body."""
    groups: dict[tuple, dict[str, Column]] = {}
    for column in table:
        found = AXES.fullmatch(column.name)
        if found and role(column).side not in ("commanded", "neither"):
            groups.setdefault((column.group, found[1]), {})[found[2]] = column
    for (group, stem), axes in groups.items():
        quantity = _vector(words(stem), words(group) if group.startswith("/") else set(), axes)
        order = "wxyz" if quantity == "orientation" else "xyz"
        place = _vector_place(naive, quantity) if quantity and set(order) <= set(axes) else None
        if place:
            key, keys = place
            yield key, Match(tuple(axes[axis] for axis in order), VECTORS[quantity][2], ONLY, keys)


def _vector(said: set[str], topic: set[str], axes: dict) -> str:
    """The quantity of a vector by its own words, else by those of its topic; "" where none tells."""
    if not said and not topic:
        return "orientation" if "w" in axes else "position"
    for some in (said, topic):
        fitting = [quantity for quantity, (known, _, _) in VECTORS.items() if some & set(known.split())]
        fitting = [quantity for quantity in fitting if (quantity == "orientation") == ("w" in axes)]
        if fitting:  # an IMU turns with its body
            return "rotation_rate" if fitting[0] == "angular_velocity" and "imu" in said | topic else fitting[0]
    return ""


def _vector_place(naive: Naive, quantity: str) -> tuple[str, dict] | None:
    """Key and place of an entry: the only sensor of a quantity, the only site of an IMU, or the only free body."""
    types = VECTORS[quantity][1]
    sensors = [name for name in naive.names("sensor") if naive.model.sensor(name).type[0] in types]
    if len(sensors) == 1:
        return sensors[0], {}
    sites = [site for site in naive.names("site") if "imu" in words(site)]
    if len(sites) == 1 and not sensors and quantity in ("rotation_rate", "acceleration"):
        return f"{sites[0]} {quantity}", {"site": sites[0], "quantity": quantity}
    free = [joint for joint in naive.names("joint") if naive.model.joint(joint).type[0] == enums.FREE]
    body = naive.model.body(naive.model.joint(free[0]).bodyid[0]).name if len(free) == 1 else ""
    if sensors or not body or quantity not in ("position", "orientation"):
        return None
    return f"{body} {quantity}", {"body": body, "quantity": quantity}
