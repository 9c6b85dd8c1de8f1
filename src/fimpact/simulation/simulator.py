"""Windows of a recording, simulated by MuJoCo C under a hypothesis: parameter values and effects added to the model.

All windows advance together: `mujoco.rollout` steps them in C, and a force law that MuJoCo lacks is evaluated once per
step for all of them.
"""

import copy
import os
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from fimpact.effects.law_inputs import Signal, State
from fimpact.effects.touching import NO_CONTACT
from fimpact.recordings import FIELDS, Recording
from fimpact.simulation.added_forces import LAWS, WRITES, AddedForces
from fimpact.simulation.compiled import compiled_model, configure, sensor_column, without_idle_solver
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.inputs import InputSignal
from fimpact.simulation.model_pool import ModelPool
from fimpact.simulation.nonsmooth import make_friction_exact
from fimpact.simulation.servo_steps import held_by_servos
from fimpact.simulation.windows import Windows
from fimpact.support.mujoco_setup import hush

MOST_STEPS = 2_000_000  # simulated at once: what is kept of each takes memory
# A simulation that diverges is an infinite error, and no news: numpy need not warn of it.
DIVERGED = np.errstate(over="ignore", invalid="ignore")
CONTROL = int(mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_QFRC_APPLIED)
FULL = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)


hush()


@dataclass(frozen=True)
class Drive:
    """What acts on windows: signal, at every step; mean: commands over each step, (w, n, nu); instant: commands at its
    start, or None where they are the same."""

    signal: Signal
    mean: np.ndarray
    instant: np.ndarray | None


def threads() -> int:
    """Count the threads that simulate: OMP_NUM_THREADS, which Snakemake sets for its jobs, or the number of cores.

    What comes out does not depend on it.
    """
    given = os.environ.get("OMP_NUM_THREADS", "")
    return int(given) if given.isdecimal() and int(given) else os.cpu_count() or 1


