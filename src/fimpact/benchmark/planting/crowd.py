"""A crowd: what a naive robot lacks at every joint at once, as real gears have it, and the rigs without and with it.

Sizes are drawn about round figures of our own: what gears of such robots are known for, from no one publication.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from fimpact.benchmark.planting.ground_truth import sharp_dry_friction
from fimpact.benchmark.rigs.rig import Rig
from fimpact.recordings import Unknown

SPREAD = 0.3  # sd of the logarithm of a size, from gear to gear
FREE = 10.0  # relative sd with which an oracle knows a size beforehand: not at all
FIELDS = {"coulomb": "frictionloss", "viscous": "damping", "rotor_inertia": "armature"}
VALUES = {"coulomb": "friction", "viscous": "damping", "rotor_inertia": "inertia"}
TYPICAL = {  # by rig: dry friction, N m, viscous friction, N m s/rad, and rotor inertia, kg m^2, of each driven joint
    "arm_free": ([0.12, 0.08, 0.04], [0.06, 0.06, 0.06], [0.01, 0.006, 0.003]),
    "arm_contact": ([0.12, 0.08, 0.04], [0.1, 0.1, 0.1], [0.01, 0.006, 0.003]),
    "six_axis": (
        [8.0, 9.0, 7.0, 2.2, 2.0, 1.6],
        [9.0, 9.0, 7.8, 1.2, 1.0, 0.8],
        [0.6, 0.6, 0.4, 0.1, 0.1, 0.08],
    ),
    "six_servo": (
        [0.067, 0.092, 0.056, 0.055, 0.05, 0.058],
        [0.3, 0.3, 0.3, 0.3, 0.3, 0.3],
        [0.022, 0.03, 0.024, 0.032, 0.025, 0.026],
    ),
    "leg": ([0.3, 0.35], [0.08, 0.08], [0.006, 0.006]),
}
ODD = (
    "transmission_coupling stribeck torque_offset backlash gain command_delay payload base_gives_way "
    "joint_elasticity load_dependent_friction"
).split()


@dataclass(frozen=True)
class Member:
    """One effect of a crowd: its name, its joint and its size."""

    name: str
    site: str
    size: float

    @property
    def values(self) -> dict[str, float]:
        """As it is planted."""
        return {VALUES[self.name]: self.size}


def draw_members(rig: Rig, rng: np.random.Generator) -> tuple[Member, ...]:
    """Friction and rotor of every driven joint of `rig`."""
    return tuple(
        Member(name, joint, float(size * np.exp(SPREAD * rng.standard_normal())))
        for name, sizes in zip(FIELDS, TYPICAL[rig.name], strict=True)
        for joint, size in zip(rig.driven, sizes, strict=True)
    )


def bare(rig: Rig) -> Rig:
    """The rig whose naive model knows neither friction nor rotors, nor has them among its unknowns."""
    spec = mujoco.MjSpec.from_string(rig.xml)
    for name in rig.driven:
        _put(spec.joint(name), dict.fromkeys(FIELDS.values(), 0.0))
    kept = tuple(u for u in rig.unknowns if u.field not in FIELDS.values())
    return replace(rig, text=_written(spec), unknowns=kept)


def filled(rig: Rig, members: tuple[Member, ...]) -> Rig:
    """The bare `rig` with its crowd, the sizes of which an oracle has to fit with all that is unknown."""
    spec = mujoco.MjSpec.from_string(rig.xml)
    for member in members:
        _put(spec.joint(member.site), {FIELDS[member.name]: member.size})
    for name in rig.driven:
        sharp_dry_friction(spec.joint(name), spec.option.timestep)
    freed = tuple(Unknown(FIELDS[member.name], member.site, FREE) for member in members)
    return replace(rig, text=_written(spec), unknowns=(*rig.unknowns, *freed))


def _put(joint, values: dict[str, float]) -> None:
    for field, value in values.items():
        setattr(joint, field, np.array([value, 0, 0]) if field == "damping" else value)


def _written(spec) -> str:
    spec.compile()
    return spec.to_xml()
