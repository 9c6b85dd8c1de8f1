"""Hypotheses as an engineer would say them: a kind of physics at a class of places, or at one place."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco

from fimpact.effects.classes import classes
from fimpact.effects.wiring import ON_JOINT
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
        if candidate.among == 1:  # what fits best of many fits nothing by being many
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


def with_parts(
    model: mujoco.MjModel, offered: Sequence[Option], candidates: Sequence[Candidate], parts: Sequence[int]
) -> list[Option]:
    """Pair each option of one effect at one joint with all `parts`, by number, that a whole drive has there.

    A drive that was fitted beside a wrong motor, load or friction has parts of its own pulled to nothing, and neither
    they nor what had kept them out are worth much without the other.
    """
    found = []
    for option in offered:
        own = candidates[option.members[0]] if len(option.members) == 1 else None
        joint = joint_at(model, own.site) if own else ""
        held = tuple(i for i in parts if candidates[i].site == joint)
        if held:
            name = f"{option.name}, and what a drive has at {joint}"
            found.append(Option(name, option.order, (*option.members, *held)))
    return found


def joint_at(model: mujoco.MjModel, site: str) -> str:
    """Name the joint at which a site acts: itself, the first of a coupling, a motor's or a body's own; "" for none."""
    name = site.partition("<-")[0]
    kinds = (mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_ACTUATOR, mujoco.mjtObj.mjOBJ_BODY)
    joint, motor, body = (mujoco.mj_name2id(model, int(kind), name) for kind in kinds)
    if joint < 0 and motor >= 0 and model.actuator_trntype[motor] == ON_JOINT:
        joint = int(model.actuator_trnid[motor, 0])
    elif joint < 0 and body >= 0 and model.body_jntnum[body] == 1:
        joint = int(model.body_jntadr[body])
    return model.joint(joint).name if joint >= 0 else ""
