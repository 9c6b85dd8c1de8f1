"""The parameters that a toolbox is given to fit: a recording's own unknowns, or with them all that may be missing.

Freeing friction, damping and armature in every joint is what users do who do not know where something is missing.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.diagnosis.freed_model import OF_JOINTS
from fimpact.smoothing.parameters import parameters
from fimpact.smoothing.prepare import Prepared

BOUND = 8.0  # prior standard deviations, or typical sizes, beyond which no fit goes
LEAST = 1e-3  # of a positive parameter's own value: it goes no lower
INSIDE = 0.1  # typical sizes at which a freed parameter starts: on its bound at 0 an optimiser would stall
SAMPLES = 400  # states whose inverse dynamics is averaged


@dataclass(frozen=True)
class Knobs:
    """Parameters as `mujoco.sysid` takes them, in the order of the recording's unknowns, and what is known of them
    before (sd: infinite where nothing is): (p,) each."""

    start: np.ndarray
    low: np.ndarray
    high: np.ndarray
    scale: np.ndarray
    mean: np.ndarray
    sd: np.ndarray


def own_knobs(prepared: Prepared) -> Knobs:
    """The recording's unknowns, from the model's own values."""
    simulator = prepared.track.simulator
    numbers = parameters(simulator, simulator.theta, (), ())
    mean, sd, low, size = (np.array([getattr(n, of) for n in numbers], float) for of in ("mean", "sd", "low", "size"))
    scale, sd = np.minimum(np.where(sd > 0, sd, np.inf), size), np.where(sd > 0, sd, np.inf)
    low = np.where([n.log for n in numbers], LEAST * size, np.maximum(low, mean - BOUND * scale))
    return Knobs(mean, np.maximum(low, mean - BOUND * scale), mean + BOUND * scale, scale, mean, sd)


def freed_knobs(prepared: Prepared) -> Knobs:
    """As `own_knobs`, with what a joint has been given none of on the scale of the forces and speeds of its motion."""
    knobs, sizes = own_knobs(prepared), _joint_sizes(prepared)
    start, low, high, scale = (np.array(part, float) for part in (knobs.start, knobs.low, knobs.high, knobs.scale))
    for i, unknown in enumerate(prepared.track.recording.unknowns):
        if unknown.field in OF_JOINTS:
            scale[i] = max(scale[i] * (start[i] > 0), sizes[unknown.field, unknown.site])
            low[i], high[i] = 0.0, start[i] + BOUND * scale[i]
            start[i] = max(start[i], INSIDE * scale[i])
    return Knobs(start, low, high, scale, knobs.mean, knobs.sd)


def _joint_sizes(prepared: Prepared) -> dict[tuple[str, str], float]:
    model = prepared.track.model
    data, inertia = mujoco.MjData(model), np.empty((model.nv, model.nv))
    force, speed = _force(prepared), np.sqrt(np.mean(prepared.begun.qvel**2, 0)) + 1e-9
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    sizes: dict[tuple[str, str], float] = {}
    for joint in (model.joint(i) for i in range(model.njnt)):
        dof = joint.dofadr[0]
        of_joint = (force[dof] / speed[dof], force[dof], inertia[dof, dof])
        sizes |= {(field, joint.name): float(size) for field, size in zip(OF_JOINTS, of_joint, strict=True)}
    return sizes


def _force(prepared: Prepared) -> np.ndarray:
    """Root mean square force that accelerates and carries each degree of freedom along the measured motion, (nv,)."""
    track, begun = prepared.track, prepared.begun
    data, found = mujoco.MjData(track.model), []
    inside = np.flatnonzero(~track.last)
    for k in inside[:: max(1, len(inside) // SAMPLES)]:
        data.qpos[:], data.qvel[:] = begun.qpos[k], begun.qvel[k]
        data.qacc[:] = (begun.qvel[k + 1] - begun.qvel[k]) / track.period
        mujoco.mj_inverse(track.model, data)
        found.append(np.abs(data.qfrc_inverse) + np.abs(data.qfrc_bias))
    return np.sqrt(np.mean(np.array(found) ** 2, 0)) + 1e-12
