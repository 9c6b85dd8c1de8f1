"""Inputs: a recording's commands at every simulation step, as laws of commands change them."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import mujoco
import numpy as np
from scipy.interpolate import make_smoothing_spline

from fimpact.deciding import NOTHING
from fimpact.effects.base import Placed
from fimpact.effects.law_inputs import Signal
from fimpact.recordings import Recording
from fimpact.simulation.windows import Windows

POWERS = (-4.0, 12.0)  # of ten: smoothness of splines, from the signal itself to a straight line
FINER = 16  # pieces of a step in which a law between command and motor is evaluated


class InputSignal:
    """Commands of `recording` to a `model` that takes `substeps` steps for each sample."""

    def __init__(self, model: mujoco.MjModel, recording: Recording, substeps: int):
        self.model, self.recording, self.substeps = model, recording, substeps
        self._noise: dict[tuple, np.ndarray] = {}
        sensors = [model.sensor(name.partition("[")[0]).id for name in recording.channels]
        # What a sensor of forces or accelerations reads depends on the command of the very moment.
        self.instant = bool(np.any(model.sensor_needstage[sensors] == mujoco.mjtStage.mjSTAGE_ACC))

    def signal(self, windows: Windows, steps: int, period: float | None = None) -> Signal:
        """Sample times and commands of `windows` at the first `steps` simulation steps, or `period`, s, apart."""
        step = period or self.model.opt.timestep
        time = windows.first[:, None] * self.recording.period + np.arange(steps) * step
        index = (time / self.recording.period + 1e-9).astype(int)
        ctrl = windows.ctrl[windows.runs[:, None], np.clip(index, 0, windows.ctrl.shape[1] - 1)]
        return self.describe(time, ctrl)

    def describe(self, time: np.ndarray, ctrl: np.ndarray) -> Signal:
        """Add to commands `ctrl` (n, T, nu) at `time` (n, T), s, all that laws ask about channels and actuators."""
        gear = self.model.actuator_gear[:, 0] * self.model.actuator_gainprm[:, 0]
        return replace(self._rig, time=time, ctrl=ctrl, force=ctrl * gear)

    def given(self, placed: Sequence[Placed], windows: Windows, signal: Signal) -> tuple[np.ndarray, np.ndarray | None]:
        """Apply the laws of commands: the mean over each step, (w, n, nu), and the value at its start.

        The latter is None unless laws make them differ and sensors show it: a delay or a lag may be shorter than a
        step, and a force sensor that is read at the start of a step knows nothing yet of its end.
        """
        laws = [p for p in placed if p.effect.enters == "command"]
        if not laws:
            return signal.ctrl, None
        # Whole runs, because a window's first commands depend on those before it.
        ctrl = self.pieces(laws, windows)
        pieces = ctrl.reshape(len(ctrl), -1, FINER, ctrl.shape[2])
        steps = windows.first[:, None] * self.substeps + np.arange(signal.time.shape[1])
        rows = windows.runs[:, None], np.clip(steps, 0, pieces.shape[1] - 1)
        return pieces.mean(2)[rows], self.at_starts(laws, ctrl, FINER)[rows] if self.instant else None

    def pieces(self, laws: Sequence[Placed], windows: Windows) -> np.ndarray:
        """Commands of whole runs as `laws` change them, in `FINER` pieces of each step, (runs, T, nu)."""
        ctrl = np.repeat(windows.ctrl, self.substeps * FINER, 1)
        time = np.broadcast_to(np.arange(ctrl.shape[1]) * (self.model.opt.timestep / FINER), ctrl.shape[:2])
        noise = np.repeat(self._noise_in(windows.ctrl), self.substeps * FINER, 1)
        for law in laws:
            signal = replace(self.describe(time, ctrl), noise=noise)
            ctrl = law.effect.law(ctrl, signal, law.site, **law.values)
        return ctrl

    def at_starts(self, laws: Sequence[Placed], pieces: np.ndarray, every: int) -> np.ndarray:
        """Commands at the moment at which each `every` of `pieces` (runs, T, nu) begins: what `laws` hold back, however
        briefly, has not yet followed one that jumps there."""
        now = pieces[:, ::every].copy()
        held = [law for law in laws if law.effect.shifts_time and law.values != law.effect.neutral]
        for own in {own for law in held for own in self._rig.column(law.site)}:
            now[:, 1:, own] = pieces[:, every - 1 :: every, own][:, : now.shape[1] - 1]
        return now

    def _noise_in(self, ctrl: np.ndarray) -> np.ndarray:
        """What of commands (runs, T, nu) is noise of the log: of torques that are measured, not of targets."""
        key = ctrl.shape, hash(ctrl.tobytes())
        if key not in self._noise:
            found = np.zeros_like(ctrl)
            for own in np.flatnonzero(self.model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE):
                found[:, :, own] = noise_in(ctrl[:, :, own])
            self._noise = {key: found}
        return self._noise[key]

    @cached_property
    def _rig(self) -> Signal:
        """All of a signal that is the same at any time."""
        model, none = self.model, np.zeros((0, 0, self.model.nu))
        joints = tuple(_joint_of(model, name) for name in self.recording.channels)
        driven = tuple(_driver(model, joint) for joint in joints)
        actuators = tuple(model.actuator(i).name for i in range(model.nu))
        holding = tuple((model.actuator_biasprm[:, 1] != 0).tolist())
        return Signal(np.zeros((0, 0)), none, self.recording.channels, actuators, none, joints, driven, holding)


def noise_in(signals: np.ndarray) -> np.ndarray:
    """White noise of signals (runs, T): what a smoothing spline leaves that lies as far from them as their third
    differences say (Reinsch, Numerische Mathematik 10, 1967); nothing of smooth signals, nor of steps."""
    thirds = np.abs(np.diff(signals, 3, axis=1))
    level = np.median(thirds[thirds > 0]) / np.sqrt(20.0) if np.mean(thirds > 0) > 0.5 else 0.0  # variances add up
    if level <= NOTHING * signals.std():
        return np.zeros_like(signals)
    time = np.arange(signals.shape[1], dtype=float)

    def left(power: float) -> np.ndarray:
        return signals - make_smoothing_spline(time, signals.T, lam=10.0**power)(time).T

    least, most = POWERS
    while most - least > 0.1:
        power = (least + most) / 2
        least, most = (power, most) if np.median(np.abs(left(power))) < level else (least, power)
    return left(least)


def _joint_of(model: mujoco.MjModel, channel: str) -> str:
    sensor = model.sensor(channel.partition("[")[0])
    known = sensor.type[0] == mujoco.mjtSensor.mjSENS_JOINTPOS
    return model.joint(sensor.objid[0]).name if known else ""


def _driver(model: mujoco.MjModel, joint: str) -> int:
    if not joint:
        return -1
    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    drives = on_joint & (model.actuator_trnid[:, 0] == model.joint(joint).id)
    return int(np.argmax(drives)) if drives.any() else -1
