"""Ways in which columns may have been read wrongly: units, signs, two of them exchanged."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import mujoco
import numpy as np

from fimpact.cases import kinds

DEGREE = np.pi / 180
States = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # positions (n, nq), speeds, accelerations, commands


@dataclass(frozen=True)
class Reading:
    """Another way to read the columns: factors on joints and commands and on time, or two of them exchanged."""

    cause: str
    doubt: str
    joints: tuple[tuple[str, float], ...] = ()
    commands: tuple[tuple[int, float], ...] = ()
    time: float = 1.0
    swapped_joints: tuple[str, str] | None = None
    swapped_commands: tuple[int, int] | None = None


def readings(model: mujoco.MjModel) -> Iterator[Reading]:
    """Every misreading that is tried, the likeliest first."""
    joints = [model.joint(j) for j in range(model.njnt)]
    for joint in joints:
        yield from _joint_readings(joint.name, joint.type[0] == kinds.HINGE)
    hinges = tuple((joint.name, DEGREE) for joint in joints if joint.type[0] == kinds.HINGE)
    if len(hinges) > 1:
        yield Reading("the angles are in degrees but declared as radians", "units", hinges)
    for actuator in range(model.nu):
        yield from _command_readings(actuator, model.actuator(actuator).name)
    if model.nu > 1:
        for factor, size in ((1e-3, "large"), (1e3, "small")):
            every = tuple((actuator, factor) for actuator in range(model.nu))
            yield Reading(f"the unit of all commands is wrong by 1000 (too {size})", "units", commands=every)
    yield Reading("the time is in ms but declared as s (wrong by 1000)", "units", time=1e-3)
    yield Reading("the time is in s but declared as ms (wrong by 1000)", "units", time=1e3)
    yield from _swaps(model, [joint.name for joint in joints if joint.type[0] in (kinds.SLIDE, kinds.HINGE)])


def _joint_readings(name: str, hinge: bool) -> Iterator[Reading]:
    if hinge:
        yield Reading(f"the angle of '{name}' is in degrees but declared as radians", "units", ((name, DEGREE),))
        yield Reading(f"the angle of '{name}' is in radians but declared as degrees", "units", ((name, 1 / DEGREE),))
    else:
        yield Reading(f"the unit of '{name}' is wrong by 1000 (mm declared as m)", "units", ((name, 1e-3),))
        yield Reading(f"the unit of '{name}' is wrong by 1000 (m declared as mm)", "units", ((name, 1e3),))
    yield Reading(f"'{name}' has the wrong sign (use `scale: -1`)", "sign", ((name, -1.0),))


def _command_readings(actuator: int, name: str) -> Iterator[Reading]:
    for factor, size in ((1e-3, "large"), (1e3, "small")):
        cause = f"the unit of the command of '{name}' is wrong by 1000 (too {size})"
        yield Reading(cause, "units", commands=((actuator, factor),))
    yield Reading(f"the command of '{name}' has the wrong sign (use `scale: -1`)", "sign", commands=((actuator, -1.0),))


def _swaps(model: mujoco.MjModel, joints: list[str]) -> Iterator[Reading]:
    for one, other in combinations(joints, 2):
        if model.joint(one).type == model.joint(other).type:
            cause = f"the measurements of '{one}' and '{other}' are swapped"
            yield Reading(cause, "swapped", swapped_joints=(one, other))
    for one, other in combinations(range(model.nu), 2):
        cause = f"the commands of '{model.actuator(one).name}' and '{model.actuator(other).name}' are swapped"
        yield Reading(cause, "swapped", swapped_commands=(one, other))


def read(model: mujoco.MjModel, state: States, reading: Reading) -> States:
    """The same states, had their columns been read like that."""
    q, v, a, ctrl = (values.copy() for values in state)
    for name, factor in reading.joints:
        at, dof, size = (
            model.joint(name).qposadr[0],
            model.joint(name).dofadr[0],
            3 if model.joint(name).type[0] == kinds.FREE else 1,
        )
        for values, first in ((q, at), (v, dof), (a, dof)):
            values[:, first : first + size] *= factor
    for actuator, factor in reading.commands:
        ctrl[:, actuator] *= factor
    if reading.swapped_joints:
        one, other = (model.joint(name) for name in reading.swapped_joints)
        _exchange(q, one.qposadr[0], other.qposadr[0])
        _exchange(v, one.dofadr[0], other.dofadr[0])
        _exchange(a, one.dofadr[0], other.dofadr[0])
    if reading.swapped_commands:
        _exchange(ctrl, *reading.swapped_commands)
    return q, v / reading.time, a / reading.time**2, ctrl


def _exchange(values: np.ndarray, one: int, other: int) -> None:
    values[:, [one, other]] = values[:, [other, one]]
