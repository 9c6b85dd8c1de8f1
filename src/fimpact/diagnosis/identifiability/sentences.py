"""In words: what motions do not show, grouped by place and kind, and the simplest motion that would."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.diagnosis.identifiability.advice import Advice
from fimpact.diagnosis.identifiability.judging import Asked, Judged
from fimpact.diagnosis.identifiability.proposed_motions import Advisor
from fimpact.diagnosis.identifiability.quick_look import Sight
from fimpact.effects.base import RIGID_BODIES
from fimpact.effects.classes import TITLES
from fimpact.effects.sites import ALL, WORLD
from fimpact.recordings import FIELDS

MOST, NAMES = 6, 4  # lines, and names in one of them
FREED = {"com_x": "centre of mass (x)", "com_y": "centre of mass (y)", "com_z": "centre of mass (z)"}
FREED |= {"armature": "rotor inertia", "frictionloss": "dry friction"}


UNSEEN, ALIKE, SWALLOWED = "unseen", "alike", "swallowed"
HEADINGS = {
    UNSEEN: "cannot be seen in these motions, if no larger than usual",
    ALIKE: "cannot be told apart in these motions",
    SWALLOWED: "cannot be told from all that is fitted together",
}


@dataclass(frozen=True)
class Told:
    """One line. kind: one of `HEADINGS`; names: ``effect@site`` or ``field@site``; what: in words; motion: a sentence,
    or "" where no motion was looked for."""

    kind: str
    names: tuple[str, ...]
    what: str
    motion: str


def findings_to_tell(judged: Judged, asked: Sequence[Asked], sight: Sight | None) -> list[Told]:
    """What is to be said, at most `MOST` lines, what the case frees and what is suspected first before the rest.

    Args:
        sight: of the same recording, which knows what motions would do; None: no motion is named.
    """
    known = {own.name: own for own in asked}
    posing = [pair for pair in judged.posing if all(known[name].order > RIGID_BODIES for name in pair)]
    pairs = [*judged.alike, *posing]
    names = list(dict.fromkeys([*judged.unseen, *(n for group in pairs for n in group), *judged.swallowed]))
    advisor = Advisor(sight, names) if sight else None
    lines = _unseen(judged, known, sight, advisor)
    lines += [_group(names, known, advisor) for names in judged.alike]
    lines += _posing(posing, known, advisor) if advisor else []
    lines += [_swallowed(judged.swallowed, known, advisor)] if judged.swallowed else []
    first = sorted(lines, key=lambda own: min(known[name].order for name in own.names))[:MOST]
    return [own for kind in HEADINGS for own in first if own.kind == kind]


def _group(names: Sequence[str], known: dict[str, Asked], advisor: Advisor | None) -> Told:
    what = _listed([in_words(known[name]) for name in names])
    found = advisor.parts(names) if advisor else None
    if found is None:
        less = ", or give it a smaller sd" if any(_of_case(known[name]) for name in names) else ""
        motion = f"No simple motion tells them apart: measure one of them{less}." if _knows(advisor, names) else ""
        return Told(ALIKE, tuple(names), what, motion)
    advice, groups = found
    left = [_listed([in_words(known[name]) for name in own]) for own in groups if len(own) > 1]
    but = f" (but not {', nor '.join(left)})" if left else ""
    return Told(ALIKE, tuple(names), what, f"{_move([advice])}{but}.")


def _posing(pairs: Sequence[tuple[str, str]], known: dict[str, Asked], advisor: Advisor) -> list[Told]:
    """What passes for something larger at the same joint, where a motion would tell them apart."""
    found = {}
    for one in dict.fromkeys(one for one, _ in pairs):
        others = [other for own, other in pairs if own == one and advisor.at_one_joint(one, other)]
        advice = advisor.unmasks(one, others) if others else None
        if advice:
            found[one] = others, advice
    return [
        Told(
            ALIKE,
            (one, *others),
            f"{in_words(known[one])} from {_listed([in_words(known[other]) for other in others], 'or')}",
            f"{_move([advice])}.",
        )
        for one, (others, advice) in found.items()
    ]


def _knows(advisor: Advisor | None, names: Sequence[str]) -> bool:
    """Whether it is known what motions would do: all of these are forces along them."""
    return advisor is not None and set(names) <= set(advisor.names)


def _swallowed(names: Sequence[str], known: dict[str, Asked], advisor: Advisor | None) -> Told:
    what = _listed([in_words(known[name]) for name in names])
    advice = advisor.frees(names) if advisor and _knows(advisor, names) else None
    if advice:
        return Told(SWALLOWED, tuple(names), what, f"{_move([advice])}.")
    motion = (
        "Only combinations show in a simple motion: free fewer, or give smaller sd." if _knows(advisor, names) else ""
    )
    return Told(SWALLOWED, tuple(names), what, motion)


def _unseen(judged: Judged, known: dict[str, Asked], sight: Sight | None, advisor: Advisor | None) -> list[Told]:
    """Unseen ones by place and motion; what no motion shows is told of the case's own parameters only."""
    rows: dict[tuple[str, str, str], list[tuple[Asked, Advice | None]]] = {}
    for name in judged.unseen:
        own, advice = known[name], advisor.shows(name) if advisor else None
        if advice or own.free or not _knows(advisor, [name]):
            how = (advice.how, bool(advice.joint)) if advice else ("", False)
            rows.setdefault((own.site, _why(own, sight), f"{how} {own.free}"), []).append((own, advice))
    merged: dict[tuple, list[list[tuple[Asked, Advice | None]]]] = {}
    for (_, why, shown), members in rows.items():
        merged.setdefault((tuple(title(own) for own, _ in members), why, shown), []).append(members)
    return [_line(kinds, why, parts) for (kinds, why, _), parts in merged.items()]


