"""Data frames as the tables of a case."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa

from fimpact.cases.errors import CaseError
from fimpact.cases.readers.arrow_tables import arrow
from fimpact.cases.readers.columns import Table

Entry = tuple[str, str] | Mapping[str, Any]  # a column and its unit, or all keys that a case allows
Frames = pd.DataFrame | Mapping[str, pd.DataFrame] | Sequence[pd.DataFrame]


def as_entry(name: str, entry: Entry) -> dict[str, Any]:
    """The table of one measurement, command or time.

    Raises:
        CaseError: it is neither a pair of texts nor a table.
    """
    if isinstance(entry, Mapping):
        return dict(entry)
    if isinstance(entry, str) or len(entry) != 2:
        raise CaseError(f"{name!r} is {entry!r}; allowed: a column and its unit such as ('q1', 'rad'), or a dict")
    column, unit = entry
    return {"column": column, "unit": unit}


def as_time(time: Entry | None) -> dict[str, Any]:
    """The table `time` of a case; empty where there is none."""
    return {} if time is None else as_entry("time", time)


def as_runs(
    frames: Frames, held_out: Collection[str | int] | None, time: Mapping[str, Any]
) -> tuple[list[dict[str, Any]], dict[Path, Table]]:
    """The runs of a case, and their tables by the path under which each is looked for.

    Args:
        held_out: names or numbers of the runs that only judge; None: the last.
        time: a case's; an index of the name of its column is taken for one.

    Raises:
        CaseError: one frame or none, something else than frames, or a held-out run that is not there.
    """
    named = _named(frames)
    names = list(named)
    if len(names) < 2:
        raise CaseError(
            "one data frame is one run, and another must judge the model; give two, or cut it in two: "
            "{'first': frame[:n], 'last': frame[n:]}"
        )
    judging = {names[-1]} if held_out is None else {_name(names, one) for one in held_out}
    runs = [{"name": name, "file": name, "held_out": name in judging} for name in names]
    return runs, {Path(name): _table(name, frame, time.get("column")) for name, frame in named.items()}


def _named(frames: Frames) -> dict[str, pd.DataFrame]:
    if isinstance(frames, pd.DataFrame):
        return {"run 0": frames}
    pairs = frames.items() if isinstance(frames, Mapping) else ((f"run {i}", one) for i, one in enumerate(frames))
    named = {str(name): frame for name, frame in pairs}
    wrong = next((name for name, frame in named.items() if not isinstance(frame, pd.DataFrame)), None)
    if wrong is not None:
        raise CaseError(f"{wrong} is a {type(named[wrong]).__name__}; allowed: data frames of pandas, one for each run")
    return named


def _name(names: list[str], one: str | int) -> str:
    name = names[one] if isinstance(one, int) and 0 <= one < len(names) else one
    if name not in names:
        raise CaseError(f"held_out names {one!r}, which is no run; allowed: {', '.join(names)}")
    return str(name)


def _table(name: str, frame: pd.DataFrame, time: str | None) -> Table:
    frame = frame.reset_index() if time is not None and time == frame.index.name else frame
    try:
        table = arrow(pa.Table.from_pandas(frame, preserve_index=False), Path(name))
    except (pa.ArrowInvalid, pa.ArrowTypeError, ValueError) as error:
        raise CaseError(f"{name} cannot be read as a table of numbers: {error}; correct the frame") from None
    return [replace(one, origin=(name, one.group, one.name)) for one in table]
