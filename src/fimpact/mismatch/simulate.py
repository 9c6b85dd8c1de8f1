"""Windows of a recording, simulated by MuJoCo C under a hypothesis: parameter values and effects added to the model.

All windows advance together: `mujoco.rollout` steps them in C, and a force law that MuJoCo lacks is evaluated once per
step for all of them. A secant of that is the sensitivity to anything, through contact and without compilation.
"""

import copy
import os
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from fimpact.effects.base import Placed, State
from fimpact.effects.native import editable
from fimpact.mismatch.acting import OWN, Acting
from fimpact.mismatch.commands import Commands
from fimpact.mismatch.copies import Copies
from fimpact.mismatch.late import Late, motion_key
from fimpact.mismatch.touch import can_hold
from fimpact.mismatch.windows import Windows
from fimpact.quiet import hush
from fimpact.recordings import FIELDS, Recording

CONVERGED, ITERATIONS = 1e-13, 50  # of MuJoCo's constraint solver
LAWS = ("force", "friction", "gear")  # what is asked once per step
# A trial that diverges is an infinite cost, and no news: numpy need not warn of it.
DIVERGED = np.errstate(over="ignore", invalid="ignore")
CONTROL = int(mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_QFRC_APPLIED)


@dataclass(frozen=True)
class Hypothesis:
    """Values of the recording's unknowns, (p,), and the effects that are added."""

    theta: np.ndarray
    placed: tuple[Placed, ...] = ()


def threads() -> int:
    """Threads that simulate: OMP_NUM_THREADS, which Snakemake sets for each of its jobs, or as many as there are cores.
    What comes out does not depend on it."""
    given = os.environ.get("OMP_NUM_THREADS", "")
    return int(given) if given.isdecimal() and int(given) else os.cpu_count() or 1


hush()


