"""A first case from an MJCF and its logs: what each column is, its unit, and which runs are held out."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from fimpact.cases.drafting.column_names import OPEN, unit, words
from fimpact.cases.drafting.draft import DraftCase
from fimpact.cases.drafting.entries import write_entries
from fimpact.cases.drafting.evidence import CLOCKS, time_unit
from fimpact.cases.drafting.matching import matches
from fimpact.cases.errors import CaseError
from fimpact.cases.models.naive import read_model
from fimpact.cases.readers.columns import Column, Table
from fimpact.cases.readers.files import read_table
from fimpact.cases.readers.ros import UNREAD

TIMES = {"t", "time", "times", "stamp", "timestamp", "sec", "seconds"}
RUNS = {"episode", "episodes", "run", "runs", "trial", "trials", "toss", "drop", "rep", "experiment", "segment"}
HELD_OUT = 0.3  # share of a log that is held out


def draft_case(model: Path, logs: list[Path], out: Path) -> DraftCase:
    """A case for `logs`, with paths relative to the folder of `out`. The last of several is held out; of one, the last
    of its runs, or its end.

    Raises:
        CaseError: a file cannot be read, or no column belongs to anything in the MJCF.
    """
    naive, everything = read_model(model), read_table(logs[0])
    table = [column for column in everything if column.values.dtype.kind == "f" and len(column.values) > 1]
    time, rest = _times(table)
    first = DraftCase({"model": _relative(model, out)})
    first.case["time"] = _time(time, rest, first)
    by = _split(everything, time) if time else None
    apart = {id(column) for column in (time, rest, by)} | {id(column) for column in table if column.clock}
    found = matches(naive, [column for column in table if id(column) not in apart])
    first.case["runs"] = _runs([_relative(log, out) for log in logs], time, by, first)
    write_entries(naive, table, found, first)
    if not first.case["measurements"]:
        names = ", ".join(column.name for column in table) or f"none with numbers{_texts(everything)}"
        raise CaseError(f"no column of {logs[0]} names a joint or sensor of {model}; its columns: {names}; rename them")
    unread = [f"{one.group} ({one.values[0]})" for one in everything if one.name == UNREAD]
    first.taken += [f"topics that are not read: {', '.join(unread)}"] if unread else []
    first.case |= {"unknowns": [], "window": 0.5}
    first.taken.append("unknowns: none; list {field, site, sd} of what the MJCF only guesses, such as a mass")
    return first


def _texts(table: Table) -> str:
    """What stands in place of numbers, such as decimal commas."""
    texts = [c for c in table if c.values.dtype.kind != "f" and len(c.values)]
    return f", but text such as '{texts[-1].values[0]}' in '{texts[-1].name}'; write decimal points" if texts else ""


def _relative(path: Path, out: Path) -> str:
    try:
        return path.resolve().relative_to(out.resolve().parent).as_posix()
    except ValueError:
        return path.resolve().as_posix()


def _times(table: Table) -> tuple[Column | None, Column | None]:
    """The column of time, and that of its fractions of a second, if there is one."""
    named = [column for column in table if words(column.name) & TIMES and not words(column.name) & {"nanosec", "nsecs"}]
    going = [column for column in named if np.mean(np.diff(column.values) > 0) > 0.5]
    time = next(iter([*going, *named]), None)
    # A column of whole seconds does not go on at every sample.
    for one in named:
        for rest in table:
            if rest.name in _rests(one.name) and rest.group == one.group:
                return one, rest
    return time, None


def _rests(name: str) -> list[str]:
    """Names that the column of fractions has beside one of whole seconds, in ROS 2 and 1."""
    found = re.fullmatch("(.*?)(secs?|)", name)
    stem, whole = found.groups() if found else (name, "")
    return [stem + rest for rest in ("nanosec", "nsecs")] if whole else []


def _time(time: Column | None, rest: Column | None, first: DraftCase) -> dict:
    if time is None:
        first.open.append("time: no column looks like a time; give its column and unit, or `rate:` in Hz")
        return {"column": OPEN, "unit": OPEN}
    if rest:
        return {"column": time.name, "unit": "s", "fraction": {"column": rest.name, "unit": "ns"}}
    if time.clock:
        return {"column": time.name, "unit": "s"}
    told = [text for text in (time.unit, unit(time.name)) if text in CLOCKS]
    found, why = (told[0], "") if told else time_unit(time.values)
    if found == OPEN:
        first.open.append(f"time.unit: the unit of '{time.name}': {why}")
    elif why:
        first.taken.append(f"time.unit: '{time.name}' is in {found}, for {why}")
    return {"column": time.name, "unit": found}


def _split(table: Table, time: Column) -> Column | None:
    """The column that numbers or names the runs of a log, one below the other."""
    for column in table:
        if column.group != time.group or not words(column.name) & RUNS or column.absent.any():
            continue
        changes = np.count_nonzero(column.values[1:] != column.values[:-1])
        distinct = len(set(column.values.tolist()))
        if 2 <= distinct == changes + 1 <= len(column.values) / 8:
            return column
    return None


def _runs(files: list[str], time: Column | None, by: Column | None, first: DraftCase) -> list[dict]:
    split = {"split": by.name} if by else {}
    if len(files) > 1:
        return [{"file": file, **split} for file in files[:-1]] + [{"file": files[-1], **split, "held_out": True}]
    if by:
        values = [_plain(value) for value in dict.fromkeys(by.values.tolist())]
        held = max(1, round(HELD_OUT * len(values)))
        first.taken.append(f"runs: the last {held} of {len(values)} of '{by.name}' are held out")
        parts = [(values[:-held], {}), (values[-held:], {"held_out": True})]
        return [{"file": files[0], "select": {by.name: some}, **split, **keys} for some, keys in parts]
    return _cut(files[0], time, first)


def _plain(value: float | str) -> int | float | str:
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _cut(file: str, time: Column | None, first: DraftCase) -> list[dict]:
    """The two parts of a log of one run."""
    cut: Any = OPEN
    scale = CLOCKS.get(first.case["time"]["unit"])
    if time is None or scale is None:
        first.open.append("runs: stop of the one and start of the other, s after the first sample: about 70 % of it")
    else:
        span_ = float(np.nanmax(time.values) - np.nanmin(time.values))
        cut = round((1 - HELD_OUT) * span_ * scale, 3) or 1.0
    first.taken.append("runs: the end of this log is held out; a recording of its own judges better, so replace it")
    judge = {"name": "judge", "file": file, "start": cut if cut == OPEN else round(cut + 1e-3, 3), "held_out": True}
    return [{"name": "fit", "file": file, "stop": cut}, judge]
