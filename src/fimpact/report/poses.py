"""From what was measured, or predicted, back to how the robot stood: what a film of a diagnosis shows."""

import mujoco
import numpy as np

from fimpact.report.plotting.scene import Scene, moves, pivots
from fimpact.simulation.state_guess import shown_by

UPRIGHT = 0.2  # share of the largest travel from which on a vertical one is looked at
NO_CONTACTS = np.zeros((0, 2, 2))


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
    found = [(shown_by(model, channel), column) for column, channel in enumerate(channels)]
    kept = [(own, column) for own, column in found if own and own.kind != "speed"]
    return [(own.qpos + own.part * (own.kind == "quaternion"), column) for own, column in kept]


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
