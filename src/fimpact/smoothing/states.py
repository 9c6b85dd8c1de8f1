"""Coordinates of a simulation's state: positions with quaternions, and the tangent space of their estimates."""

from dataclasses import dataclass

import mujoco
import numpy as np

FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
TINY = 1e-12  # rad: a rotation below which its quaternion is linear


@dataclass(frozen=True)
class States:
    """N states: qpos (N, nq), qvel (N, nv), act (N, na) of actuators and behind them of rotors (`rotor_states`)."""

    qpos: np.ndarray
    qvel: np.ndarray
    act: np.ndarray

    def __len__(self) -> int:
        return len(self.qpos)

    @property
    def size(self) -> int:
        """Coordinates of each."""
        return 2 * self.qvel.shape[1] + self.act.shape[1]

    def __getitem__(self, rows) -> "States":
        return States(self.qpos[rows], self.qvel[rows], self.act[rows])


@dataclass(frozen=True)
class Tangent:
    """The tangent space of the states of a model: turns of a body in its own axes."""

    plain: tuple[np.ndarray, np.ndarray]  # indices of qpos and of its tangent that are numbers of their own
    turns: tuple[tuple[int, int], ...]  # first index of each quaternion and of its tangent
    nv: int

    def plus(self, states: States, step: np.ndarray) -> States:
        """The states a `step` (N, n) further."""
        nv, qpos = self.nv, states.qpos.copy()
        rows, columns = self.plain
        qpos[:, rows] += step[:, columns]
        for q, v in self.turns:
            qpos[:, q : q + 4] = _times(qpos[:, q : q + 4], _exponential(step[:, v : v + 3]))
        return States(qpos, states.qvel + step[:, nv : 2 * nv], states.act + step[:, 2 * nv :])

    def minus(self, end: States, start: States) -> np.ndarray:
        """The step (N, n) from `start` to `end`."""
        position = np.empty((len(end), self.nv))
        rows, columns = self.plain
        position[:, columns] = end.qpos[:, rows] - start.qpos[:, rows]
        for q, v in self.turns:
            back = start.qpos[:, q : q + 4] * np.array([1.0, -1.0, -1.0, -1.0])
            position[:, v : v + 3] = _logarithm(_times(back, end.qpos[:, q : q + 4]))
        return np.concatenate([position, end.qvel - start.qvel, end.act - start.act], 1)


def tangent(model: mujoco.MjModel) -> Tangent:
    """The tangent space of the states of `model`."""
    rows: list[int] = []
    columns: list[int] = []
    turns = []
    for joint in range(model.njnt):
        q, v, kind = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint]), int(model.jnt_type[joint])
        plain = {FREE: 3, BALL: 0}.get(kind, 1)
        rows += range(q, q + plain)
        columns += range(v, v + plain)
        if kind in (FREE, BALL):
            turns.append((q + plain, v + plain))
    return Tangent((np.array(rows, int), np.array(columns, int)), tuple(turns), model.nv)


def _times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    (w, x, y, z), (v, i, j, k) = a.T, b.T
    return np.stack(
        [
            w * v - x * i - y * j - z * k,
            w * i + x * v + y * k - z * j,
            w * j - x * k + y * v + z * i,
            w * k + x * j - y * i + z * v,
        ],
        1,
    )


def _exponential(turn: np.ndarray) -> np.ndarray:
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    share = np.where(angle > TINY, np.sin(angle / 2) / np.maximum(angle, TINY), 0.5)
    return np.concatenate([np.cos(angle / 2), share * turn], 1)


def _logarithm(quaternion: np.ndarray) -> np.ndarray:
    quaternion = np.where(quaternion[:, :1] < 0, -quaternion, quaternion)
    size = np.linalg.norm(quaternion[:, 1:], axis=1, keepdims=True)
    angle = 2 * np.arctan2(size, quaternion[:, :1])
    return np.where(size > TINY, angle / np.maximum(size, TINY), 2.0) * quaternion[:, 1:]
