"""Plays a model with the laws that an MJCF cannot hold. Its text, with the laws filled in, becomes `improved.py`.

Only numpy and mujoco may be used here: what is exported must run where fimpact is not installed.
"""

from collections.abc import Callable

import mujoco
import numpy as np

from fimpact.effects.gears import coupled, encoders
from fimpact.effects.law_inputs import Signal, State
from fimpact.simulation.inputs import FINER

# Each law comes with the name of its site and its values.
Laws = list[tuple[Callable, str, dict[str, float]]]
EDITS: Laws = []
FORCES: Laws = []
FRICTIONS: Laws = []
GEARS: Laws = []
COMMANDS: Laws = []
MEASUREMENTS: Laws = []
PERIOD = 0.0
PAST = 0  # rows of commands that actuators with a lag remember
STATEFUL = ()  # (index, number of states) of the actuators whose states are given
CHANNELS, ACTUATORS, JOINT_OF, DRIVEN_BY, HOLDING, GAINS = (), (), (), (), (), ()


def load(path):
    """The MuJoCo model of the MJCF at `path`, with the laws that edit its fields applied."""
    model = mujoco.MjModel.from_xml_path(str(path))
    for law, site, values in EDITS:
        law(model, site, **values)
    if EDITS:
        mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


class Stepper:
    """Steps `data` with the added forces; one for each simulation, because a force may remember its past.

    Laws of commands and of measurements need whole runs, and are left to `commands` and `measurements`.
    """

    def __init__(self, model, data):
        self.model, self.data, self.memory, self.before = model, data, {}, None
        self.own = np.array(model.dof_frictionloss), np.array(model.dof_armature)

    def step(self, ctrl, instant=None):
        """Hold the commands `ctrl` (nu,) over one time step; the added forces go to `data.qfrc_applied`, dry friction
        that changes to `model.dof_frictionloss` and what a gear lets through of a rotor to `model.dof_armature`, for
        the time of the step.

        Returns:
            What the sensors read at its start, (nsensordata,), where the commands are `instant` (nu,).
        """
        model, data = self.model, self.data
        data.ctrl[:] = ctrl
        now = np.concatenate([data.qpos, data.qvel])
        # Half a step ahead, so that holding the force over the step is accurate to second order.
        ahead = now if self.before is None else now + (now - self.before) / 2
        self.before = now
        self._push(self._state(ahead))
        gears = [(site, coupled(model, self._state(now), law, site, values)) for law, site, values in GEARS]
        read = self._at_once(instant, gears) if instant is not None else None
        for site, found in gears:
            self._couple(site, found.pull, found.inertia)
        mujoco.mj_step(model, data)
        read = data.sensordata.copy() if read is None else read
        for site, found in gears:
            for columns, lead in zip(encoders(model, site), (found.lead, found.rate), strict=True):
                read[columns] += lead[0]
        model.dof_frictionloss[:], model.dof_armature[:] = self.own
        return read

    def _state(self, at):
        model, data = self.model, self.data
        position, speed, time = at[None, : model.nq], at[None, model.nq :], np.array([data.time])
        return State(model, position, speed, data.ctrl[None].copy(), time, model.opt.timestep, self.memory)

    def _push(self, seen):
        model, data = self.model, self.data
        data.qfrc_applied[:] = sum((law(seen, site, **values)[0] for law, site, values in FORCES), np.zeros(model.nv))
        for law, site, values in FRICTIONS:
            forward, backward = (float(limit[0]) for limit in law(seen, site, **values))
            dof = model.joint(site).dofadr[0]
            # Unequal limits are equal ones beside a constant force.
            model.dof_frictionloss[dof] += (forward + backward) / 2
            data.qfrc_applied[dof] += (backward - forward) / 2

    def _couple(self, site, pull, inertia):
        dof = self.model.joint(site).dofadr[0]
        self.data.qfrc_applied[dof] += pull[0]
        self.model.dof_armature[dof] = inertia[0]

    def _at_once(self, instant, gears):
        model, data = self.model, self.data
        held, pushed, data.ctrl[:] = data.ctrl.copy(), data.qfrc_applied.copy(), instant
        for site, found in gears:
            self._couple(site, *found.at_once)
        mujoco.mj_forward(model, data)
        data.ctrl[:], data.qfrc_applied[:] = held, pushed
        return data.sensordata.copy()


