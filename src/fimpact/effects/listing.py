"""The catalogue for a terminal: all of it by family, one effect in full, and the places that a model has for them."""

import inspect
from collections.abc import Callable
from pathlib import Path
from textwrap import fill

import mujoco
import numpy as np

from fimpact.cases.models.naive import read_model
from fimpact.effects import EFFECTS
from fimpact.effects.base import Coefficient, Effect
from fimpact.effects.fields import SIMULATORS, fields_of
from fimpact.effects.wiring import HINGE, SLIDE

WIDE = 110  # columns of a terminal
SLIDES = "On slides N, m and linear stand in the place of N m, rad and angular, and nothing is per degree."

Places = Callable[[Effect], list[str]]


def catalogue(places: Places | None = None) -> list[str]:
    """List the effects by family, each with a sentence or, of a model, with its places."""
    width, lines = max(map(len, EFFECTS)), []
    for family in dict.fromkeys(effect.family for effect in EFFECTS.values()):
        lines.append(family)
        for effect in (e for e in EFFECTS.values() if e.family == family):
            lines.append(_row(effect.name, _places(places(effect)) if places else effect.sentence, width))
    return lines


def facts(effect: Effect) -> dict[str, str]:
    """Name what is known of an effect: law, numbers, where it can sit, and its field in each simulator."""
    fields = fields_of(effect)
    rows = {"law": effect.equation, **{f"coefficient {c.name}": _number(c) for c in effect.coefficients}}
    rows |= {"typical size": effect.prior_source, "kinds of place": _kinds(effect), "reference": effect.reference}
    return rows | {title: fields[name] for name, title in SIMULATORS.items()}


def described(effect: Effect, places: Places | None = None) -> list[str]:
    """Describe an effect by its `facts`, and its places in a model."""
    rows = facts(effect)
    if places:
        rows["in this model"] = _places(places(effect))
    width = max(map(len, rows))
    turns = (
        any("rad" in c.unit or "N m" in c.unit for c in effect.coefficients) or "angular" in rows[SIMULATORS["physx"]]
    )
    listed = [_row(title, text, width) for title, text in rows.items() if text]
    return [f"{effect.name} ({effect.family}): {effect.sentence}", *listed, *([SLIDES] if turns else [])]


def place_lister(path: Path) -> Places:
    """Make a function that names the places of an effect in an MJCF.

    As measured count its sensors and the position of each hinge and slide joint: a log may have more, or less.

    Raises:
        CaseError: the MJCF cannot be read.
    """
    spec = mujoco.MjSpec.from_string(read_model(path).text())
    read = {sensor.objname for sensor in spec.sensors if sensor.type == mujoco.mjtSensor.mjSENS_JOINTPOS}
    taken = {sensor.name for sensor in spec.sensors}
    for joint in spec.joints:
        if int(joint.type) in (HINGE, SLIDE) and joint.name and joint.name not in read | taken:
            kind = {"type": mujoco.mjtSensor.mjSENS_JOINTPOS, "objtype": mujoco.mjtObj.mjOBJ_JOINT}
            spec.add_sensor(name=joint.name, objname=joint.name, **kind)
    model = spec.compile()
    channels = [channel for i in range(model.nsensor) for channel in _channels(model.sensor(i))]
    return lambda effect: effect.sites(model, channels)


def _channels(sensor) -> list[str]:
    """Names under which a case measures a sensor: its own, or one for each component."""
    dimension = int(sensor.dim[0])
    parts = [""] if dimension == 1 else [f"[{i}]" for i in range(dimension)]
    return [sensor.name + part for part in parts if sensor.name]


def _row(title: str, text: str, width: int) -> str:
    indent = " " * (width + 4)
    return fill(text, WIDE, initial_indent=f"  {title:{width}}  ", subsequent_indent=indent, break_long_words=False)


def _number(coefficient: Coefficient) -> str:
    """Unit and bounds: ``N m, at least 0``."""
    low, high = coefficient.low, coefficient.high
    unit = "a ratio" if coefficient.unit == "1" else coefficient.unit
    if np.isfinite([low, high]).all():
        return f"{unit}, {low:g} to {high:g}"
    bound = f", at least {low:g}" if np.isfinite(low) else f", at most {high:g}" if np.isfinite(high) else ""
    return unit + bound


def _kinds(effect: Effect) -> str:
    """What kind of place it sits at: how the function that finds them says it."""
    return (inspect.getdoc(effect.sites) or "").partition("\n\n")[0].replace("`", "").replace("\n", " ")


def _places(found: list[str]) -> str:
    return ", ".join(found) or "nowhere"
