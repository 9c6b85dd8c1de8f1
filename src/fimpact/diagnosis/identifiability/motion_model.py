"""A motion of a model, recorded or only thought of, and what every suspect would add to its forces.

Nothing is simulated: along a known motion inertia, friction and motors are forces.
"""

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from fimpact.effects.base import Placed
from fimpact.effects.drives import motor_force
from fimpact.effects.law_inputs import State
from fimpact.effects.sites import driven
from fimpact.effects.wiring import drives
from fimpact.recordings import FIELDS
from fimpact.smoothing.dynamics.inverse import EDITED, Inverse
from fimpact.smoothing.dynamics.laws import DRY, expected_sign
from fimpact.smoothing.dynamics.response import driven as driven_dofs
from fimpact.smoothing.dynamics.response import heavier
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.parameters import Parameter

DRIVING = ("actuator_gainprm", "actuator_biasprm", "actuator_biastype", "actuator_forcerange", "actuator_forcelimited")


@dataclass(frozen=True)
class Commands:
    """Commands at every sample, ctrl (M, nu), at time (M,), s, since the start of the run, run after run of `lengths`;
    rows: those that a motion looks at."""

    ctrl: np.ndarray
    time: np.ndarray
    lengths: tuple[int, ...]
    rows: np.ndarray


class EditedCopy:
    """A copy of a model that is edited again and again: copying a model with meshes takes longer than all else."""

    def __init__(self, model: mujoco.MjModel):
        self.model, self.own, self.data = model, copy.copy(model), mujoco.MjData(model)

    def edited(self, edit: Callable[[mujoco.MjModel], None]) -> mujoco.MjModel:
        """The model as `edit` leaves it, until the next one."""
        for name in (*EDITED, *DRIVING, *DRY):
            getattr(self.own, name)[:] = getattr(self.model, name)
        self.own.opt.gravity[:] = self.model.opt.gravity
        edit(self.own)
        return self.own

    def numbers(self, edit: Callable[[mujoco.MjModel], None]) -> frozenset[tuple[str, int]]:
        """Which numbers of the model an edit changes."""
        after, found = self.edited(edit), set()
        for name in (*EDITED, *DRIVING, *DRY[:1]):
            changed = np.flatnonzero(np.asarray(getattr(after, name) != getattr(self.model, name)))
            found |= {(name, int(row)) for row in changed}
        weight = [] if np.array_equal(after.opt.gravity, self.model.opt.gravity) else [("gravity", 0)]
        return frozenset([*found, *weight])


