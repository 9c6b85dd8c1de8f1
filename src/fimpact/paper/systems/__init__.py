"""The registry of systems: a function from a configuration table to a `System`, by name."""

from fimpact.paper.systems.arm import arm
from fimpact.paper.systems.base import Inputs, Parameter, Sensor, System
from fimpact.paper.systems.block import block

SYSTEMS = {"arm": arm, "block": block}

__all__ = ["SYSTEMS", "Inputs", "Parameter", "Sensor", "System", "make_system"]


def make_system(name: str, settings: dict) -> System:
    """The system called `name`, built from its table of the configuration.

    Raises:
        ValueError: no such system; the message lists those available.
    """
    if name not in SYSTEMS:
        raise ValueError(f"system '{name}' not found; available: {', '.join(SYSTEMS)}")
    return SYSTEMS[name](settings)
