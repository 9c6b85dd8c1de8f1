"""Pairs of effects that some motions cannot tell apart although others can.

Delay and lag are no twins in the free arm: at the sizes that are drawn no command within
its limits tells them apart.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Twins:
    """Two effects at the same place of the same joint, the style of motion that confuses them, and in which rigs."""

    names: tuple[str, str]
    style: str
    systems: tuple[str, ...]


TWINS = (
    Twins(("torque_offset", "coulomb"), "oneway", ("arm_free", "six_axis")),
    Twins(("gain", "saturation"), "bang", ("arm_free", "arm_contact")),
    Twins(("command_delay", "actuator_lag"), "slow", ("arm_contact", "six_servo", "leg")),
    Twins(("coulomb", "stribeck"), "oneway", ("arm_free",)),
    Twins(("spring", "torque_offset"), "still", ("arm_free", "arm_contact", "six_axis", "six_servo")),
    Twins(("coulomb", "dahl"), "oneway", ("arm_free",)),
    Twins(("linear_drag", "quadratic_drag"), "steady", ("block",)),
)
