"""The whitened least-squares problem that a hypothesis poses on windows with free initial states.

Notation: residual r, sensitivities J to the coordinates that are fitted, X to the initial states of a
window. X is projected off window by window (QR), which leaves a small problem in the coordinates.
"""

import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from fimpact.mismatch.coordinates import Coordinates
from fimpact.mismatch.simulate import DIVERGED, Hypothesis, Simulator
from fimpact.mismatch.steady import Slope, together
from fimpact.mismatch.touch import can_touch
from fimpact.mismatch.windows import Windows

if TYPE_CHECKING:
    from fimpact.mismatch.colour import Colour

NUDGE = 1e-5  # m, rad and their rates: the same for an initial state
HIDDEN = 1e-6  # sensitivity to a state, of the largest to one of its kind, that is the secant's own: of second order
TOGETHER, ROOM = 256, 1 << 28  # windows that are simulated at once, and bytes, for each may need a model of its own
APART = "friction"  # laws that ask so little of each step that models of their own for more windows cost more
WEAK = 1e-6  # prior weight of an initial state that nobody knows; only there to keep R invertible


@dataclass(frozen=True)
class Point:
    """A hypothesis with initial states: qpos (w, nq), qvel (w, nv), residual (w, m) and half its square plus prior."""

    hypothesis: Hypothesis
    qpos: np.ndarray
    qvel: np.ndarray
    residual: np.ndarray
    cost: float

    @property
    @DIVERGED
    def squares(self) -> np.ndarray:
        """Sum of squared whitened residuals of each window, (w,)."""
        return (self.residual**2).sum(1)

    @property
    def samples(self) -> np.ndarray:
        """Numbers that are compared in each window, at least 1, (w,)."""
        return np.maximum((self.residual != 0).sum(1), 1)


@dataclass(frozen=True)
class Linear:
    """The problem linearised: orthonormal basis Q (w, m, nx) and R of X; J (w, m, k) raw and `projected` off Q.

    colour: what disturbances make of the noise, None: it is white.
    """

    basis: np.ndarray
    triangle: np.ndarray
    raw: np.ndarray
    projected: np.ndarray
    colour: "Colour | None" = None

    def off(self, columns: np.ndarray) -> np.ndarray:
        """`columns`, (w, m) or (w, m, c), with what initial states imitate taken out, and in units of the noise."""
        flat = columns if columns.ndim == 3 else columns[..., None]
        flat = self.colour.white(flat) if self.colour else flat
        left = flat - self.basis @ (self.basis.transpose(0, 2, 1) @ flat)
        return left if columns.ndim == 3 else left[..., 0]

    def and_of(self, columns: np.ndarray) -> "Linear":
        """With further coordinates, whose sensitivities are `columns`, (w, m, c)."""
        raw = np.concatenate([self.raw, columns], 2)
        return replace(self, raw=raw, projected=self.off(raw))

    def alone(self, first: int = 0) -> "Linear":
        """The initial states and the `first` coordinates only."""
        return replace(self, raw=self.raw[:, :, :first], projected=self.projected[:, :, :first])


