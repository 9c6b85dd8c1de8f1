"""How a robot moved, as its measured positions show it: positions, speeds and accelerations of all joints."""

from dataclasses import dataclass
from functools import cache
from math import factorial

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline

from fimpact.cases import enums
from fimpact.cases.resampling import GAP

SMOOTHERS = (7, 15, 45)  # samples of the local parabola; that in which the law agrees best counts


def derivative(values: np.ndarray, period: float, order: int, width: int = 9) -> np.ndarray:
    """Derivative (T,) by a local parabola; NaN at the ends and beside missing samples."""
    out = np.full(len(values), np.nan)
    if len(values) >= width:
        kernel = _kernel(width, order) / period**order
        out[width // 2 : len(values) - width // 2] = np.convolve(values, kernel, "valid")
    return out


@cache
def _kernel(width: int, order: int) -> np.ndarray:
    # Savitzky and Golay's, as scipy.signal has it, which takes half a second to import: every check would wait for it.
    powers = np.vander(np.arange(width) - width // 2, 3, increasing=True).astype(float)
    return factorial(order) * np.linalg.pinv(powers)[order, ::-1]


def filled(values: np.ndarray) -> np.ndarray:
    """A column (T,) with cubics between the samples of a slower sensor; longer gaps stay NaN."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 4 or len(known) == len(values):
        return values
    steps = np.diff(known)
    out = np.full(len(values), np.nan)
    inside = np.arange(known[0], known[-1] + 1)
    out[inside] = CubicSpline(known, values[known])(inside)
    for gap in np.flatnonzero(steps > GAP * np.median(steps)):
        out[known[gap] + 1 : known[gap + 1]] = np.nan
    return out


@dataclass(frozen=True)
class Motion:
    """States of one run on its grid: (T, nq), (T, nv), (T, nv), NaN where they are not known.

    joints: those whose position is measured. unplaced: free joints of which only the orientation is.
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    joints: frozenset[str]
    unplaced: frozenset[str] = frozenset()


def moved(model: mujoco.MjModel, columns: dict[str, list[int]], measured: np.ndarray, period: float, width: int):
    """The motion that `measured` (T, ny) shows, through parabolas of `width` samples.

    Args:
        columns: of each joint: 1, 7 (position and orientation of a free one) or 4 (its orientation alone).
    """
    count = len(measured)
    q = np.tile(model.qpos0, (count, 1))
    v, a = np.zeros((count, model.nv)), np.zeros((count, model.nv))
    for joint, place in columns.items():
        at, dof = model.joint(joint).qposadr[0], model.joint(joint).dofadr[0]
        straight, turning = (place, []) if len(place) == 1 else (place[:-4], place[-4:])
        for i, column in enumerate(straight):
            values = filled(measured[:, column])
            q[:, at + i] = derivative(values, period, 0, width)
            v[:, dof + i], a[:, dof + i] = (derivative(values, period, order, width) for order in (1, 2))
        if turning:
            turned = turns(measured[:, turning], period, width)
            q[:, at + 3 : at + 7], v[:, dof + 3 : dof + 6], a[:, dof + 3 : dof + 6] = turned
    unplaced = frozenset(joint for joint, place in columns.items() if len(place) == 4)
    return Motion(q, v, a, frozenset(columns), unplaced)


def turns(quats: np.ndarray, period: float, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Orientation (T, 4), rate (T, 3) and its derivative (T, 3) about a body's own axes, of quaternions without jumps
    of sign."""
    full = np.column_stack([filled(column) for column in quats.T])
    smooth, rate, second = (
        np.column_stack([derivative(c, period, order, width) for c in full.T]) for order in (0, 1, 2)
    )
    length = np.linalg.norm(smooth, axis=1, keepdims=True)
    # rate of q: half q times (0, w); of that, as |q| is 1, half q times (0, w') less |w|^2 q / 4
    return smooth / length, 2 * _relative(smooth, rate) / length**2, 2 * _relative(smooth, second) / length**2


def _relative(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Vector part (n, 3) of the product of the conjugate of quaternions (n, 4) with others."""
    w, u, x, v = one[:, :1], one[:, 1:], other[:, :1], other[:, 1:]
    return w * v - x * u - np.cross(u, v)


def position_sources(model: mujoco.MjModel, columns: dict[str, list[int]], turned: dict[int, list[int]]):
    """`columns` of joints, and those of the orientation of free joints whose position is not measured.

    Args:
        turned: body -> the four columns of its orientation.
    """
    out = dict(columns)
    for joint in np.flatnonzero(model.jnt_type == enums.FREE):
        name, body = model.joint(joint).name, int(model.jnt_bodyid[joint])
        if name not in out and body in turned:
            out[name] = turned[body]
    return out
