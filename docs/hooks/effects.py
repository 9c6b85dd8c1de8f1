"""The pages of the catalogue, from what `fimpact effects NAME` prints."""

import re

from signatures import signature

from fimpact.effects import EFFECTS
from fimpact.effects.base import Effect
from fimpact.effects.listing import facts

NUMBER = "coefficient "
FIELDS = ("MJCF", "URDF", "PhysX / Isaac (USD)")
HEAD = """# Every effect

An effect is one piece of physics that a model may lack. `fimpact effects` lists them, `fimpact effects coulomb` shows
one in full, and `fimpact effects coulomb --model arm.xml` its places in your model. These pages are made from the same
table.

Each picture is simulated: a two-link arm with motors or with servos, or a ball thrown onto a table, with the effect at
about a third of what the catalogue holds plausible. On the left is how it changes the reading that it changes most. On
the right, where that is clear, is the force that the model then lacks, against the speed of the joint.

In equations, τ is the torque of a joint, q its position, q̇ its speed, u a command. Units are those of a hinge; on
slides N, m and linear stand in the place of N m, rad and angular.
"""


def pages() -> dict[str, str | bytes]:
    """An overview, and a page for each family."""
    families = dict.fromkeys(effect.family for effect in EFFECTS.values())
    made: dict[str, str | bytes] = {"effects.md": HEAD + "".join(_overview(family) for family in families)}
    drawn = {name: picture for name, effect in EFFECTS.items() if (picture := signature(effect))}
    made |= {f"effects/{_file(family)}.md": _family(family, set(drawn)) for family in families}
    return made | {f"effects/{name}.png": picture for name, picture in drawn.items()}


def _file(family: str) -> str:
    return re.sub(r"\W+", "-", family)


def _of(family: str) -> list[Effect]:
    return [effect for effect in EFFECTS.values() if effect.family == family]


def _overview(family: str) -> str:
    rows = "".join(
        f"| [{effect.name}](effects/{_file(family)}.md#{effect.name}) | {effect.sentence} |\n" for effect in _of(family)
    )
    return f"\n## {family.capitalize()}\n\n| effect | what it is |\n|---|---|\n{rows}"


def _family(family: str, drawn: set[str]) -> str:
    parts = [_effect(effect, effect.name in drawn) for effect in _of(family)]
    return f"# {family.capitalize()}\n\n[All effects](../effects.md)\n" + "".join(parts)


def _effect(effect: Effect, drawn: bool) -> str:
    rows = facts(effect)
    law = rows.pop("law")
    fields = "".join(f"| {name} | {_code(rows.pop(name))} |\n" for name in FIELDS if name in rows)
    numbers = "".join(f"| `{name.split()[1]}` | {rows.pop(name)} |\n" for name in list(rows) if name.startswith(NUMBER))
    others = "".join(f"| {name} | {text} |\n" for name, text in rows.items() if text)
    picture = f"![What {effect.name} does to a log]({effect.name}.png)\n\n" if drawn else ""
    return (
        f"\n## {effect.name} {{#{effect.name}}}\n\n{effect.sentence}\n\n```text\n{law}\n```\n\n"
        f"{picture}| number | unit and bounds |\n|---|---|\n{numbers}\n| | |\n|---|---|\n{others}{fields}"
    )


def _code(text: str) -> str:
    return text.replace("<", "&lt;").replace("|", "\\|")