def _line(kinds: Sequence[str], why: str, parts: list[list[tuple[Asked, Advice | None]]]) -> Told:
    sites = [members[0][0].site for members in parts]
    names = tuple(own.name for members in parts for own, _ in members)
    because = f" ({why.format('they' if len(sites) > 1 else 'it', 's' * (len(sites) == 1))})" if why else ""
    free = _of_case(parts[0][0][0])
    advice = [members[0][1] for members in parts if members[0][1]]
    own = "No simple motion shows it: the fit leaves it as the case has it." if free else ""
    at = "" if sites[0] in (ALL, WORLD) else f" {'of' if free else 'at'} {_listed(sites)}"
    what = f"{_listed(kinds)}{at}{because}"
    return Told(UNSEEN, names, what, f"{_move(advice)}." if advice else own)


def _move(advice: Sequence[Advice]) -> str:
    """A sentence without its end; of several motions, the same for several joints."""
    joints, (first, *_) = list(dict.fromkeys(own.joint for own in advice if own.joint)), advice
    if first.motion is None:
        return "The same motions for twice as long would do"
    if not joints:
        return first.how[:1].upper() + first.how[1:]
    return f"Move {_listed(joints)}{', each' if len(joints) > 1 else ''} alone, {first.how}"


def _why(own: Asked, sight: Sight | None) -> str:
    """Why it is not seen, with places for a pronoun and an ending."""
    if sight is None:
        return ""
    dofs = _dofs(own.site, sight)
    return "{0} never move{1}" if len(dofs) and sight.still[dofs].all() else ""


def _dofs(site: str, sight: Sight) -> np.ndarray:
    """Degrees of freedom of a joint, of a motor's joint, or of what carries a body."""
    model, find = sight.motion.model, mujoco.mj_name2id
    joint, motor = find(model, mujoco.mjtObj.mjOBJ_JOINT, site), find(model, mujoco.mjtObj.mjOBJ_ACTUATOR, site)
    if joint < 0 <= motor and model.actuator_trntype[motor] == mujoco.mjtTrn.mjTRN_JOINT:
        joint = int(model.actuator_trnid[motor, 0])
    if joint >= 0:
        return np.flatnonzero(model.dof_jntid == joint)
    body, carrying = find(model, mujoco.mjtObj.mjOBJ_BODY, site), []
    while body > 0:
        carrying.append(body)
        body = int(model.body_parentid[body])
    return np.flatnonzero(np.isin(model.dof_bodyid, carrying))


def title(own: Asked) -> str:
    """What it is, without its place."""
    named = FREED if _of_case(own) else TITLES
    return named.get(own.kind, own.kind.replace("_", " "))


def in_words(own: Asked) -> str:
    """``mass of link (free)``, ``viscous friction at wrist``; ``(found)`` is what a diagnosis put into the model."""
    if _of_case(own):
        return f"{title(own)} of {own.site} (free)"
    at = "" if own.site in (ALL, WORLD) else f" at {own.site}"
    return f"{title(own)}{at}{' (found)' if own.free else ''}"


def _of_case(own: Asked) -> bool:
    """Whether the case frees it: what else is fitted anyway is an effect that was found."""
    return own.free and own.kind in FIELDS


def _listed(names: Iterable[str], joint: str = "and") -> str:
    names = list(dict.fromkeys(names))
    if len(names) > NAMES:
        names = [*names[: NAMES - 1], f"{len(names) - NAMES + 1} more"]
    return ", ".join(names[:-1]) + f" {joint} {names[-1]}" if len(names) > 1 else names[0]
