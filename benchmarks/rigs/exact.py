"""Simulation of the truth: small steps, and dry friction that follows its exact law, at rest as well.

`simulate` is MuJoCo with dry friction as sharp as the step; `integrate` is an integration of our own, with friction as
an impulse that stops a joint if it can. `difference` says how far the two are apart.
"""

from collections.abc import Callable
from copy import copy

import mujoco
import numpy as np

STEP = 1e-4  # s, of the truth
SHARP = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp of dry friction that gives way to nothing
SWEEPS = 40  # of Gauss-Seidel, over the joints' friction impulses
Control = Callable[[int, np.ndarray, np.ndarray], np.ndarray]  # (sample, qpos, qvel) -> ctrl (nu,)


def make_exact(model: mujoco.MjModel, friction: dict[str, float], step: float = STEP) -> None:
    """Give joints of `model` dry friction (N or N m), and small steps without damping of their own."""
    model.opt.timestep, model.opt.integrator = step, mujoco.mjtIntegrator.mjINT_RK4
    for name, level in friction.items():
        dof = model.joint(name).dofadr[0]
        model.dof_frictionloss[dof], model.dof_solref[dof], model.dof_solimp[dof] = level, (2 * step, 1.0), SHARP


def simulate(
    model: mujoco.MjModel, qpos: np.ndarray, control: Control, period: float, samples: int, settle: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """States (samples, nq + nv) and commands (samples, nu), each held for a `period` s, after `settle` samples more."""
    data, steps = mujoco.MjData(model), round(period / model.opt.timestep)
    data.qpos[:] = qpos
    states, commands = [], []
    for sample in range(-settle, samples):
        data.ctrl[:] = control(max(sample, 0), data.qpos, data.qvel)
        states.append(np.r_[data.qpos, data.qvel])
        commands.append(data.ctrl.copy())
        mujoco.mj_step(model, data, steps)
    return np.array(states[settle:]), np.array(commands[settle:])


def integrate(
    model: mujoco.MjModel, qpos: np.ndarray, control: Control, period: float, samples: int
) -> tuple[np.ndarray, np.ndarray]:
    """The same without MuJoCo's friction, by midpoint steps; of hinges and slides that touch nothing."""
    friction, free, h = model.dof_frictionloss.copy(), _frictionless(model), model.opt.timestep
    data, q, v, states, commands = mujoco.MjData(free), qpos.copy(), np.zeros(model.nv), [], []
    for sample in range(samples):
        data.ctrl[:] = control(sample, q, v)
        states.append(np.r_[q, v])
        commands.append(data.ctrl.copy())
        for _ in range(round(period / h)):
            half = _advance(free, data, q, v, v, friction, h / 2)
            after = _advance(free, data, q + h / 2 * v, half, v, friction, h)
            q, v = q + h / 2 * (v + after), after
    return np.array(states), np.array(commands)


def _frictionless(model: mujoco.MjModel) -> mujoco.MjModel:
    free = copy(model)
    free.dof_frictionloss[:] = 0
    return free


def _advance(model, data, q, v, begin, friction, time) -> np.ndarray:
    """Speed after `time` s from `begin`, accelerated as at (q, v), with the impulses of dry friction."""
    data.qpos[:], data.qvel[:] = q, v
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    inverse = np.linalg.inv(mass)
    speed = begin + time * data.qacc
    return speed + inverse @ _impulses(inverse, speed, friction * time)


def _impulses(inverse: np.ndarray, speed: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Impulses (nv,), at most `most`, that stop each joint of `speed` which they can stop."""
    impulse = np.zeros_like(speed)
    joints = np.flatnonzero(most)
    for _ in range(SWEEPS if len(joints) > 1 else 1):
        for j in joints:
            left = speed[j] + inverse[j] @ impulse
            impulse[j] = np.clip(impulse[j] - left / inverse[j, j], -most[j], most[j])
    return impulse


def difference(model: mujoco.MjModel, qpos: np.ndarray, control: Control, period: float, samples: int) -> float:
    """Largest difference of positions (rad or m) between `simulate` and `integrate`."""
    ours, _ = integrate(model, qpos, control, period, samples)
    theirs, _ = simulate(model, qpos, control, period, samples)
    return float(np.abs(ours - theirs)[:, : model.nq].max())
