"""The parameters that a toolbox is given to fit: a recording's own unknowns, or with them all that may be missing.

Freeing friction, damping and armature in every joint is what users do who do not know where something is missing.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from fimpact.mismatch.coordinates import NOTHING, coordinates
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.scales import scales
from fimpact.mismatch.simulate import Hypothesis, Simulator
from fimpact.recordings import Recording, Unknown

BOUND = 8.0  # prior standard deviations, or typical sizes, beyond which no fit goes
INSIDE = 0.1  # typical sizes at which a freed parameter starts: on its bound at 0 an optimiser would stall
OF_JOINTS = ("damping", "frictionloss", "armature")
TURNS_OR_SLIDES = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


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


def own_knobs(problem: Problem) -> Knobs:
    """The recording's unknowns, from the model's own values."""
    free = coordinates(problem.simulator)
    low, high = np.maximum(free.low, free.mean - BOUND * free.scale), free.mean + BOUND * free.scale
    return Knobs(free.mean, low, high, free.scale, free.mean, free.sd)


def freed(recording: Recording) -> Recording:
    """`recording` with more unknowns: what any hinge or slide can lack, and the friction of every contact."""
    model = Simulator(recording).base
    joints = [model.joint(i).name for i in range(model.njnt) if model.jnt_type[i] in TURNS_OR_SLIDES]
    touching = [model.geom(i).name for i in range(model.ngeom) if model.geom_contype[i] | model.geom_conaffinity[i]]
    wanted = [(field, joint) for field in OF_JOINTS for joint in joints]
    wanted += [("pair_friction", model.pair(i).name) for i in range(model.npair)]
    wanted += [("friction", geom) for geom in touching if not model.npair]
    known = {(unknown.field, unknown.site) for unknown in recording.unknowns}
    extra = tuple(Unknown(field, site) for field, site in wanted if site and (field, site) not in known)
    return replace(recording, unknowns=recording.unknowns + extra)


def freed_knobs(problem: Problem) -> Knobs:
    """As `own_knobs`, with what a joint has been given none of on the scale of the forces and speeds of its motion."""
    knobs, unknowns = own_knobs(problem), problem.simulator.recording.unknowns
    sizes = _joint_sizes(problem)
    start, low, high, scale = (np.array(part, float) for part in (knobs.start, knobs.low, knobs.high, knobs.scale))
    for i, unknown in enumerate(unknowns):
        if unknown.field in OF_JOINTS:
            scale[i] = max(scale[i] * (start[i] > 0), sizes[unknown.field, unknown.site])
            low[i], high[i] = 0.0, start[i] + BOUND * scale[i]
            start[i] = max(start[i], INSIDE * scale[i])
    return Knobs(start, low, high, scale, knobs.mean, knobs.sd)


def _joint_sizes(problem: Problem) -> dict[tuple[str, str], float]:
    simulator = problem.simulator
    found = scales(problem, problem.evaluate(Hypothesis(simulator.theta), *problem.starts, NOTHING))
    model, data = simulator.base, mujoco.MjData(simulator.base)
    inertia = np.empty((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    sizes = {}
    for joint in (model.joint(i) for i in range(model.njnt)):
        dof = joint.dofadr[0]
        of_joint = (found.force[dof] / found.speed[dof], found.force[dof], inertia[dof, dof])
        sizes |= {(field, joint.name): float(size) for field, size in zip(OF_JOINTS, of_joint, strict=True)}
    return sizes
