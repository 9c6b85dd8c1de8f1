"""Inputs: a recording's commands at every simulation step, as laws of commands change them."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import mujoco
import numpy as np

from fimpact.effects.base import Placed
from fimpact.effects.law_inputs import Signal
from fimpact.recordings import Recording
from fimpact.simulation.windows import Windows

FINER = 16  # pieces of a step in which a law between command and motor is evaluated


class InputSignal:
    """Commands of `recording` to a `model` that takes `substeps` steps for each sample."""

    def __init__(self, model: mujoco.MjModel, recording: Recording, substeps: int):
        self.model, self.recording, self.substeps = model, recording, substeps
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
        return pieces.mean(2)[rows], pieces[:, :, 0][rows] if self.instant else None

    def pieces(self, laws: Sequence[Placed], windows: Windows) -> np.ndarray:
        """Commands of whole runs as `laws` change them, in `FINER` pieces of each step, (runs, T, nu)."""
        ctrl = np.repeat(windows.ctrl, self.substeps * FINER, 1)
        time = np.broadcast_to(np.arange(ctrl.shape[1]) * (self.model.opt.timestep / FINER), ctrl.shape[:2])
        for law in laws:
            ctrl = law.effect.law(ctrl, self.describe(time, ctrl), law.site, **law.values)
        return ctrl

    @cached_property
    def _rig(self) -> Signal:
        """All of a signal that is the same at any time."""
        model, none = self.model, np.zeros((0, 0, self.model.nu))
        joints = tuple(_joint_of(model, name) for name in self.recording.channels)
        driven = tuple(_driver(model, joint) for joint in joints)
        actuators = tuple(model.actuator(i).name for i in range(model.nu))
        holding = tuple((model.actuator_biasprm[:, 1] != 0).tolist())
        return Signal(np.zeros((0, 0)), none, self.recording.channels, actuators, none, joints, driven, holding)


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