class Simulator:
    """Predicts what the channels of `recording` read, at its time step divided by `refine`."""

    def __init__(self, recording: Recording, refine: int = 1):
        self.recording = recording
        spec = recording.spec()
        spec.option.timestep /= refine
        self.base = editable(spec)
        # A diverged state must show as NaN, not as a silent reset. Islands change no digit and cost a twentieth.
        self.base.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET | mujoco.mjtDisableBit.mjDSBL_ISLAND
        # A secant through contact needs a solver that has converged further than a picture does.
        self.base.opt.tolerance = min(self.base.opt.tolerance, CONVERGED)
        self.base.opt.iterations = max(self.base.opt.iterations, ITERATIONS)
        self.base.opt.ls_iterations = max(self.base.opt.ls_iterations, ITERATIONS)
        self.substeps = max(1, round(recording.period / self.base.opt.timestep))
        self.base.opt.timestep = recording.period / self.substeps
        # What MuJoCo does to a contact that is too quick for its time step (refsafe) belongs to the model: finer steps
        # measure the error of the integrator, and must not simulate a quicker contact.
        self.quickest = 2 * self.base.opt.timestep * refine
        self.columns = np.array([_sensor_column(self.base, name) for name in recording.channels])
        self.commands = Commands(self.base, recording, self.substeps)
        count = threads()
        self._engine = Rollout(nthread=count if count > 1 else 0)
        self._data = [mujoco.MjData(self.base) for _ in range(count)]
        self._scratch = mujoco.MjData(self.base)
        self._last: tuple = ()
        self._copies = Copies()
        self._sensed: tuple = (None, None, None)
        self.late = Late(self)

    @cached_property
    def theta(self) -> np.ndarray:
        """The model's own values of the unknowns, (p,)."""
        return np.array([FIELDS[u.field][2][0](self.base, u.site) for u in self.recording.unknowns])

    def model(self, hypothesis: Hypothesis) -> mujoco.MjModel:
        """The MuJoCo model under `hypothesis`, force, command and measurement laws left out."""
        model = copy.copy(self.base)
        for unknown, value in zip(self.recording.unknowns, hypothesis.theta, strict=True):
            FIELDS[unknown.field][2][1](model, unknown.site, value)
        for placed in hypothesis.placed:
            if placed.effect.enters == "model":
                placed.effect.law(model, placed.site, **placed.values)
        self._slow(model.pair_solref)
        self._slow(model.geom_solref)
        mujoco.mj_setConst(model, self._scratch)
        return model

    def _slow(self, solref: np.ndarray) -> None:
        """Time constants no shorter than the recording's own time step allows; a direct form has none."""
        standard = (solref[:, 0] > 0) & (not self.base.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE)
        solref[standard, 0] = np.maximum(solref[standard, 0], self.quickest)

    def _models(self, hypothesis: Hypothesis, count: int = 0) -> tuple[mujoco.MjModel, list[mujoco.MjModel]]:
        """The model under `hypothesis` and `count` copies, as made for the last prediction where they are of
        the same parameters: most hypotheses that follow one another differ in states and laws only."""
        fields = [(p.name, sorted(p.values.items())) for p in hypothesis.placed if p.effect.enters == "model"]
        key = hypothesis.theta.tobytes(), repr(fields), bool(count)
        if not self._last or self._last[0] != key:
            model = self.model(hypothesis)
            # What nothing holds needs no solver: the same digits, an eighth sooner.
            held = count or can_hold(model)
            model.opt.disableflags |= 0 if held else mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
            self._last = key, model
        model = self._last[1]
        return model, self._copies.of(model, count) if count else []

    @DIVERGED
    def predict(self, hypothesis, windows: Windows, qpos, qvel, push: np.ndarray | None = None) -> np.ndarray:
        """Measurements, (w, T, ny), from states qpos (w, nq), qvel (w, nv) at the start of each window.

        Args:
            push: generalised force added in each sample, (w or 1, T, nv), or each simulation step, N or N m.
        """
        read = [placed for placed in hypothesis.placed if placed.effect.enters == "measurement"]
        # What is read at another time is read between steps, not samples; but what may jump with a command, at samples.
        every = 1 if read and not self.base.nu else self.substeps
        last, pieces = (windows.length - 1) * self.substeps + 1, self.substeps // every
        before, after = self.late.reach(hypothesis, windows)
        last += after * self.substeps
        measured = self._sense(hypothesis, windows, qpos, qvel, push, after)[:, :last:every, self.columns]
        if read:
            signal = self.commands.signal(windows, measured.shape[1], self.recording.period / pieces)
        if before or after:
            past = self.late.past(hypothesis, windows, qpos, qvel, before) if before else None
            measured, signal = self.late.extended(windows, measured, past, before, after, every)
        for placed in read:
            measured = placed.effect.law(measured, signal, placed.site, **placed.values)
        return measured[:, before * pieces :: pieces][:, : windows.length]

    def motion(self, hypothesis, windows: Windows, qpos, qvel) -> tuple[np.ndarray, np.ndarray]:
        """qpos (w, n, nq) and qvel (w, n, nv) after each of the n simulation steps, force laws left out."""
        model, signal = self.model(hypothesis), self.commands.signal(windows, windows.length * self.substeps)
        ctrl = self.commands.given(hypothesis.placed, windows, signal)[0]
        control = np.concatenate([ctrl, np.zeros((*ctrl.shape[:2], model.nv))], 2)
        state = self._engine.rollout(model, self._data, self._pack(qpos, qvel), control, control_spec=CONTROL)[0]
        return state[:, :, 1 : 1 + model.nq], state[:, :, 1 + model.nq : 1 + model.nq + model.nv]

    def _sense(self, hypothesis, windows: Windows, qpos, qvel, push: np.ndarray | None, after: int = 0) -> np.ndarray:
        """All sensors after each step, (w, n, sensors), of the windows and `after` samples more; those of the last call
        where it was the same motion, for often only what is measured of it differs, or nothing."""
        key, alone = motion_key(hypothesis, windows, qpos, qvel), push is None
        within, steps = (samples * self.substeps for samples in (windows.length, windows.length + after))
        if alone and self._sensed[0] == key and self._sensed[1] is windows.ctrl and self._sensed[2].shape[1] >= steps:
            return self._sensed[2][:, :steps]
        model, copies, laws = self.acted(hypothesis, len(qpos))
        signal = self.commands.signal(windows, steps)
        ctrl, instant = self.commands.given(hypothesis.placed, windows, signal)
        push = np.zeros((1, 1, model.nv)) if alone else push
        force = np.pad(np.repeat(push, within // push.shape[1], 1), ((0, 0), (0, steps - within), (0, 0)))
        run = self._lockstep if laws else self._rollout
        force = np.broadcast_to(force, (len(ctrl), *force.shape[1:]))
        sensed = run(model, copies, signal, ctrl, instant, force, qpos, qvel, laws, windows.memory)
        if alone:
            self._sensed = key, windows.ctrl, sensed
        return sensed

    def acted(self, hypothesis, count: int) -> tuple[mujoco.MjModel, list[mujoco.MjModel], list[Placed]]:
        """The model of `count` windows, a copy for each if laws change its fields, and the laws asked in each step."""
        own = count * any(placed.effect.enters in OWN for placed in hypothesis.placed)
        return *self._models(hypothesis, own), [p for p in hypothesis.placed if p.effect.enters in LAWS]

    def passed(self, hypothesis, windows: Windows, qpos, qvel) -> tuple[list[State], np.ndarray, np.ndarray]:
        """What a force law would see in each of n simulation steps, had it no effect, and qpos (w, n, nq) and qvel
        (w, n, nv) at their starts."""
        model, signal = self.model(hypothesis), self.commands.signal(windows, windows.length * self.substeps)
        ctrl = self.commands.given(hypothesis.placed, windows, signal)[0]
        motion = zip((qpos, qvel), self.motion(hypothesis, windows, qpos, qvel), strict=True)
        states = [np.concatenate([start[:, None], after[:, :-1]], 1) for start, after in motion]
        ahead = [own + np.diff(own, axis=1, prepend=own[:, :1]) / 2 for own in states]
        rows = zip(*(part.swapaxes(0, 1) for part in (*ahead, ctrl, signal.time)), strict=True)
        return [State(model, *row, model.opt.timestep, windows.memory, {}) for row in rows], *states

    def step(self, model: mujoco.MjModel, qpos, qvel, control) -> np.ndarray:
        """One step from each state under controls and forces, (r, nu + nv): qpos and qvel after it, and what all
        sensors read before it, (r, nq + nv + sensors)."""
        state, sensed = self._engine.rollout(
            model, self._data, self._pack(qpos, qvel), control[:, None], control_spec=CONTROL
        )
        return np.concatenate([state[:, 0, 1 : 1 + model.nq + model.nv], sensed[:, 0]], 1)

    def _rollout(self, model, copies, signal, ctrl, instant, force, qpos, qvel, laws, memory):
        control, start = np.concatenate([ctrl, force], 2), self._pack(qpos, qvel)
        state, sensed = self._engine.rollout(model, self._data, start, control, control_spec=CONTROL)
        if instant is not None:
            before = np.concatenate([start[:, None], state[:, :-1]], 1)[:, :: self.substeps]
            control[:, :, : model.nu] = instant
            flat = (part.reshape(-1, 1, part.shape[2]) for part in (before, control[:, :: self.substeps]))
            read = self._engine.rollout(model, self._data, next(flat)[:, 0], next(flat), control_spec=CONTROL)[1]
            sensed[:, :: self.substeps] = read.reshape(*before.shape[:2], -1)
        return sensed

    def _lockstep(self, model, copies, signal, ctrl, instant, force, qpos, qvel, laws, memory):
        state = self._pack(qpos, qvel)
        before, after, (w, steps) = state, np.empty((len(state), 1, state.shape[1])), ctrl.shape[:2]
        sensed = np.empty((steps, w, 1, model.nsensordata))
        models, acting = copies or [model] * w, Acting(model, copies, laws)
        for k in range(steps):
            # Half a step ahead, so that holding the force over the step is accurate to second order.
            ahead = self.seen(model, state + (state - before) / 2, ctrl[:, k], signal.time[:, k], memory)
            now = self.seen(model, state, ctrl[:, k], signal.time[:, k], memory) if acting.gears else ahead
            told = ctrl[:, k], None if instant is None else instant[:, k], force[:, k]
            self.advance(models, acting, state, (now, ahead), told, k % self.substeps == 0, after, sensed[k])
            before, state = state, after[:, 0].copy()
        return sensed[:, :, 0].transpose(1, 0, 2)

    def advance(self, models, acting: Acting, state, seen, told, reads: bool, after, sensed) -> None:
        """One step of all windows, into `after` and `sensed`, (w, 1, n) each.

        Args:
            seen: the states at the start of the step, which only gears ask for, and half a step ahead. told: commands
                over the step and at its start, None: the same, and forces. reads: whether it begins at a sample.
        """
        ctrl, instant, force = told
        pull, at_once = acting(*seen, force)
        control = np.concatenate([ctrl, pull], 1)[:, None]
        sizes = {"nstep": 1, "control_spec": CONTROL, "skip_checks": True}
        self._engine.rollout(models, self._data, state, control, state=after, sensordata=sensed, **sizes)
        if reads and (instant is not None or (acting.gears and self.commands.instant)):
            acting.begin()
            control[:, 0] = np.concatenate([ctrl if instant is None else instant, at_once], 1)
            self._engine.rollout(models, self._data, state, control, sensordata=sensed, **sizes)
        acting.read(sensed[:, 0])

    @staticmethod
    def seen(model, state, ctrl, time, memory) -> State:
        """What laws see of `state`, (w, 1 + nq + nv), as MuJoCo packs it."""
        qpos, qvel = state[:, 1 : 1 + model.nq], state[:, 1 + model.nq : 1 + model.nq + model.nv]
        return State(model, qpos, qvel, ctrl, time, model.opt.timestep, memory)

    def _pack(self, qpos, qvel) -> np.ndarray:
        rest = np.zeros((len(qpos), self.base.na))
        return np.concatenate([np.zeros((len(qpos), 1)), qpos, qvel, rest], 1)


def _sensor_column(model: mujoco.MjModel, channel: str) -> int:
    name, _, component = channel.removesuffix("]").partition("[")
    return model.sensor(name).adr[0] + int(component or 0)
