"""The model around a trajectory: what each coordinate, force and parameter does to the next sample and the readings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from fimpact.effects.base import Placed
from fimpact.effects.sites import ON_JOINT
from fimpact.smoothing.parameters import Parameter, placed_of, theta_of
from fimpact.smoothing.states import States
from fimpact.smoothing.track import Plant, Step, Track

NUDGE = 1e-6  # rad, m and their rates: step of a difference quotient of the state
WIDE = 10.0  # times what a run shows: prior sd of a first state of which nothing is known


@dataclass(frozen=True)
class Linear:
    """The model around a trajectory: m = n + nv coordinates and forces, p parameters.

    advance: (N, n, m) of the next state. reads: (N, ny, m) of the readings. offsets: (N, n, 1 + p) and left: (N, ny, 1
    + p): defects and what is left of the readings, and what the parameters do to both. first, spread: (runs, n) from
    each run's first state to its prior, and the prior's sd. base: the sample ahead of each state.
    """

    plant: Plant
    base: Step
    advance: np.ndarray
    reads: np.ndarray
    offsets: np.ndarray
    left: np.ndarray
    first: np.ndarray
    spread: np.ndarray
    rubbed: np.ndarray


def linearise(
    track: Track,
    numbers: Sequence[Parameter],
    placed: Sequence[Placed],
    states: States,
    tau: np.ndarray,
    doubt,
    theta=None,
) -> Linear:
    """Linearise every sample: one simulation of all of them for each coordinate, force and parameter."""
    placed = placed_of(numbers, placed)
    theta = theta_of(numbers) if theta is None else theta
    plant = track.plant(placed, theta, states, tau, doubt)
    base, plain = plant.step(states, tau), plant.plain
    near = plain.step(states, tau)
    n, nv, space = track.space.size, track.model.nv, track.space
    advance, reads = np.empty((track.count, n, n + nv)), np.empty((track.count, base.readings.shape[1], n + nv))
    for j in range(n + nv):
        step, push, size = np.zeros((track.count, n)), tau, NUDGE
        if j < n:
            step[:, j] = size
        else:
            size = 1e-4 * max(float(track.model.dof_M0[j - n]), 1e-9) / track.period
            push = tau + size * np.eye(nv)[j - n]
        found = plain.step(space.plus(states, step), push)
        advance[:, :, j] = space.minus(found.after, near.after) / size
        reads[:, :, j] = (found.readings - near.readings) / size
    offsets = [space.minus(base.after, track.next(states))]
    left = [np.nan_to_num(track.measured - base.readings)]
    for index, number in enumerate(numbers):
        end = moved(track, numbers, placed, index, states, tau, doubt, plant.model)
        offsets.append(space.minus(end.after, near.after) / number.nudge)
        left.append((near.readings - end.readings) / number.nudge)
    first, spread = _starts(track, states)
    rubbed, advance, reads = _rubbed(plant, advance, reads)
    return Linear(plant, base, advance, reads, rubbed @ np.stack(offsets, 2), np.stack(left, 2), first, spread, rubbed)


def _rubbed(plant: Plant, advance: np.ndarray, reads: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What dry friction does to whatever moves the next state, (N, n, n), and `advance` and `reads` with it.

    It follows the speed half a sample later, (v + v') / 2, which is implicit.
    """
    n = advance.shape[1]
    nv = advance.shape[2] - n
    half = advance[:, :, n:] * plant.slope[:, None] / 2
    rubbed = np.tile(np.eye(n), (len(advance), 1, 1))
    rubbed[:, :, nv : 2 * nv] -= half
    rubbed, advance, reads = np.linalg.inv(rubbed), advance.copy(), reads.copy()
    advance[:, :, nv : 2 * nv] += half
    reads[:, :, nv : 2 * nv] += reads[:, :, n:] * plant.slope[:, None]
    return rubbed, rubbed @ advance, reads


def renewed(linear: Linear, track: Track, numbers, placed, states: States, tau: np.ndarray, doubt, theta) -> Linear:
    """The model around a trajectory near that of `linear`, whose derivatives still hold: one simulation."""
    plant = track.plant(placed_of(numbers, placed), theta, states, tau, doubt)
    base = plant.step(states, tau)
    offsets, left = linear.offsets.copy(), linear.left.copy()
    offsets[:, :, 0] = (linear.rubbed @ track.space.minus(base.after, track.next(states))[:, :, None])[:, :, 0]
    left[:, :, 0] = np.nan_to_num(track.measured - base.readings)
    first, spread = _starts(track, states)
    return replace(linear, plant=plant, base=base, offsets=offsets, left=left, first=first, spread=spread)


def moved(track: Track, numbers, placed, index: int, states: States, tau, doubt, around: mujoco.MjModel) -> Step:
    """The samples ahead with one of the numbers a nudge further."""
    number = numbers[index]
    value = number.value * np.exp(number.nudge) if number.log else number.value + number.nudge
    changed = [replace(n, value=value) if i == index else n for i, n in enumerate(numbers)]
    plant = track.plant(placed_of(changed, placed), theta_of(changed), states, tau, doubt).plain
    return plant.step(states, tau * heavier(plant.model, around))


def heavier(after: mujoco.MjModel, before: mujoco.MjModel) -> np.ndarray:
    """By how much the inertia that each degree of freedom feels has grown, (nv,); 1 where a motor is.

    Where nothing applied is known, forces are known up to their scale only, and least squares of them has the solution
    that nothing weighs anything. There the missing force grows with the inertia: its acceleration is held.
    """
    grown = before.dof_invweight0 / np.maximum(after.dof_invweight0, 1e-300)
    return np.where(driven(before), 1.0, grown)


def driven(model: mujoco.MjModel) -> np.ndarray:
    """Whether a motor acts on each degree of freedom, (nv,)."""
    out = np.zeros(model.nv, bool)
    for motor in range(model.nu):
        if model.actuator_trntype[motor] != ON_JOINT:
            return np.ones(model.nv, bool)
        out |= model.dof_jntid == model.actuator_trnid[motor, 0]
    return out


def _starts(track: Track, states: States) -> tuple[np.ndarray, np.ndarray]:
    """From each run's first state to what is believed of it, and how far that is to be believed, (runs, n) each."""
    nv, rows = track.model.nv, track.bounds[:-1]
    qvel = np.sqrt(np.mean(states.qvel**2, 0)) + 1e-3
    wide = WIDE * np.concatenate([qvel * track.period * 10 + 1e-3, qvel, np.ones(track.space.na)])
    first, spread = np.zeros((len(rows), track.space.size)), np.tile(wide, (len(rows), 1))
    known = np.isfinite(track.recording.start_sd)
    for i, run in enumerate(track.runs):
        if run.qpos is not None and run.opens and known.any():
            own = states[rows[i] : rows[i] + 1]
            believed = States(run.qpos[None], run.qvel[None], own.act)
            first[i, : 2 * nv][known] = track.space.minus(believed, own)[0, : 2 * nv][known]
            spread[i, : 2 * nv][known] = track.recording.start_sd[known]
    return first, spread
