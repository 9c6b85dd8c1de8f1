"""Commands and measurements of a first case: the unit of each, where its column or its values tell it."""

import numpy as np

from fimpact.cases.drafting.column_names import OPEN, best, unit, words
from fimpact.cases.drafting.draft import Asked, DraftCase, some
from fimpact.cases.drafting.evidence import OTHER, alike, may_be_share, position_unit, share_unit
from fimpact.cases.drafting.matching import NAME, Match, Matches
from fimpact.cases.drafting.roles import KNOWN
from fimpact.cases.models.naive import Naive
from fimpact.cases.readers.columns import SI, Column, Table
from fimpact.cases.units import same_dimension

POOLS = {"rad": "angle", "m": "length", "rad/s": "speed", "m/s": "linear_speed", "N m": "torque", "N": "force"}
GRIPPERS = {"gripper", "jaw", "grip"}
PARTS = ("commands", "measurements")


def write_entries(naive: Naive, table: Table, found: Matches, first: DraftCase) -> None:
    """Put commands and measurements into a first case, and say what is open or was concluded.

    Args:
        table: every column of the log, its times among them.
    """
    units = _units(naive, found, first)
    for part in PARTS:
        entries = {key: _entry(match, units[part, key]) for key, match in getattr(found, part).items()}
        for key, entry in entries.items():
            if entry["unit"] == "counts" and part == "measurements":
                first.open.append(f"measurements.{key}.counts_per_rev: the counts of one revolution")
        if entries or part == "measurements":
            first.case[part] = entries
    _say_commands(found, first)
    _say_how(found, first)
    _say_alike(naive, table, found, first)
    _say_left(naive, found, first)


def named(column: Column) -> str:
    """The name of a column as a case writes it, with its topic where it has one."""
    return f"{column.group}:{column.name}" if column.group.startswith("/") else column.name


def _entry(match: Match, found: str) -> dict:
    columns = [named(column) for column in match.columns]
    entry = {"column": columns[0]} if len(columns) == 1 else {"columns": columns}
    return match.place | entry | {"unit": found}


def _told(match: Match) -> str:
    """The unit that the columns of an entry tell, if the MJCF's quantity can have it."""
    column, wanted = match.columns[0], match.wanted
    if wanted == "1" or (column.unit == SI and wanted):
        return wanted
    drive = "meaning" in match.place  # a `gain` converts what has another dimension
    for text in (column.unit, unit(column.name)):
        if text not in ("", SI, OPEN) and (drive or not wanted or text == "counts" or same_dimension(text, wanted)):
            return text
    return OPEN


def _contradicted(match: Match) -> str:
    """A unit that the columns tell and that the MJCF's quantity cannot have, or ""."""
    told = [text for text in (match.columns[0].unit, unit(match.columns[0].name)) if text not in ("", SI, OPEN)]
    return told[0] if told else ""


def _units(naive: Naive, found: Matches, first: DraftCase) -> dict[tuple[str, str], str]:
    """Unit of each entry: told, or concluded from values, or asked for, once for all of one quantity."""
    every = {(part, key): match for part in PARTS for key, match in getattr(found, part).items()}
    out = {at: _told(match) for at, match in every.items()}
    for label, pool in _pools({at: match for at, match in every.items() if out[at] == OPEN}).items():
        for part, unit_, why, label_ in _judged(naive, label, pool):
            mark = Asked(label_) if unit_ == OPEN else unit_
            out |= dict.fromkeys(part, mark)
            listed = some([named(column) for at in part for column in pool[at].columns])
            if unit_ == OPEN:
                shared = f" (once, at &{label_})" if len(part) > 1 else ""
                first.open.append(f"the unit of {listed}{shared}{why and ': ' + why}")
            else:
                share = " (of the joint's range in the MJCF)" if ".." in unit_ else ""
                first.taken.append(f"the unit of {listed} is {unit_}{share}, for {why}")
    if any(match.columns[0].unit == SI for match in every.values()):
        first.taken.append("units: those of ROS messages by convention, which are SI (rad, m, N m)")
    return out


def _pools(every: dict) -> dict[str, dict]:
    """Entries that have one unit: positions of joints, and other columns that say the same, by a label of each pool."""
    groups: dict[tuple, dict] = {}
    for at, match in every.items():
        said = frozenset(words(match.columns[0].name) & KNOWN)
        if match.joint or _contradicted(match):
            said = frozenset([_contradicted(match)])
        groups.setdefault((POOLS.get(match.wanted or "", "unit"), said), {})[at] = match
    labels = [label for label, _ in groups]
    numbers = [labels[:index].count(label) for index, label in enumerate(labels)]
    return {
        f"{label}{number or ''}": pool for label, number, pool in zip(labels, numbers, groups.values(), strict=True)
    }


