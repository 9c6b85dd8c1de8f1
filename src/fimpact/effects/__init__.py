"""The catalogue: physics that a model may lack, in the order in which it is listed.

An effect of one's own is a function and an `Effect` that names it; `EFFECTS[effect.name] = effect` adds it.
"""

from difflib import get_close_matches

from fimpact.effects.base import Effect
from fimpact.effects.families import (
    actuation,
    contact,
    environment,
    friction,
    masses,
    sensing,
    servos,
    structure,
    transmission,
)

FAMILIES = (friction, transmission, actuation, servos, masses, structure, environment, contact, sensing)
LONGEST = 100  # letters of a name, beyond which the nearest takes long to find
LAST = ("gravity_scale",)  # whoever cannot tell it from a scale of what is read should suspect that first
_every = [effect for family in FAMILIES for effect in family.EFFECTS]
EFFECTS: dict[str, Effect] = {effect.name: effect for effect in sorted(_every, key=lambda e: e.name in LAST)}


def get_effect(name: str) -> Effect:
    """The entry called `name`.

    Raises:
        ValueError: no such entry; the message names the nearest.
    """
    if name not in EFFECTS:
        near = get_close_matches(name[:LONGEST], EFFECTS, 1)
        meant = f"did you mean '{near[0]}'? " if near else ""
        raise ValueError(f"effect '{name}' not found; {meant}`fimpact effects` lists all {len(EFFECTS)}")
    return EFFECTS[name]
