"""Compiled models as they are simulated here: without what is only seen, and with a solver that converges."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

import mujoco

from fimpact.effects.native import editable
from fimpact.effects.touching import can_touch
from fimpact.recordings import spec_of
from fimpact.simulation.nonsmooth import has_constraints
from fimpact.support.visual_meshes import without_visuals

CONVERGED, ITERATIONS = 1e-13, 50  # of MuJoCo's constraint solver
NO_CONSTRAINT = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)


@lru_cache(maxsize=2)  # a large model takes longer to compile than to copy
def compiled_model(xml: str, apart: bool) -> mujoco.MjModel:
    """The model of an MJCF that can be edited, without what is only seen; apart: nothing touches anything."""
    return editable(without_visuals(spec_of(xml), apart))


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