def simulate(model, ctrl, qpos, qvel, first=0, samples=None, act=()):
    """What the channels read, (samples, ny), one row each `PERIOD` seconds.

    Args:
        ctrl: recorded commands of the whole run, (T, nu), one row each `PERIOD`; the last one is held.
        qpos, qvel: state at row `first` of the run. samples: default: to the end of the run. act: states of the
            actuators that had some in the naive model, at row `first`; default: zero.
    """
    samples = samples or len(ctrl) - first
    substeps = round(PERIOD / model.opt.timestep)
    drive, instant = commands(ctrl, substeps)
    data, begin = mujoco.MjData(model), first * substeps
    _remember(model, data, drive[max(begin - PAST * substeps, 0) : begin], qpos, qvel)
    data.time, data.qpos[:], data.qvel[:] = first * PERIOD, qpos, qvel
    _set_actuators(model, data, act)
    columns = [_column(model, channel) for channel in CHANNELS]
    # What is read at another time is read between steps, not samples; but what may jump with a command, at samples.
    every = 1 if MEASUREMENTS and not ACTUATORS else substeps
    stepper, rows = Stepper(model, data), []
    for k in range((samples - 1) * substeps + 1):
        row = min(begin + k, len(drive) - 1)
        read = stepper.step(drive[row], instant[row] if (COMMANDS or GEARS) and k % substeps == 0 else None)
        if k % every == 0:
            rows.append(read[columns])
    return measurements(np.array(rows), ctrl, first, substeps // every)


def _remember(model, data, drive, qpos, qvel):
    """Let actuators with a lag live through the commands `drive` (n, nu) that came before."""
    for u in drive:
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, u
        mujoco.mj_step(model, data)


def _set_actuators(model, data, act):
    start = 0
    for i, count in STATEFUL if len(act) else ():
        address = model.actuator_actadr[i]
        data.act[address : address + count] = act[start : start + count]
        start += count


def commands(ctrl, substeps):
    """The commands that reach the plant, mean and first of each step, (T * substeps, nu) each, when `ctrl` (T, nu) is
    sent."""
    pieces = substeps * (FINER if COMMANDS else 1)
    drive = np.repeat(np.asarray(ctrl, float), pieces, 0)[None]
    time = np.arange(drive.shape[1])[None] * PERIOD / pieces
    for law, site, values in COMMANDS:
        drive = law(drive, _signal(time, drive), site, **values)
    steps = drive[0].reshape(len(ctrl) * substeps, pieces // substeps, drive.shape[2])
    return steps.mean(1), steps[:, 0]


def measurements(read, ctrl, first=0, pieces=1):
    """What the sensors report, (n, ny), from row `first` of the run on, when the channels truly read `read`, whose
    ((n - 1) * pieces + 1, ny) rows are `PERIOD` / `pieces` apart."""
    rows = first + np.arange(len(read)) / pieces
    sent = np.asarray(ctrl, float)[np.minimum(rows.astype(int), len(ctrl) - 1)][None]
    measured = read[None]
    for law, site, values in MEASUREMENTS:
        measured = law(measured, _signal(rows[None] * PERIOD, sent), site, **values)
    return measured[0, ::pieces]


def _signal(time, ctrl):
    return Signal(time, ctrl, CHANNELS, ACTUATORS, ctrl * np.array(GAINS), JOINT_OF, DRIVEN_BY, HOLDING)


def _column(model, channel):
    name, _, component = channel.removesuffix("]").partition("[")
    return model.sensor(name).adr[0] + int(component or 0)