def _judged(naive: Naive, label: str, pool: dict) -> list[tuple[list, str, str, str]]:
    """Entries of one unit with that unit, or `OPEN`, why, and the label of what is asked for."""
    one = next(iter(pool.values()))
    if _contradicted(one):
        return [(list(pool), OPEN, f"{_contradicted(one)}, as the file says, is no unit of {one.wanted}", label)]
    if not (one.joint and one.wanted in OTHER):
        return [(list(pool), OPEN, "", label)]
    grippers = [at for at, match in pool.items() if words(match.columns[0].name) & GRIPPERS]
    hands = grippers if all(may_be_share(pool[at].columns[0].values) for at in grippers) else []
    rest = [at for at in pool if at not in hands]
    parts = _position_parts(naive, label, pool, rest or hands)
    if not rest or not hands:
        return parts
    # A gripper's share of its stroke is often 0..100 where the other joints are in degrees or -100..100.
    both = _position(naive, pool, rest + hands)
    if len(parts) == 1 and parts[0][1] != OPEN and both[0] == parts[0][1] == pool[rest[0]].wanted:
        return [(rest + hands, *both, label)]
    share = share_unit(_bounded(naive, pool, hands), pool[hands[0]].wanted)
    return [*parts, (hands, *share, "gripper")]


def _position_parts(naive: Naive, label: str, pool: dict, ats: list) -> list[tuple[list, str, str, str]]:
    """Positions judged together, else commands and measurements by themselves."""
    found, why = _position(naive, pool, ats)
    parts = [[at for at in ats if at[0] == part] for part in PARTS]
    if found != OPEN or not all(parts):
        return [(ats, found, why, label)]
    apart = [_position(naive, pool, part) for part in parts]
    if all(one == OPEN for one, _ in apart):
        return [(ats, OPEN, why, label)]
    return [(part, *one, label) for part, one in zip(parts, apart, strict=True)]


def _position(naive: Naive, pool: dict, ats: list) -> tuple[str, str]:
    return position_unit(_bounded(naive, pool, ats), pool[ats[0]].wanted)


def _bounded(naive: Naive, pool: dict, ats: list) -> list[tuple[np.ndarray, tuple[float, float] | None]]:
    """Values of entries, and the range of the joint of each in the MJCF."""
    out = []
    for at in ats:
        joint = naive.model.joint(pool[at].joint) if pool[at].joint else None
        limits = tuple(joint.range) if joint is not None and naive.model.jnt_limited[joint.id] else None
        out.append((pool[at].columns[0].values, limits))
    return out


def _say_commands(found: Matches, first: DraftCase) -> None:
    for key, match in found.commands.items():
        entry = first.case["commands"][key]
        if entry["meaning"] == "command":
            del entry["meaning"]
        else:
            first.taken.append(f"commands.{key}: '{entry['column']}' was measured, so it has `meaning: link`")
        if match.wanted is None:
            entry["ctrl_unit"] = entry["unit"]
        elif entry["unit"] != OPEN and not same_dimension(entry["unit"], match.wanted) and ".." not in entry["unit"]:
            first.open.append(f"commands.{key}.gain: what converts {entry['unit']} to {match.wanted}")


def _say_how(found: Matches, first: DraftCase) -> None:
    for part in PARTS:
        table = getattr(found, part)
        for how in dict.fromkeys(match.how for match in table.values() if match.how != NAME):
            keys = [key for key, match in table.items() if match.how == how]
            columns = some([named(column) for key in keys for column in table[key].columns])
            first.taken.append(f"{part}: {columns} taken for {some(keys)} {how}: check it")


def _say_alike(naive: Naive, table: Table, found: Matches, first: DraftCase) -> None:
    """Whether servos' joints move as the commands that were taken for them by number or order."""
    times = {one.group: one.values for one in table if one.name == first.case["time"]["column"]}
    told = {match.joint: (key, match) for key, match in found.commands.items() if match.joint and match.how != NAME}
    seen = {m.place.get("joint", m.joint): m for m in found.measurements.values() if m.joint}
    matched = {joint: match for joint, (_, match) in told.items()}, seen
    columns = [{joint: match.columns[0] for joint, match in part.items()} for part in matched]
    own, other = alike(
        *({j: (times[c.group], c.values) for j, c in part.items() if c.group in times} for part in columns)
    )
    for joint, better in other.items():
        key, match = told[joint]
        first.open.append(
            f"commands.{key}: '{named(match.columns[0])}' moves as '{better}' does, not as '{joint}' "
            f"(correlation {own[joint]:.2f}): give each its own column"
        )
    if own and not other:
        first.taken.append(f"commands: correlation with how their joints move: {min(own.values()):.2f} and more")


def _say_left(naive: Naive, found: Matches, first: DraftCase) -> None:
    for name in naive.names("actuator"):
        if name not in found.commands:
            first.open.append(f"commands.{name}: no column matches this actuator")
    seen = {match.joint or match.place.get("joint", "") for match in found.measurements.values()}
    bodies = {match.place["body"] for match in found.measurements.values() if "body" in match.place}
    seen |= {naive.model.joint(naive.model.body(body).jntadr[0]).name for body in bodies}
    for name in naive.names("joint"):
        if name not in seen and not any(best(key, [name]) for key in found.measurements):
            first.taken.append(f"measurements: no column matches joint '{name}'")
    if found.left:
        listed = [f"{named(column)}{_instead(naive, found, column)}" for column in found.left]
        more = f" and {len(listed) - 12} more" if len(listed) > 12 else ""
        first.taken.append(
            f"columns left out, which match nothing or the same as another: {', '.join(listed[:12])}{more}"
        )


def _instead(naive: Naive, found: Matches, column: Column) -> str:
    """What was taken in place of a column that names the same joint."""
    joint = best(column.name, naive.names("joint"))
    for match in found.measurements.values() if joint else ():
        if joint in (match.joint, match.place.get("joint")):
            return f" (as '{named(match.columns[0])}')"
    return ""
