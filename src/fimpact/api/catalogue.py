"""The catalogue of effects as a table."""

import pandas as pd

from fimpact.effects import EFFECTS
from fimpact.effects.fields import SIMULATORS, fields_of


def catalogue() -> pd.DataFrame:
    """List the physics that a model may lack, by name.

    Returns:
        family; description; equation; parameters with their units; and the field in MJCF, URDF and PhysX that holds it.
    """
    rows = {}
    for name, effect in EFFECTS.items():
        numbers = ", ".join(f"{one.name} ({one.unit})" for one in effect.coefficients)
        own = {"family": effect.family, "description": effect.sentence, "equation": effect.equation}
        rows[name] = {**own, "parameters": numbers, **{key: fields_of(effect)[key] for key in SIMULATORS}}
    table = pd.DataFrame.from_dict(rows, orient="index")
    table.index.name = "effect"
    return table
