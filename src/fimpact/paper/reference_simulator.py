"""The experiment as it really happens: MuJoCo C with the true parameters, and sensor noise.

Shares no code with the estimator: `edit` instead of `revise`, MuJoCo's own sensors instead of the equations.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.paper.systems.base import System


@dataclass(frozen=True)
class Recording:
    """What one experiment leaves behind: the design, the measurement (T, ny), and steps in contact."""

    design: np.ndarray
    measurement: np.ndarray
    contact_steps: int


def run(system: System, theta: np.ndarray, design: np.ndarray, noise: np.ndarray | float) -> Recording:
    """Run `design` on the robot with parameters `theta`.

    Args:
        noise: standard normal draws, shape (T, ny); scaled by the sensor's noise.
    """
    measurement, contact_steps = simulate(system, theta, design)
    return Recording(np.asarray(design), measurement + system.sensor.noise * noise, contact_steps)


def simulate(system: System, theta: np.ndarray, design: np.ndarray) -> tuple[np.ndarray, int]:
    """Noise-free measurement, shape (T, ny), and the number of steps in contact, in MuJoCo C."""
    model = system.compile(theta)
    data = mujoco.MjData(model)
    qpos, qvel, ctrl = system.launch(system, np.asarray(design))
    data.qpos[:], data.qvel[:] = qpos, qvel
    rows, contact_steps = [], 0
    for u in np.asarray(ctrl):
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
        rows.append(system.read(model, data))
        contact_steps += data.ncon > 0
    return np.array(rows), int(contact_steps)
