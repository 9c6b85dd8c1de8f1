"""In words: what motions do not show, grouped by place and kind, and the simplest motion that would."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.effects.classes import TITLES
from fimpact.identifiability.judging import Asked, Judged
from fimpact.identifiability.motions import Advice, Advisor
from fimpact.identifiability.sight import Sight

MOST, NAMES = 6, 4  # lines, and names in one of them
FREED = {"com_x": "centre of mass (x)", "com_y": "centre of mass (y)", "com_z": "centre of mass (z)"}
FREED |= {"armature": "rotor inertia", "frictionloss": "dry friction"}


@dataclass(frozen=True)
class Told:
    """One line. names: ``effect@site`` or ``field@site``; apart: whether they are seen but pass for one another, else
    they are not seen; what: in words; motion: a sentence, or "" where nothing simple helps."""

    names: tuple[str, ...]
    apart: bool
    what: str
    motion: str


def told(judged: Judged, asked: Sequence[Asked], sight: Sight | None) -> list[Told]:
    """What is to be said, at most `MOST` lines, what the case frees and what is suspected first before the rest.

    Args:
        sight: of the same recording, which knows what motions would do; None: no motion is named.
    """
    known = {own.name: own for own in asked}
    advisor = Advisor(sight, [*judged.unseen, *(n for group in judged.alike for n in group)]) if sight else None
    lines = [_group(names, known, advisor) for names in judged.alike]
    return _first(_unseen(judged, known, sight, advisor), known) + _first(lines, known)


def _first(lines: list[Told], known: dict[str, Asked]) -> list[Told]:
    """The first half of all lines that may be said."""
    return sorted(lines, key=lambda own: min(known[name].order for name in own.names))[: MOST // 2]


def _group(names: Sequence[str], known: dict[str, Asked], advisor: Advisor | None) -> Told:
    what = _listed([in_words(known[name]) for name in names])
    found = advisor.parts(names) if advisor else None
    if found is None:
        free = any(known[name].free for name in names)
        less = ", or give it a smaller sd" if free else ""
        motion = f"No simple motion tells them apart: measure one of them{less}." if advisor else ""
        return Told(tuple(names), True, what, motion)
    advice, groups = found
    left = [_listed([in_words(known[name]) for name in own]) for own in groups if len(own) > 1]
    but = f"; what stays one: {', or '.join(left)}" if left else ""
    return Told(tuple(names), True, what, f"{_move([advice])}{but}.")


def _unseen(judged: Judged, known: dict[str, Asked], sight: Sight | None, advisor: Advisor | None) -> list[Told]:
    """Unseen ones by place and motion; what no motion shows is told of the case's own parameters only."""
    rows: dict[tuple[str, str, str], list[tuple[Asked, Advice | None]]] = {}
    for name in judged.unseen:
        own, advice = known[name], advisor.shows(name) if advisor else None
        if advice or own.free or not advisor:
            how = (advice.how, bool(advice.joint)) if advice else ("", False)
            rows.setdefault((own.site, _why(own, sight), str(how)), []).append((own, advice))
    merged: dict[tuple, list[list[tuple[Asked, Advice | None]]]] = {}
    for (_, why, how), members in rows.items():
        merged.setdefault((tuple(title(own) for own, _ in members), why, how), []).append(members)
    return [_line(kinds, why, parts) for (kinds, why, _), parts in merged.items()]


def _line(kinds: Sequence[str], why: str, parts: list[list[tuple[Asked, Advice | None]]]) -> Told:
    sites = [members[0][0].site for members in parts]
    names = tuple(own.name for members in parts for own, _ in members)
    because = f" ({why.format('they' if len(sites) > 1 else 'it', 's' * (len(sites) == 1))})" if why else ""
    free = parts[0][0][0].free
    advice = [members[0][1] for members in parts if members[0][1]]
    own = "No simple motion shows it: leave it out of `unknowns`, or measure it." if free else ""
    what = f"{_listed(kinds)} {'of' if free else 'at'} {_listed(sites)}{because}"
    return Told(names, False, what, f"{_move(advice)}." if advice else own)


def _move(advice: Sequence[Advice]) -> str:
    joints = list(dict.fromkeys(own.joint for own in advice if own.joint))
    if not joints:
        return _upper(advice[0].how) if advice[0].how.startswith("let") else f"Move {_together(advice[0].how)}"
    return f"Move {_listed(joints)}{', each' if len(joints) > 1 else ''} alone, {advice[0].how}"


def _together(how: str) -> str:
    return how if how.startswith("all") else f"as before, once more {how}"


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
    named = FREED if own.free else TITLES
    return named.get(own.kind, own.kind.replace("_", " "))


def in_words(own: Asked) -> str:
    """``mass of link (free)``, ``viscous friction at wrist``."""
    return f"{title(own)} of {own.site} (free)" if own.free else f"{title(own)} at {own.site}"


def _listed(names: Iterable[str]) -> str:
    names = list(dict.fromkeys(names))
    if len(names) > NAMES:
        names = [*names[: NAMES - 1], f"{len(names) - NAMES + 1} more"]
    return ", ".join(names[:-1]) + f" and {names[-1]}" if len(names) > 1 else names[0]


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]
