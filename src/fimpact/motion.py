"""From what was measured, or predicted, back to how the robot stood: what a film of a diagnosis shows."""

from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.mismatch.diagnose import Diagnosis
from fimpact.mismatch.explain import Explanation
from fimpact.mismatch.starts import place_of
from fimpact.mismatch.windows import Windows
from fimpact.scene import Scene, moves, pivots

WINDOWS = 4  # consecutive ones that are shown in one go
UPRIGHT = 0.2  # share of the largest travel from which on a vertical one is looked at
NO_CONTACTS = np.zeros((0, 2, 2))


@dataclass(frozen=True)
class Stretch:
    """Part of a held-out run: its number, the window it starts with, its first sample and how many."""

    run: int
    window: int
    first: int
    samples: int


def undrawable(model: mujoco.MjModel, channels: tuple[str, ...]) -> str:
    """Why measurements on these channels cannot be drawn as a motion, in one sentence; empty where they can."""
    flat = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    if not any(moves(model, g) and model.geom_type[g] not in map(int, flat) for g in range(model.ngeom)):
        return "No film: the model has no geom that moves."
    seen = {index for index, _ in _shown(model, channels)}
    hidden = [model.joint(j).name or f"number {j}" for j in range(model.njnt) if not _addresses(model, j) <= seen]
    return f"No film: how {', '.join(hidden)} stood was not measured." if hidden else ""


def _addresses(model: mujoco.MjModel, joint: int) -> set[int]:
    last = model.nq if joint + 1 == model.njnt else int(model.jnt_qposadr[joint + 1])
    return set(range(int(model.jnt_qposadr[joint]), last))


def _shown(model: mujoco.MjModel, channels: tuple[str, ...]) -> list[tuple[int, int]]:
    """Numbers of qpos that a channel shows, each with the channel's."""
    found = []
    for column, channel in enumerate(channels):
        name, _, part = channel.removesuffix("]").partition("[")
        place = place_of(model, model.sensor(name), int(part or 0))
        if place and place[0] != "speed":
            found.append((int(place[1]), column))
    return found


def configurations(model: mujoco.MjModel, channels: tuple[str, ...], readings: np.ndarray) -> np.ndarray:
    """qpos (T, nq) that `readings` (T, ny) show, missing ones interpolated."""
    qpos = np.tile(model.qpos0, (len(readings), 1))
    for index, column in _shown(model, channels):
        qpos[:, index] = _filled(readings[:, column])
    for row in qpos:
        mujoco.mj_normalizeQuat(model, row)
    return qpos


def _filled(values: np.ndarray) -> np.ndarray:
    # What diverges stays where it was last seen.
    good = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), good, values[good]) if len(good) else np.zeros(len(values))


def stretch(diagnosis: Diagnosis, run: int) -> Stretch:
    """The part of a held-out run in which the naive model errs most: a few windows, or all of a short run."""
    windows = diagnosis.bench.held_out.windows
    own = np.flatnonzero(windows.runs == run)
    own = own[np.argsort(windows.first[own])]
    errors, many = diagnosis.naming.naive.judged.point.squares[own], min(WINDOWS, len(own))
    start = int(np.argmax(np.convolve(errors, np.ones(many), "valid")))
    first, whole = int(windows.first[own[start]]), len(diagnosis.recording.held_out[run].measured)
    return Stretch(run, int(own[start]), first, min(many * windows.length, whole - first))


def readings_of(diagnosis: Diagnosis, explanation: Explanation, part: Stretch) -> np.ndarray:
    """What a model predicts of a stretch in one go from the state fitted to its first window, (T, ny)."""
    windows, point = diagnosis.bench.held_out.windows, explanation.judged.point
    blank = np.full((1, part.samples, windows.measured.shape[2]), np.nan)
    begun = windows.part(np.array([part.window])).turned
    long = Windows(np.array([part.run]), np.array([part.first]), blank, windows.ctrl, windows.names, turned=begun)
    start = point.qpos[[part.window]], point.qvel[[part.window]]
    return diagnosis.bench.held_out.simulator.predict(point.hypothesis, long, *start)[0]


def scene_of(model: mujoco.MjModel, qpos: np.ndarray, time: np.ndarray, axes: tuple[int, int] | None = None) -> Scene:
    """The model in configurations (T, nq) at `time` (T,); axes: of the picture, None: those in which it moves most."""
    data, places, turns = mujoco.MjData(model), [], []
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        places.append(data.geom_xpos.copy())
        turns.append(data.geom_xmat.reshape(-1, 3, 3).copy())
    axes = axes or _plane(model, np.array(places))
    nothing = (NO_CONTACTS,) * len(qpos)
    poses = np.array(places), np.array(turns)
    return Scene(model, axes, time, *poses, nothing, np.zeros((len(qpos), 1)), pivots(model, data, axes))


def _plane(model: mujoco.MjModel, places: np.ndarray) -> tuple[int, int]:
    moving = [g for g in range(model.ngeom) if moves(model, g)]
    travel = np.ptp(places[:, moving], axis=0).max(0)
    level = int(np.argmax(travel[:2]))
    if model.opt.gravity.any() and travel[2] >= UPRIGHT * travel.max():
        return level, 2
    first, second = sorted(np.argsort(-travel, kind="stable")[:2].tolist())
    return first, second
