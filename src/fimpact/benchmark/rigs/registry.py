"""The rigs by their names."""

from fimpact.benchmark.rigs.planar import ARM, BLOCK, PRESSING
from fimpact.benchmark.rigs.rig import Rig
from fimpact.benchmark.rigs.robots import LEG, SIX_AXIS, SIX_SERVO

RIGS = {rig.name: rig for rig in (ARM, PRESSING, BLOCK, SIX_AXIS, SIX_SERVO, LEG)}


def rig_of(name: str) -> Rig:
    """The rig `name`. Raises ValueError listing the rigs there are."""
    if name not in RIGS:
        raise ValueError(f"no rig is called {name!r}; there are {', '.join(RIGS)}")
    return RIGS[name]
