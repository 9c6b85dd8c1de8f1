"""The samples of a recording's runs, one after the other, and the model's own simulator over one of them."""

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from fimpact.effects.base import Placed
from fimpact.recordings import Recording, Run
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.inputs import FINER as PIECES
from fimpact.simulation.nonsmooth import stop_within_a_step
from fimpact.simulation.rotors import Rotors
from fimpact.simulation.servo_steps import is_long, servo_gains
from fimpact.simulation.simulator import Simulator
from fimpact.simulation.state_guess import believed_noise
from fimpact.simulation.windows import Windows, cut
from fimpact.smoothing.dynamics.sampled_commands import Commands, sharp
from fimpact.smoothing.states import States, Tangent, tangent

LONG = 256  # samples that a law with a memory is given to gather it
SHAPE = ("geom_pos", "geom_quat", "geom_size", "pair_margin", "body_pos", "body_quat")  # of what may touch
ACCELERATION = int(mujoco.mjtStage.mjSTAGE_ACC)


@dataclass(frozen=True)
class Step:
    """What one sample leads to: the states after it, and the readings (N, ny) at its start; within: at the start of
    each of its steps, (N, steps, ny), where sensors show what happens within a sample."""

    after: States
    readings: np.ndarray
    within: np.ndarray | None = None