class Simulator:
    """Predicts what the channels of `recording` read, at its time step divided by `refine`; apart: nothing touches;
    rotors: joints behind which there is a second one (`rotors.Rotors`)."""

    def __init__(self, recording: Recording, refine: int = 1, apart: bool = False, rotors: tuple[str, ...] = ()):
        self.recording, self.refine, self.apart = recording, refine, apart
        self.base = copy.copy(compiled_model(recording.xml, apart, rotors))
        self.base.opt.timestep /= refine
        self.base.opt.disableflags |= NO_CONTACT * apart
        configure(self.base)
        self.substeps = max(1, round(recording.period / self.base.opt.timestep))
        self.base.opt.timestep = recording.period / self.substeps
        # What MuJoCo does to a contact that is too quick for its time step (refsafe) belongs to the model: finer steps
        # measure the error of the integrator, and must not simulate a quicker contact.
        self.quickest = 2 * self.base.opt.timestep * refine
        self.columns = np.array([sensor_column(self.base, name) for name in recording.channels])
        self.commands = InputSignal(self.base, recording, self.substeps)
        count = threads()
        self._engine = Rollout(nthread=count if count > 1 else 0)
        self._data = [mujoco.MjData(self.base) for _ in range(count)]
        self._scratch = mujoco.MjData(self.base)
        self._size = mujoco.mj_stateSize(self.base, FULL)
        self._pool = ModelPool()
        self._last: tuple[tuple[bytes, str, str] | None, mujoco.MjModel] = None, self.base

    @cached_property
    def theta(self) -> np.ndarray:
        """The model's own values of the unknowns, (p,)."""
        return np.array([FIELDS[u.field][2][0](self.base, u.site) for u in self.recording.unknowns])

    def model(self, hypothesis: Hypothesis) -> mujoco.MjModel:
        """Build the MuJoCo model under `hypothesis`, force, command and measurement laws left out."""
        model = copy.copy(self.base)
        for unknown, value in zip(self.recording.unknowns, hypothesis.theta, strict=True):
            FIELDS[unknown.field][2][1](model, unknown.site, value)
        for placed in hypothesis.of_kind("model"):
            placed.effect.law(model, placed.site, **placed.values)
        make_friction_exact(model, self.base, hypothesis.placed)
        self._slow(model.pair_solref)
        self._slow(model.geom_solref)
        mujoco.mj_setConst(model, self._scratch)
        return model

    @DIVERGED
    def predict(self, hypothesis: Hypothesis, windows: Windows, qpos, qvel, act=None) -> np.ndarray:
        """Predict measurements, (w, T, ny), from states at the start of each window.

        What a late or an early sensor reads beyond the ends of a window is extrapolated by its law.

        Args:
            qpos: (w, nq). qvel: (w, nv). act: states of actuators, (w, na), zero by default: whoever simulates a servo
                with a filter sets them from its command.
        """
        act = np.zeros((len(qpos), self.base.na)) if act is None else act
        parts = min(1 + len(qpos) * windows.length * self.substeps // MOST_STEPS, len(qpos))
        states = (np.array_split(own, parts) for own in (np.arange(len(qpos)), qpos, qvel, act))
        found = [self._predict(hypothesis, windows.part(rows), *state) for rows, *state in zip(*states, strict=True)]
        return np.concatenate(found)

    def _predict(self, hypothesis: Hypothesis, windows: Windows, qpos, qvel, act) -> np.ndarray:
        read = hypothesis.of_kind("measurement")
        # What is read at another time is read between steps, not samples.
        every = 1 if any(placed.effect.shifts_time for placed in read) else self.substeps
        last, pieces = (windows.length - 1) * self.substeps + 1, self.substeps // every
        measured = self._sensors(hypothesis, windows, self._pack(qpos, qvel, act))[:, :last:every, self.columns]
        if read:
            signal = self.commands.signal(windows, measured.shape[1], self.recording.period / pieces)
            signal = replace(signal, parts=pieces if self.base.nu else 1)  # forces jump when commands do
            for placed in read:
                measured = placed.effect.law(measured, signal, placed.site, **placed.values)
        return measured[:, ::pieces]

    @DIVERGED
    def advance(self, model: mujoco.MjModel, qpos, qvel, act, ctrl, force, every=False) -> tuple[np.ndarray, ...]:
        """Advance n independent states by one sample, or by as many steps as commands are given for, in one simulation.

        Args:
            model: of `model`, perhaps edited since. qpos, qvel, act: (n, nq), (n, nv), (n, na). ctrl: held over the
                sample, (n, nu), or of each of its steps, (n, steps, nu). force: generalised, N or N m: held, (n, nv).

        Returns:
            qpos, qvel and act at the end of the sample, and the channels at its start, (n, ny), or where `every` is
            asked for, at that of each step, (n, steps, ny).
        """
        n, nu, each = len(qpos), model.nu, np.ndim(ctrl) == 3
        steps = ctrl.shape[1] if each else round(self.recording.period / model.opt.timestep)
        control = np.empty((n, steps, nu + model.nv))
        control[:, :, :nu] = ctrl if each else np.asarray(ctrl)[:, None]
        control[:, :, nu:] = force[:, None]
        state, sensed = np.empty((n, steps, self._size)), np.empty((n, steps, model.nsensordata))
        with without_idle_solver(model), held_by_servos([model], self.recording.period):
            self._run([model] * n, self._pack(qpos, qvel, act), control, state, sensed)
        return *self._unpack(state[:, -1].copy()), sensed[:, :, self.columns] if every else sensed[:, 0, self.columns]

    def _drive(self, hypothesis: Hypothesis, windows: Windows) -> Drive:
        signal = self.commands.signal(windows, windows.length * self.substeps)
        return Drive(signal, *self.commands.given(hypothesis.placed, windows, signal))

    def _sensors(self, hypothesis: Hypothesis, windows: Windows, start: np.ndarray) -> np.ndarray:
        """All sensors at the start of each step, (w, n, nsensordata)."""
        laws, drive = hypothesis.of_kind(*LAWS), self._drive(hypothesis, windows)
        model = self._cached_model(hypothesis)
        if not laws:
            with without_idle_solver(model), held_by_servos([model], self.recording.period):
                return self._at_once(model, drive, start)
        copies = self._pool.for_windows(model, len(start)) if hypothesis.of_kind(*WRITES) else []
        added = AddedForces(model, copies, laws)
        with held_by_servos(copies or [model], self.recording.period):
            return self._step_by_step(model, added, copies, drive, start)

    def _cached_model(self, hypothesis: Hypothesis) -> mujoco.MjModel:
        """The model as made for the last prediction where it is the same: many hypotheses differ in laws only."""
        fields = [(p.name, p.effect.enters, sorted(p.values.items())) for p in hypothesis.of_kind("model")]
        rubbing = [p.name for p in hypothesis.of_kind("friction")]
        key = hypothesis.theta.tobytes(), repr(fields), repr(rubbing)
        if self._last[0] != key:
            self._last = key, self.model(hypothesis)
        return self._last[1]

    def _at_once(self, model: mujoco.MjModel, drive: Drive, start: np.ndarray) -> np.ndarray:
        control = np.concatenate([drive.mean, np.zeros((*drive.mean.shape[:2], model.nv))], 2)
        state, sensed = self._engine.rollout(model, self._data, start, control, control_spec=CONTROL)
        if drive.instant is not None:
            before = np.concatenate([start[:, None], state[:, :-1]], 1)[:, :: self.substeps]
            control[:, :, : model.nu] = drive.instant
            states, controls = (p.reshape(-1, 1, p.shape[2]) for p in (before, control[:, :: self.substeps]))
            read = self._engine.rollout(model, self._data, states[:, 0], controls, control_spec=CONTROL)[1]
            sensed[:, :: self.substeps] = read.reshape(*before.shape[:2], -1)
        return sensed

    def _step_by_step(self, model, added: AddedForces, copies: list, drive: Drive, state: np.ndarray) -> np.ndarray:
        (w, steps), before = drive.mean.shape[:2], state
        memory: dict[object, object] = {}
        sensed, after = np.empty((steps, w, 1, model.nsensordata)), np.empty((w, 1, self._size))
        models = copies or [model] * w
        for k in range(steps):
            ctrl, time = drive.mean[:, k], drive.signal.time[:, k]
            # Half a step ahead, so that holding the force over the step is accurate to second order.
            ahead = self._seen(model, state + (state - before) / 2, ctrl, time, memory)
            now = self._seen(model, state, ctrl, time, memory)
            force, instant_force = added(now, ahead)
            self._run(models, state, np.concatenate([ctrl, force], 1)[:, None], after, sensed[k])
            if k % self.substeps == 0 and (drive.instant is not None or (added.gears and self.commands.instant)):
                added.at_start()
                ctrl = ctrl if drive.instant is None else drive.instant[:, k]
                self._run(models, state, np.concatenate([ctrl, instant_force], 1)[:, None], None, sensed[k])
            added.shift_encoders(sensed[k, :, 0])
            before, state = state, after[:, 0].copy()
        return sensed[:, :, 0].swapaxes(0, 1)

    def _run(self, models: list, start, control, state, sensed) -> None:
        """Fill `state` and `sensed`, (n, steps, size) each, without MuJoCo's own checks and copies."""
        sizes = {"nstep": control.shape[1], "control_spec": CONTROL, "skip_checks": True}
        self._engine.rollout(models, self._data, start, control, state=state, sensordata=sensed, **sizes)

    def _slow(self, solref: np.ndarray) -> None:
        """Make time constants no shorter than the recording's own time step allows; a direct form has none."""
        standard = (solref[:, 0] > 0) & (not self.base.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE)
        solref[standard, 0] = np.maximum(solref[standard, 0], self.quickest)

    def _seen(self, model, state: np.ndarray, ctrl, time, memory: dict) -> State:
        qpos, qvel, _ = self._unpack(state)
        return State(model, qpos, qvel, ctrl, time, model.opt.timestep, memory)

    def _pack(self, qpos, qvel, act) -> np.ndarray:
        """States as MuJoCo packs them: time, qpos, qvel, act, and what plugins keep."""
        base, state = self.base, np.zeros((len(qpos), self._size))
        state[:, 1 : 1 + base.nq] = qpos
        state[:, 1 + base.nq : 1 + base.nq + base.nv] = qvel
        state[:, 1 + base.nq + base.nv : 1 + base.nq + base.nv + base.na] = act
        return state

    def _unpack(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        base = self.base
        ends = np.cumsum([1, base.nq, base.nv, base.na])
        qpos, qvel, act = (state[..., a:b] for a, b in pairwise(ends))
        return qpos, qvel, act