class Problem:
    """Windows of a recording under a simulator; `noise` (ny,) or (w, T, ny), and what numerics add to predictions;
    `start_sd` (w, 2 nv): prior standard deviation of the states `starts`, inf: none."""

    def __init__(self, simulator: Simulator, windows: Windows, noise: np.ndarray, starts: tuple, start_sd: np.ndarray):
        self.simulator, self.windows = simulator, windows
        self.noise = np.broadcast_to(noise, windows.measured.shape)
        self.offset, self.bend = np.zeros_like(windows.measured), None
        self.starts = starts
        self.start_weight = np.where(np.isfinite(start_sd), 1 / np.where(start_sd > 0, start_sd, 1.0), WEAK)

    def part(self, rows: np.ndarray) -> "Problem":
        """The problem of some windows only: `rows`, a mask (w,) or indices."""
        out = copy.copy(self)
        out.windows, out.starts = self.windows.part(rows), tuple(states[rows] for states in self.starts)
        out.noise, out.offset, out.start_weight = self.noise[rows], self.offset[rows], self.start_weight[rows]
        return out

    def louder(self, by: np.ndarray) -> "Problem":
        """The same problem with the noise of each window multiplied by `by`, (w,)."""
        out = copy.copy(self)
        out.noise = self.noise * by[:, None, None]
        return out

    def whiten(self, measured: np.ndarray) -> np.ndarray:
        """Measurements or their differences (w, T, ny) in standard deviations, (w, T * ny); missing ones are 0."""
        scaled = np.where(np.isfinite(self.windows.measured), measured / self.noise, 0.0)
        return scaled.reshape(len(scaled), -1)

    def predict(self, hypothesis: Hypothesis, qpos, qvel, push=None) -> np.ndarray:
        """Whitened prediction, (w, T * ny), numerical offset included."""
        return self.whiten(self.simulator.predict(hypothesis, self.windows, qpos, qvel, push) + self.offset)

    @DIVERGED
    def evaluate(self, hypothesis: Hypothesis, qpos, qvel, coordinates: Coordinates) -> Point:
        """Residual and cost of a hypothesis with initial states; infinite cost where the simulation diverges."""
        error = self.whiten(self.windows.measured) - self.predict(hypothesis, qpos, qvel)
        moved = difference(self.simulator.base, *self.starts, qpos, qvel)
        residual = np.concatenate([error, -moved * self.start_weight], 1)
        pull = (coordinates.read(hypothesis) - coordinates.mean) / coordinates.sd
        cost = ((residual**2).sum() + (pull**2).sum()) / 2
        return Point(hypothesis, qpos, qvel, residual, float(cost) if np.isfinite(cost) else np.inf)

    def linearise(self, point: Point, coordinates: Coordinates) -> Linear:
        """Secants around `point` in initial states and coordinates."""
        base = self.predict(point.hypothesis, point.qpos, point.qvel)
        basis, triangle = self.starts_at(point, base)
        nothing = self.extend(np.zeros((*base.shape, 0)))
        linear = Linear(basis, triangle, nothing, nothing)
        return linear.and_of(self.columns(point, coordinates, range(len(coordinates.scale)), base, linear))

    def columns(self, point: Point, coordinates: Coordinates, which, base: np.ndarray, known: Linear) -> np.ndarray:
        """Secant sensitivity of the prediction, `base` at `point`, to the coordinates `which`, (w, m, c), beside those
        that are `known`."""
        slopes = [self._slope(point, coordinates, i, base) for i in which]
        found = [slope(1.0, np.arange(len(base))) for slope in slopes]
        if found and can_touch(self.simulator.base):
            found = together(known.off, known.projected, found, slopes)
        return np.stack(found, 2) if found else self.extend(np.zeros((*base.shape, 0)))

    def _slope(self, point: Point, coordinates: Coordinates, i: int, base: np.ndarray) -> Slope:
        """A secant in coordinate `i`, so many times its step long, in some windows."""
        z, step = coordinates.read(point.hypothesis), coordinates.step[i]
        step = -step if z[i] + step > coordinates.high[i] else step

        def slope(share: float, rows: np.ndarray) -> np.ndarray:
            moved = coordinates.write(point.hypothesis, z + share * step * (np.arange(len(z)) == i))
            part = self.part(rows)
            change = (part.predict(moved, point.qpos[rows], point.qvel[rows]) - base[rows]) / (share * step)
            # A window in which the secant diverges says nothing of the coordinate.
            change[~np.isfinite(change).all(1)] = 0.0
            return part.extend(change[..., None])[..., 0]

        return slope

    def extend(self, columns: np.ndarray) -> np.ndarray:
        """`columns`, (w, T * ny, c), with the zero rows of the initial states' prior added: (w, m, c)."""
        rows = np.zeros((len(columns), self.start_weight.shape[1], columns.shape[2]))
        return np.concatenate([columns, rows], 1)

    def starts_at(self, point: Point, base: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Q (w, m, nx) and R (w, nx, nx) of the secants in initial states; `base`: the prediction, where known."""
        base = self.predict(point.hypothesis, point.qpos, point.qvel) if base is None else base
        moves = NUDGE * np.eye(2 * self.simulator.base.nv)
        # A law is asked once for all windows: the more at once, the better.
        most = np.clip(ROOM // self.simulator.base.nbuffer, 1, TOGETHER)
        most = 1 if any(p.effect.enters == APART for p in point.hypothesis.placed) else most
        parts = np.array_split(moves, np.clip(-(-len(moves) * len(base) // most), 1, len(moves)))
        columns = np.concatenate([self._moved(point, part, base) for part in parts]) / NUDGE
        prior = self.start_weight[:, :, None] * np.eye(len(moves))
        return np.linalg.qr(np.concatenate([shown(np.moveaxis(columns, 0, 2)), prior], 1))

    def _moved(self, point: Point, moves: np.ndarray, base: np.ndarray) -> np.ndarray:
        """How the prediction changes, (k, w, T * ny), where all windows begin elsewhere, `moves` (k, 2 nv)."""
        rows = np.tile(np.arange(len(base)), len(moves))
        states = shift(self.simulator.base, point.qpos[rows], point.qvel[rows], np.repeat(moves, len(base), 0))
        return self.part(rows).predict(point.hypothesis, *states).reshape(len(moves), *base.shape) - base


def shown(columns: np.ndarray) -> np.ndarray:
    """Sensitivities to initial states, (w, T * ny, 2 nv), without those that are none: a motion that nothing measures
    would be taken as far as it has to go to show."""
    kinds = np.split(np.linalg.norm(columns, axis=1), 2, 1)
    return columns * np.concatenate([size > HIDDEN * size.max(1, keepdims=True) for size in kinds], 1)[:, None]


def shift(model: mujoco.MjModel, qpos, qvel, delta) -> tuple[np.ndarray, np.ndarray]:
    """States moved by `delta`, (w, 2 nv), in the tangent space of the configuration."""
    moved = qpos.copy()
    for row, step in zip(moved, np.ascontiguousarray(delta[:, : model.nv]), strict=True):
        mujoco.mj_integratePos(model, row, step, 1.0)
    return moved, qvel + delta[:, model.nv :]


def difference(model: mujoco.MjModel, qpos0, qvel0, qpos, qvel) -> np.ndarray:
    """From one state to another, (w, 2 nv), in the tangent space of the configuration."""
    out = np.empty((len(qpos), model.nv))
    for row, before, after in zip(out, qpos0, qpos, strict=True):
        mujoco.mj_differentiatePos(model, row, 1.0, before, after)
    return np.concatenate([out, qvel - qvel0], 1)