class Track:
    """All samples of `runs`, N of them, row after row, and what the model makes of each."""

    def __init__(self, simulator: Simulator, runs: Sequence[Run]):
        self.simulator, self.runs = simulator, tuple(runs)
        self.model: mujoco.MjModel = simulator.base
        self.recording: Recording = simulator.recording
        self.period = self.recording.period
        self.space: Tangent = tangent(self.model)
        self.lengths = np.array([len(run.measured) for run in runs])
        self.bounds = np.concatenate([[0], np.cumsum(self.lengths)])
        self.measured = np.concatenate([run.measured for run in runs])
        self.count = len(self.measured)
        self.last = np.zeros(self.count, bool)
        self.last[self.bounds[1:] - 1] = True
        self.run_of = np.repeat(np.arange(len(runs)), self.lengths)
        self.steps = 0  # simulated so far
        self._believed: tuple[np.ndarray, tuple] | None = None
        self._touching: tuple[States | None, list[np.ndarray], np.ndarray] = None, [], np.zeros(0, bool)
        self._rotors: dict[tuple[str, ...], Rotors] = {}
        self._given: dict[str, Commands] = {}  # as laws changed them last, and the time before
        self.time = np.concatenate([np.arange(length) * self.period for length in self.lengths])

    @cached_property
    def windows(self) -> Windows:
        """The runs as windows, one each, padded."""
        return cut(self.runs, 0) if len(self.runs) == 1 else _whole(self.runs)

    @cached_property
    def long(self) -> bool:
        """Whether a sample is long against the servos: within it joints turn back, and dry friction is simulated."""
        return is_long(self.model, self.period)

    @cached_property
    def served(self) -> frozenset[str]:
        """Joints that a servo holds."""
        stiffness, _ = servo_gains(self.model) or np.zeros((2, self.model.nv))
        return frozenset(self.model.joint(i).name for i in self.model.dof_jntid[stiffness > 0])

    @cached_property
    def ctrl(self) -> np.ndarray:
        """Commands as recorded, (N, 1, nu)."""
        return np.concatenate([run.ctrl for run in self.runs])[:, None]

    @cached_property
    def late(self) -> np.ndarray:
        """Which channels read forces or accelerations, (ny,)."""
        sensors = [self.model.sensor(name.partition("[")[0]).id for name in self.recording.channels]
        return self.model.sensor_needstage[sensors] == ACCELERATION

    def believed(self, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest sd of the readings that is believed, (ny,) each; noise: what the samples show."""
        if self._believed is None or not np.array_equal(self._believed[0], noise):
            self._believed = noise, believed_noise(self.recording, noise)
        return self._believed[1]

    def slices(self) -> list[slice]:
        """Rows of each run."""
        return [slice(a, b) for a, b in zip(self.bounds[:-1], self.bounds[1:], strict=True)]

    @cached_property
    def pieces(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows (pieces, n) of stretches that a law with a memory passes side by side, and which of them count, a mask:
        before the others it only gathers what it remembers. Runs no longer than a stretch begin at their start."""
        rows, counted = [], []
        size = 2 * LONG
        for part in self.slices():
            for begin in range(part.start, part.stop, LONG):
                index = np.arange(max(begin - LONG, part.start), min(begin + LONG, part.stop))
                filled = np.pad(index, (0, size - len(index)), "edge")
                rows.append(filled)
                counted.append((filled >= begin) & (np.arange(size) < len(index)))
        return np.array(rows), np.array(counted)

    def gathered(self, pieces: np.ndarray) -> np.ndarray:
        """Rows (N, ...) of an array by piece, (pieces, n, ...)."""
        rows, counted = self.pieces
        out = np.empty((self.count, *pieces.shape[2:]))
        out[rows[counted]] = pieces[counted]
        return out

    def flat(self, padded: np.ndarray) -> np.ndarray:
        """Rows (N, ...) of an array by run, (runs, longest, ...)."""
        return np.concatenate([padded[i, :n] for i, n in enumerate(self.lengths)])

    def padded(self, rows: np.ndarray) -> np.ndarray:
        """An array by run, (runs, longest, ...), of `rows` (N, ...), each run continued by its last."""
        index = np.minimum(np.arange(self.lengths.max()), self.lengths[:, None] - 1) + self.bounds[:-1, None]
        return rows[index]

    def commands(self, placed: Sequence[Placed] = ()) -> Commands:
        """Commands that reach the plant, as the laws of commands among `placed` change them."""
        laws = [p for p in placed if p.effect.enters == "command"]
        if not laws:
            return Commands(self.ctrl)
        key = repr([(law.name, law.values) for law in laws])
        if key not in self._given:
            inputs, substeps = self.simulator.commands, self.simulator.substeps
            laws, jumps = sharp(laws, self.period, substeps * PIECES) if self.long else (laws, ())
            whole = self.windows.ctrl[:, : self.lengths.max()]
            given = inputs.pieces(laws, replace(self.windows, ctrl=whole))
            starts = inputs.at_starts(laws, given, substeps * PIECES)
            given = given.reshape(len(given), -1, substeps * PIECES, given.shape[2])
            values = given if jumps else given.reshape(*given.shape[:2], substeps, PIECES, -1).mean(3)
            last = list(self._given.items())[-1:]
            shown = self.late.any() and not jumps
            instant = self.flat(starts) if shown else None
            self._given = dict([*last, (key, Commands(self.flat(values), jumps, instant))])
        return self._given[key]

    def ahead(
        self, models: Sequence[mujoco.MjModel], states: States, ctrl: Commands, force: np.ndarray,
        gears: Sequence[Placed] = (),
    ) -> Step:  # fmt: skip
        """One sample ahead of each state under `ctrl` and `force` (N, nv): at the step of a model, or where there is
        one at half of it, at no step at all: what halving it changes is added once more (Richardson).

        Args:
            gears: those that give, of which `states` has the rotors.
        """
        least = round(self.period / models[0].opt.timestep)
        ends = [self._ahead(model, states, ctrl, force, least, gears) for model in models]
        if len(ends) == 1:
            return ends[0]
        after = self.space.plus(ends[1].after, self.space.minus(ends[1].after, ends[0].after))
        return replace(ends[0], after=after)

    def touching(self, states: States, model: mujoco.MjModel | None = None) -> np.ndarray:
        """Whether anything touches in each state, (N,), under `model`, default: the track's own."""
        model = model or self.model
        shape = [np.asarray(getattr(model, name)) for name in SHAPE]
        if self._touching[0] is not states or not all(map(np.array_equal, shape, self._touching[1])):
            data, now = mujoco.MjData(model), np.zeros(len(states), bool)
            for k, qpos in enumerate(states.qpos):
                data.qpos[:] = qpos
                mujoco.mj_kinematics(model, data)
                mujoco.mj_collision(model, data)
                now[k] = data.ncon > 0
            self._touching = states, [own.copy() for own in shape], now
        return self._touching[2]

    @property
    def quanta(self) -> float:
        """What was simulated so far, in simulations of all samples at the model's own time step."""
        return self.steps / (self.count * self.simulator.substeps)

    def _ahead(self, model: mujoco.MjModel, states: States, ctrl: Commands, force, least: int, gears) -> Step:
        read, every = [], bool(self.late.any())
        advance = self._advancing(tuple(gear.site for gear in gears))
        if ctrl.instant is not None:
            self.steps += len(states)
            now = states.qpos, states.qvel, states.act, ctrl.instant[:, None], force, False
            shown = advance(model, gears, *now)[3]
        for leg, given in ctrl.legs(model, self.period, least):
            *after, readings = advance(leg, gears, states.qpos, states.qvel, states.act, given, force, every)
            self.steps += (given.shape[1] if given.ndim == 3 else round(self.period / leg.opt.timestep)) * len(states)
            read.append(readings)
            states = States(*after)
        if not every:
            return Step(states, read[0])
        if ctrl.instant is not None:
            read[0][:, 0] = shown
        even = len(read) == 1 and read[0].shape[1] > 1  # legs between jumps of commands are not
        return Step(states, read[0][:, 0], read[0] if even else None)

    def _advancing(self, sites: tuple[str, ...]) -> Callable:
        if not sites:
            return lambda model, gears, *now: self.simulator.advance(model, *now)
        if sites not in self._rotors:
            self._rotors[sites] = Rotors(self.simulator, sites)
        return self._rotors[sites].advance

    def read(self, model: mujoco.MjModel, states: States, ctrl: Commands) -> np.ndarray:
        """Readings, (N, ny), in each state under `ctrl`."""
        self.steps += len(states)
        still = np.zeros((len(states), model.nv))
        now = states.qpos, states.qvel, states.act[:, : model.na], ctrl.values[:, :1]
        return self.simulator.advance(model, *now, still)[3]

    def at_steps(self, model: mujoco.MjModel) -> tuple[mujoco.MjModel, mujoco.MjModel]:
        """`model`, and the same at half its time step, from which the step's error is taken out."""
        half = copy.copy(model)
        half.opt.timestep /= 2
        if self.long:
            stop_within_a_step(half)
        return model, half

    def model_of(self, placed: Sequence[Placed], theta: np.ndarray) -> mujoco.MjModel:
        """The model of a hypothesis, laws left out."""
        return self.simulator.model(Hypothesis(theta, tuple(placed)))

    def next(self, states: States) -> States:
        """The state of each row's next, of the last in each run its own."""
        rows = np.minimum(np.arange(self.count) + ~self.last, self.count - 1)
        return states[rows]


def _whole(runs: Sequence[Run]) -> Windows:
    longest = max(len(run.measured) for run in runs)
    measured = np.full((len(runs), longest, runs[0].measured.shape[1]), np.nan)
    for row, run in zip(measured, runs, strict=True):
        row[: len(run.measured)] = run.measured
    ctrl = np.array([run.ctrl[np.minimum(np.arange(2 * longest), len(run.ctrl) - 1)] for run in runs])
    zeros = np.zeros(len(runs), int)
    return Windows(np.arange(len(runs)), zeros, measured, ctrl, tuple(run.name for run in runs))
