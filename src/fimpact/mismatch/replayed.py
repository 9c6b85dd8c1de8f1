"""Replay: exported files in plain MuJoCo in the place of our simulator, and what they leave of the held-out windows."""

import copy
from pathlib import Path

import numpy as np

from fimpact.mismatch.coordinates import NOTHING
from fimpact.mismatch.diagnose import Diagnosis
from fimpact.mismatch.export import XML, player_of
from fimpact.mismatch.settle import settled
from fimpact.mismatch.simulate import Hypothesis
from fimpact.mismatch.windows import Windows


class Replay:
    """Predicts as a `Simulator` does, but whatever the hypothesis by the files in `folder`."""

    def __init__(self, diagnosis: Diagnosis, folder: Path):
        self.scene = player_of(diagnosis, folder)
        self.model = self.scene.load(folder / XML)
        self.base = diagnosis.bench.held_out.simulator.base

    def predict(self, hypothesis: Hypothesis, windows: Windows, qpos, qvel, push=None) -> np.ndarray:
        """Measurements, (w, T, ny), from states qpos (w, nq), qvel (w, nv) at the start of each window."""
        known = [None] * len(qpos) if windows.turned is None else windows.turned
        states = zip(windows.runs, qpos, qvel, windows.first.tolist(), known, strict=True)
        play, length = self.scene.simulate, windows.length
        return np.array([play(self.model, windows.ctrl[run], q, v, at, length, told) for run, q, v, at, told in states])


def replayed(diagnosis: Diagnosis, folder: Path, profiled: bool = False) -> np.ndarray:
    """What the files in `folder` leave of every held-out window, (w, T, ny), in standard deviations, replayed from the
    initial states fitted to the improved simulation or, if `profiled`, to their own."""
    problem, judged = copy.copy(diagnosis.bench.held_out), diagnosis.naming.best.judged.point
    problem.simulator, problem.offset = Replay(diagnosis, folder), np.zeros_like(problem.offset)
    point = problem.evaluate(judged.hypothesis, judged.qpos, judged.qvel, NOTHING)
    point = settled(problem, NOTHING, point) if profiled else point
    shape = problem.windows.measured.shape
    return point.residual[:, : shape[1] * shape[2]].reshape(shape)
