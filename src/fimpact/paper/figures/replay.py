"""Replay: a designed experiment, simulated with MuJoCo C to be looked at."""

import mujoco
import numpy as np

from fimpact.paper.systems import System
from fimpact.report.plotting.scene import Scene, contacts, pivots, plane_of_motion


def replay(system: System, theta: np.ndarray, design: np.ndarray) -> Scene:
    """Simulate `design` on the system with parameters `theta`, in physical units, and keep what can be seen."""
    model = system.compile(theta)
    data, axes = mujoco.MjData(model), plane_of_motion(model)
    data.qpos[:], data.qvel[:], ctrl = (np.asarray(part) for part in system.launch(system, np.asarray(design)))
    steps = []
    for u in ctrl:
        data.ctrl[:] = u
        time = data.time
        mujoco.mj_step(model, data)
        # Poses and forces still belong to the beginning of the step.
        seen = (data.geom_xpos.copy(), data.geom_xmat.reshape(-1, 3, 3).copy(), contacts(model, data, axes))
        steps.append((time, *seen, system.read(model, data)))
    time, position, rotation, touches, measurement = zip(*steps, strict=True)
    when, where, turned = (np.array(part) for part in (time, position, rotation))
    return Scene(model, axes, when, where, turned, touches, np.array(measurement), pivots(model, data, axes))
