"""Compiled models as they are simulated here: without what is only seen, and with a solver that converges."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache

import mujoco
import numpy as np

from fimpact.effects.native import editable
from fimpact.effects.touching import can_touch
from fimpact.recordings import spec_of
from fimpact.simulation.nonsmooth import has_constraints
from fimpact.support.visual_meshes import without_visuals

CONVERGED, ITERATIONS = 1e-13, 50  # of MuJoCo's constraint solver
NO_CONSTRAINT = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)


@lru_cache(maxsize=8)  # a large model takes longer to compile than to copy
def compiled_model(xml: str, apart: bool, sites: tuple[str, ...] = ()) -> mujoco.MjModel:
    """The model of an MJCF that can be edited, without what is only seen.

    Args:
        apart: nothing touches anything. sites: joints behind which there is a second one.
    """
    return editable(with_joints_behind(without_visuals(spec_of(xml), apart), sites))


def behind_name(site: str) -> str:
    """Name of the joint behind the rotor of joint `site`, and of the tendon that holds the link."""
    return f"behind {site}"


def with_joints_behind(spec: mujoco.MjSpec, sites: Sequence[str]) -> mujoco.MjSpec:
    """Add to `spec` a joint behind each of the joints `sites`, and a tendon that moves with the link."""
    for key in list(spec.keys) if sites else ():  # of another size
        spec.delete(key)
    for site in sites:
        joint, name = spec.joint(site), behind_name(site)
        behind = joint.parent.add_joint(name=name, type=joint.type, axis=joint.axis, pos=joint.pos)
        behind.armature, behind.frictionloss = 1.0, 0.0  # else rotors without inertia could not be compiled
        behind.stiffness, behind.damping, behind.springdamper = np.zeros(3), np.zeros(3), np.zeros(2)
        behind.limited = behind.actfrclimited = False
        link = spec.add_tendon(name=name)
        link.wrap_joint(site, 1.0)
        link.wrap_joint(name, 1.0)
    return spec


def sensor_column(model: mujoco.MjModel, channel: str) -> int:
    """Find the column of `channel` in MuJoCo's `sensordata`."""
    name, _, component = channel.removesuffix("]").partition("[")
    return int(model.sensor(name).adr[0]) + int(component or 0)


def configure(model: mujoco.MjModel) -> None:
    """Set the solver so that differences of simulations mean something, and divergence shows as NaN."""
    # A diverged state must show as NaN, not as a silent reset. Islands change no digit and cost a twentieth.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET | mujoco.mjtDisableBit.mjDSBL_ISLAND
    # A difference of two simulations through contact needs a solver that has converged further than a picture does;
    # what else holds a robot is found to the last digit by steps that are few.
    if can_touch(model) or model.opt.solver != mujoco.mjtSolver.mjSOL_NEWTON:
        model.opt.tolerance = min(model.opt.tolerance, CONVERGED)
    model.opt.iterations = max(model.opt.iterations, ITERATIONS)
    model.opt.ls_iterations = max(model.opt.ls_iterations, ITERATIONS)
    # Of limbs that move without one another half of all entries are nothing: left out, contact takes half the time.
    if can_touch(model) and model.nM < model.nv * (model.nv + 1) // 2:
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE


@contextmanager
def without_idle_solver(model: mujoco.MjModel) -> Iterator[None]:
    """What nothing holds needs no constraint solver: the same digits, an eighth sooner."""
    flags = model.opt.disableflags
    model.opt.disableflags = flags | (0 if has_constraints(model) else NO_CONSTRAINT)
    try:
        yield
    finally:
        model.opt.disableflags = flags
