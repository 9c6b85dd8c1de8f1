"""Replay: exported files in plain MuJoCo, in the place of a simulator."""

import importlib.util
import sys
from pathlib import Path
from typing import Any
from unittest.mock import patch

import mujoco
import numpy as np

from fimpact.export import runtime_template
from fimpact.recordings import Recording
from fimpact.simulation.windows import Windows

XML, CALLBACK = "improved.xml", "improved.py"
PAST = 500  # rows before a window that a native lag is given to remember


class Replay:
    """Predicts as a `Simulator` does, but by the files in `folder`; lagging: whether actuators in them lag or delay."""

    def __init__(self, recording: Recording, folder: Path, lagging: bool = False):
        self.scene = _module(folder)
        self.scene.PERIOD, self.scene.CHANNELS = recording.period, recording.channels
        self.scene.PAST, self.scene.STATEFUL = PAST * lagging, stateful(recording.spec().compile())
        self.model = self.scene.load(folder / XML)
        # What diverges must show as NaN, not as a silent reset.
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET

    def predict(self, windows: Windows, qpos, qvel, act) -> np.ndarray:
        """Predict measurements, (w, T, ny), from the states at the start of each window."""
        rows = zip(windows.runs, qpos, qvel, act, windows.first.tolist(), strict=True)
        play, length = self.scene.simulate, windows.length
        return np.array([play(self.model, windows.ctrl[run], q, v, first, length, a) for run, q, v, a, first in rows])


def stateful(model: mujoco.MjModel) -> tuple[tuple[int, int], ...]:
    """Actuators with states of their own in the naive model, and how many each has."""
    return tuple((i, int(model.actuator_actnum[i])) for i in range(model.nu) if model.actuator_actnum[i])


def _module(folder: Path) -> Any:
    """The exported callback, or the player without laws, as a module of its own."""
    path = folder / CALLBACK if (folder / CALLBACK).exists() else Path(runtime_template.__file__)
    spec = importlib.util.spec_from_file_location("improved", path)
    assert spec is not None and spec.loader is not None  # of a Python file
    module = importlib.util.module_from_spec(spec)
    # Its dataclasses look for their names there; and no cache is left among the results.
    with patch.dict(sys.modules, improved=module), patch.object(sys, "dont_write_bytecode", True):
        spec.loader.exec_module(module)
    return module
