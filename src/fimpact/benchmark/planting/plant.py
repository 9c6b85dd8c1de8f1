"""What can be planted into a world."""

from collections.abc import Callable
from dataclasses import dataclass

Values = dict[str, float]


def _shapeless(rng, rig, motion, site) -> Values:
    return {}


@dataclass(frozen=True)
class Plant:
    """One piece of physics.

    put: (world, site, **values). sites: rig -> places. values: (size, **shape) -> values. begin: size at which the
    search begins. most: largest sensible size. shape: (rng, rig, motion, site) -> numbers that stay fixed while the
    size is sought. signed: the size may be negative. mode: "contact" if it acts in contact only, else "any". stiff: by
    how much finer steps than the naive model's its size is sought: hard stops shiver at that. power: `begin` and `most`
    grow with this power of the rig's `size`: 1 for what is a torque, -1 for what gives way to one.
    """

    put: Callable[..., None]
    sites: dict[str, tuple[str, ...]]
    values: Callable[..., Values]
    begin: float
    most: float
    shape: Callable[..., Values] = _shapeless
    signed: bool = False
    mode: str = "any"
    stiff: int = 1
    power: int = 0

    def span(self, rig) -> tuple[float, float]:
        """`begin` and `most` in this rig."""
        return self.begin * rig.size**self.power, self.most * rig.size**self.power
