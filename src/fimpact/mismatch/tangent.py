"""Tangent: a motion linearised step by step, so that what any small force does to it is a product of matrices.

Beside a hundred force laws that are screened, one simulation each would ask the same steps a hundred times:
x_{k+1} = A_k x_k + B_k f_k, y_k = C_k x_k + D_k f_k.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from mujoco import MjModel

from fimpact.effects.base import Placed, State
from fimpact.mismatch.problem import NUDGE, Point, Problem
from fimpact.mismatch.simulate import DIVERGED, Simulator


@dataclass(frozen=True)
class Tangent:
    """A (n, w, 2 nv, 2 nv), B (n, w, 2 nv, nv), C (n, w, ny, 2 nv) and D (n, w, ny, nv) of each of n simulation steps,
    and what a force law sees in them; every: steps from one sample to the next."""

    move: np.ndarray
    push: np.ndarray
    show: np.ndarray
    feel: np.ndarray
    passed: list[State]
    every: int

    @DIVERGED
    def response(self, forces: np.ndarray) -> np.ndarray:
        """Change of the measurements, (w, T, ny, c), by each of c generalised forces, (w, n, nv, c), N or N m."""
        off, out = np.zeros((*self.move.shape[1:3], forces.shape[3])), []
        for k, own in enumerate(forces.swapaxes(0, 1)):
            if k % self.every == 0:
                out.append(self.show[k] @ off + self.feel[k] @ own)
            off = self.move[k] @ off + self.push[k] @ own
        return np.stack(out, 1)

    def force(self, placed: Placed) -> np.ndarray:
        """Generalised force, (w, n, nv), of a law on the way without it: asked of all steps at once, or, where it
        remembers, of one after the other."""
        everywhere = replace(self.everywhere, memory={})
        begun = dict(self.passed[0].memory)
        force = placed.effect.law(everywhere, placed.site, **placed.values)
        if everywhere.remembers:
            steps = (replace(state, memory=begun) for state in self.passed)
            force = np.concatenate([placed.effect.law(state, placed.site, **placed.values) for state in steps])
        return force.reshape(len(self.passed), -1, force.shape[1]).swapaxes(0, 1)

    @cached_property
    def everywhere(self) -> State:
        """All steps as one, the first of all windows first."""
        parts = {n: np.concatenate([getattr(s, n) for s in self.passed]) for n in ("qpos", "qvel", "ctrl", "time")}
        return replace(self.passed[0], **parts, bodies={})


def has_tangent(simulator: Simulator, point: Point) -> bool:
    """Whether the state is positions and speeds, as many of the one as of the other, and no law depends on it."""
    alone = all(placed.effect.enters in ("model", "command") for placed in point.hypothesis.placed)
    return alone and simulator.base.nq == simulator.base.nv and not simulator.base.na


def tangent(problem: Problem, point: Point) -> Tangent:
    """The motion of the problem's windows at `point`."""
    simulator, nv = problem.simulator, problem.simulator.base.nv
    passed, *states = simulator.passed(point.hypothesis, problem.windows, point.qpos, point.qvel)
    model = passed[0].model
    pushed = np.concatenate([np.concatenate([s.ctrl, np.zeros_like(s.qvel)], 1) for s in passed])
    where = np.concatenate([*(part.swapaxes(0, 1).reshape(-1, nv) for part in states), pushed], 1)
    # A force that changes a speed as much in one step as a nudge of the speed does.
    force = NUDGE * model.dof_M0 / model.opt.timestep
    base, columns = _step(simulator, model, where), []
    for column, size in zip([*range(2 * nv), *range(-nv, 0)], np.append(np.full(2 * nv, NUDGE), force), strict=True):
        moved = where.copy()
        moved[:, column] += size
        columns.append((_step(simulator, model, moved) - base) / size)
    slopes = np.stack(columns, 2).reshape(len(passed), -1, base.shape[1], 3 * nv)
    parts = slopes[:, :, : 2 * nv], slopes[:, :, 2 * nv :][:, :, simulator.columns]
    return Tangent(*(p for part in parts for p in np.split(part, [2 * nv], 3)), passed, simulator.substeps)


def _step(simulator: Simulator, model: MjModel, where: np.ndarray) -> np.ndarray:
    """States after one step from each row of states, commands and forces, and all sensors before it."""
    return simulator.step(model, *np.split(where, [model.nv, 2 * model.nv], 1))
