"""Numbers of an MJCF that no robot has: MuJoCo would simulate them, or NaN, without a word."""

import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from fimpact.cases.errors import CaseError
from fimpact.cases.models.compiling import called

TIMESTEP = (1e-6, 1.0)  # s
GRAVITY = 1000.0  # m/s^2, some times that of the sun
FRICTIONS = ("damping", "frictionloss", "armature")  # of joints; negative ones would drive them
LONGEST, MEMORY = 10_000, 4 << 30  # iterations of the solver in a time step; bytes of an MjData
HUGE = 1e12  # of anything, in SI units
FIELDS = {
    "body": ("pos", "ipos", "mass", "inertia"),
    "joint": ("pos", "axis", "stiffness"),
    "geom": ("pos", "size"),
    "actuator": ("gear", "gainprm", "biasprm"),
}
SHORT = {"joint": "jnt"}  # as MuJoCo begins the names of arrays


def check_numbers(tree: ElementTree.Element, path: Path) -> None:
    """Whether no number of an MJCF is NaN; MuJoCo takes them.

    Raises:
        CaseError: one is.
    """
    names = {element.get(key) for element in tree.iter() for key in ("name", "class", "model")}
    for element in tree.iter():
        for key, value in element.items():
            if value not in names and key != "file" and "nan" in re.split(r"[\s+-]+", value.lower()):
                got = f"{called(element)} has {key}='{value}'"
                raise CaseError(f"MJCF {path}: {got}; allowed: finite numbers; correct it")


def check_model(model: mujoco.MjModel, path: Path) -> None:
    """Whether a compiled model has numbers that a robot may have.

    Raises:
        CaseError: the first that it has not, with what is allowed.
    """
    complaint = next(_complaints(model), None)
    if complaint:
        raise CaseError(f"MJCF {path}: {complaint}; correct it")


def _complaints(model: mujoco.MjModel) -> Iterator[str]:
    low, high = TIMESTEP
    if not low <= model.opt.timestep <= high:
        yield f"timestep is {model.opt.timestep:g} s; allowed: {low:g} to {high:g} s, such as 0.002"
    for what in ("gravity", "wind", "magnetic"):
        value = getattr(model.opt, what)
        if not np.abs(value).max() <= GRAVITY:
            yield f"{what} is {' '.join(f'{own:g}' for own in value)}; allowed: up to {GRAVITY:g} in SI units"
    for what in FRICTIONS:
        values = getattr(model, f"dof_{what}")
        for dof in np.flatnonzero(~((values >= 0) & (values <= HUGE))):
            joint = model.joint(model.dof_jntid[dof]).name
            yield f"{what} of joint '{joint}' is {values[dof]:g}; allowed: 0 or more, in SI units"
    for density in ("density", "viscosity"):
        if not 0 <= getattr(model.opt, density) <= HUGE:
            yield f"{density} is {getattr(model.opt, density):g}; allowed: 0 or more"
    for count in ("iterations", "ls_iterations", "noslip_iterations", "sdf_iterations"):
        if not 0 <= getattr(model.opt, count) <= LONGEST:
            yield f"{count} is {getattr(model.opt, count)}; allowed: up to {LONGEST}, so that a time step ends"
    if model.narena > MEMORY:
        yield f"memory is {model.narena >> 20} MB; allowed: up to {MEMORY >> 20} MB"
    yield from _endless(model)


def _endless(model: mujoco.MjModel) -> Iterator[str]:
    """Numbers of bodies, joints, geoms and actuators that are not finite, or beyond all measure."""
    for kind, fields in FIELDS.items():
        for field in fields:
            values = getattr(model, f"{SHORT.get(kind, kind)}_{field}")
            for row in {int(place[0]) for place in np.argwhere(~(np.abs(values) <= HUGE))}:
                name = getattr(model, kind)(row).name or f"number {row}"
                got = " ".join(f"{value:g}" for value in np.ravel(values[row])[:6])
                yield f"{field} of {kind} '{name}' is {got}; allowed: numbers up to {HUGE:g} in SI units"
