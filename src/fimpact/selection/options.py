"""Hypotheses as an engineer would say them: a kind of physics at a class of places, or at one place."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco

from fimpact.effects.classes import classes
from fimpact.smoothing.candidates import Candidate


@dataclass(frozen=True)
class Option:
    """What may be added in one round: members are candidates, by number. order: the engineer's, in which ties go."""

    name: str
    order: int
    members: tuple[int, ...]
    compound: bool = False


def options(model: mujoco.MjModel, channels: Sequence[str], candidates: Sequence[Candidate]) -> list[Option]:
    """Every class of places with each choice of shapes, the compound first; then every place alone."""
    by_place: dict[tuple[str, str], list[int]] = {}
    for i, candidate in enumerate(candidates):
        by_place.setdefault((candidate.effect.name, candidate.site), []).append(i)
    found, listed = [], set()
    for kind in classes(model, channels):
        own = [by_place[place] for place in kind.effects if place in by_place]
        choices = max((len(some) for some in own), default=0) if len(own) > 1 else 0
        for k in range(choices):
            members = tuple(some[min(k, len(some) - 1)] for some in own)
            found.append(Option(kind.name, kind.order, members, kind.compound))
            listed.add(members)
    alone = [Option(c.name, c.effect.order, (i,)) for i, c in enumerate(candidates)]
    return found + [option for option in alone if option.members not in listed]