@dataclass(frozen=True)
class Motion:
    """N samples of a motion of the model on `bench`, run after run of `lengths`.

    qpos (N, nq), qvel and qacc (N, nv). doubt: sd of the speeds, (nv,).
    """

    track: Track
    bench: EditedCopy
    qpos: np.ndarray
    qvel: np.ndarray
    qacc: np.ndarray
    commands: Commands
    doubt: np.ndarray
    lengths: tuple[int, ...]

    @property
    def model(self) -> mujoco.MjModel:
        """Whose motion it is."""
        return self.bench.model

    @property
    def ctrl(self) -> np.ndarray:
        """Commands, (N, nu)."""
        return self.commands.ctrl[self.commands.rows]

    @property
    def time(self) -> np.ndarray:
        """Since the start of the run, (N,), s."""
        return self.commands.time[self.commands.rows]

    @property
    def count(self) -> int:
        """Number of samples."""
        return len(self.qpos)

    def slices(self) -> list[slice]:
        """Rows of each run."""
        return _slices(self.lengths)

    @cached_property
    def inverse(self) -> Inverse:
        """Inverse dynamics along it."""
        return Inverse.along(self.track, self.qpos, self.qvel, self.qacc)

    @cached_property
    def sign(self) -> np.ndarray:
        """Expected sign of the speeds, (N, nv)."""
        return expected_sign(self.qvel, self.doubt)

    def state(self, model: mujoco.MjModel, ctrl: np.ndarray | None = None) -> State:
        """The states of its samples under another model of the same kinematics, and commands, (N, nu)."""
        given = self.ctrl if ctrl is None else ctrl
        return State(model, self.qpos, self.qvel, given, self.time, self.track.period, {}, {}, self.qacc)

    @cached_property
    def missing(self) -> np.ndarray:
        """The force, (N, nv), that the motion takes beyond what the model's own forces give."""
        out, data = np.empty_like(self.qvel), mujoco.MjData(self.model)
        for k in range(self.count):
            data.qpos[:], data.qvel[:], data.qacc[:] = self.qpos[k], self.qvel[k], self.qacc[k]
            if self.model.nu:
                data.ctrl[:] = self.ctrl[k]
            if self.model.na:
                data.act[:] = _resting(self.model, self.ctrl[k])
            mujoco.mj_inverse(self.model, data)
            mujoco.mj_fwdActuation(self.model, data)
            out[k] = data.qfrc_inverse - data.qfrc_actuator
        return out

    @cached_property
    def told(self) -> np.ndarray:
        """Commands, (N, nu), under which motors and servos give what the motion takes.

        What was applied is an outcome: with it in a column, that nothing weighs and no motor gives would explain all.
        """
        out = self.ctrl.copy()
        for joint, motors in self.driven.items():
            dof = int(self.model.joint(joint).dofadr[0])
            for motor in motors[:1]:
                per_unit = self.model.actuator_gainprm[motor, 0] * self.model.actuator_gear[motor, 0]
                if per_unit:
                    out[:, motor] += self.missing[:, dof] / per_unit
        return out

    def of_edit(self, edit: Callable[[mujoco.MjModel], None]) -> np.ndarray | None:
        """The force, (N, nv), that an edit of the model adds; None where it is no force along a known motion."""
        before, after = self.model, self.bench.edited(edit)
        motors = _changed_motors(after, before)
        joints = [joint for joint in self.driven if set(self.driven[joint]) & motors]
        if motors - {motor for joint in joints for motor in self.driven[joint]}:
            return None
        out = np.zeros_like(self.qvel)
        for joint in joints:
            dof = int(before.joint(joint).dofadr[0])
            out[:, dof] += motor_force(self.state(after, self.told), joint)
            out[:, dof] -= motor_force(self.state(before, self.told), joint)
        grown = self._grown(after)
        for name in DRIVING:
            getattr(after, name)[:] = getattr(before, name)
        held = self.inverse.change(after, before, self.ctrl)
        if held is None:
            return None
        return out + held + grown - (after.dof_frictionloss - before.dof_frictionloss) * self.sign

    def _grown(self, after: mujoco.MjModel) -> np.ndarray | float:
        """By how much the missing force grows with the inertia where no motor is (`response.heavier`)."""
        if driven_dofs(self.model).all():
            return 0.0
        mujoco.mj_setConst(after, self.bench.data)
        return self.missing * (heavier(after, self.model) - 1.0)

    def of_effect(self, placed: Placed) -> np.ndarray | None:
        """The same of an effect."""
        effect, site = placed.effect, placed.site
        if effect.enters == "model":
            return self.of_edit(lambda model: effect.law(model, site, **placed.values))
        if effect.enters == "force":
            return effect.law(self.state(self.model), site, **placed.values)
        return self._of_commands(self._commanded(placed)) if effect.enters == "command" else None

    def of_number(self, number: Parameter) -> np.ndarray | None:
        """What a unit of an unknown's coordinate adds."""
        found = self.of_edit(setter(number))
        return None if found is None else found / number.nudge

    @cached_property
    def driven(self) -> dict[str, list[int]]:
        """Motors of each joint that is driven."""
        return {joint: drives(self.model, joint) for joint in driven(self.model)}

    def _commanded(self, placed: Placed) -> np.ndarray:
        """Commands, (N, nu), as a law of commands changes them."""
        inputs, (time, ctrl) = self.track.simulator.commands, (self.commands.time, self.commands.ctrl)
        out = np.empty_like(ctrl)
        for rows in _slices(self.commands.lengths):
            signal = inputs.describe(time[None, rows], ctrl[None, rows])
            out[rows] = placed.effect.law(ctrl[None, rows], signal, placed.site, **placed.values)[0]
        return out[self.commands.rows]

    def _of_commands(self, ctrl: np.ndarray) -> np.ndarray | None:
        motors = set(np.flatnonzero((ctrl != self.ctrl).any(0)).tolist())
        joints = [joint for joint in self.driven if set(self.driven[joint]) & motors]
        if motors - {motor for joint in joints for motor in self.driven[joint]}:
            return None
        out, now, then = np.zeros_like(self.qvel), self.state(self.model), self.state(self.model, ctrl)
        for joint in joints:
            out[:, int(self.model.joint(joint).dofadr[0])] = motor_force(then, joint) - motor_force(now, joint)
        return out


def _slices(lengths: Sequence[int]) -> list[slice]:
    ends = np.cumsum(lengths)
    return [slice(int(end - length), int(end)) for end, length in zip(ends, lengths, strict=True)]


def setter(number: Parameter) -> Callable[[mujoco.MjModel], None]:
    """The edit that moves an unknown by its nudge."""
    put, site, value = FIELDS[number.name][2][1], number.of.partition("@")[2], number.moved(number.nudge).value
    return lambda model: put(model, site, value)


def _changed_motors(after: mujoco.MjModel, before: mujoco.MjModel) -> set[int]:
    if not after.nu:
        return set()
    changed = [(getattr(after, n) != getattr(before, n)).reshape(after.nu, -1).any(1) for n in DRIVING]
    return set(np.flatnonzero(np.any(changed, axis=0)).tolist())


def _resting(model: mujoco.MjModel, ctrl: np.ndarray) -> np.ndarray:
    """States of actuators, (na,), that have followed their commands."""
    act = np.zeros(model.na)
    for motor in range(model.nu):
        if model.actuator_actnum[motor] == 1:
            act[model.actuator_actadr[motor]] = ctrl[motor]
    return act


def stacked(parts: Sequence[np.ndarray | None], like: np.ndarray) -> np.ndarray:
    """Columns, (N, nv, k), of forces (N, nv); zero where there is none."""
    return np.stack([np.zeros_like(like) if part is None else part for part in parts], 2)
