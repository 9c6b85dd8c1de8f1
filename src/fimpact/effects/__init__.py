"""The catalogue: physics that a model may lack, in the order in which it is listed.

An effect of one's own is a function and an `Effect` that names it; `EFFECTS[effect.name] = effect` adds it.
"""

from fimpact.effects import actuation, contact, environment, friction, sensing, structure, transmission
from fimpact.effects.base import Effect

FAMILIES = (friction, transmission, actuation, structure, environment, contact, sensing)
EFFECTS: dict[str, Effect] = {effect.name: effect for family in FAMILIES for effect in family.EFFECTS}


def get_effect(name: str) -> Effect:
    """The entry called `name`.

    Raises:
        ValueError: no such entry; the message lists those that exist.
    """
    if name not in EFFECTS:
        raise ValueError(f"effect '{name}' not found; available: {', '.join(EFFECTS)}")
    return EFFECTS[name]
