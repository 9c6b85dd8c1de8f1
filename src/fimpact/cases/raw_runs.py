"""Runs of a case as they stand in their files: rows and columns, before any conversion."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from fimpact.cases.errors import CaseError, listed
from fimpact.cases.readers.columns import Column, Table
from fimpact.cases.readers.files import read_table


@dataclass(frozen=True)
class Source:
    """Columns of one run before any conversion."""

    name: str
    table: Table
    held_out: bool
    files: tuple[Path, ...]
    start: float
    stop: float
    state: dict

    @property
    def where(self) -> str:
        """How messages name it."""
        return f"run '{self.name}' ({', '.join(file.name for file in self.files)})"


def sources(case: dict, root: Path, tables: Mapping[Path, Table] | None = None) -> list[Source]:
    """Every run of a case; globs of arrays and `split` give several for one entry.

    Args:
        tables: of files that need not be read, by path; None: all are read.

    Raises:
        CaseError: a file that cannot be read, a selection without rows, or two runs of one name.
    """
    files: dict[Path, Table] = dict(tables or {})
    out = [run for entry in case["runs"] for run in _entry_sources(entry, root, files)]
    names = [run.name for run in out]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise CaseError(f"two runs are named '{twice[0]}'; give each entry of `runs` a `name` of its own")
    return out


def file_paths(entry: dict, root: Path) -> list[Path]:
    """Data files of an entry of `runs`."""
    return [root / file for file in ([entry["file"]] if isinstance(entry["file"], str) else entry["file"])]


def _entry_sources(entry: dict, root: Path, files: dict[Path, Table]) -> Iterator[Source]:
    paths = file_paths(entry, root)
    for path in paths:
        if path not in files:
            files[path] = read_table(path)
    table, name = _joined({path: files[path] for path in paths}), entry.get("name", paths[0].stem)
    for label, part in _parts(entry, table, f"run '{name}' ({paths[0].name})"):
        full = label if entry.get("array") and "name" not in entry else " ".join(filter(None, (name, label)))
        span = float(entry.get("start", 0.0)), float(entry.get("stop", np.inf))
        part = _renamed(part, entry.get("columns", {}), f"run '{full}'")
        yield Source(full, part, entry.get("held_out", False), tuple(paths), *span, entry.get("state", {}))


def _joined(tables: dict[Path, Table]) -> Table:
    """Columns of all files. A group that several have (files of one name, parts of a bag) is told apart by the path."""
    groups = {path: {column.group for column in table} for path, table in tables.items()}
    return [
        replace(column, group=f"{path} {column.group}") if _elsewhere(column.group, path, groups) else column
        for path, table in tables.items()
        for column in table
    ]


def _elsewhere(group: str, path: Path, groups: dict[Path, set[str]]) -> bool:
    return any(group in other for there, other in groups.items() if there != path)


def _parts(entry: dict, table: Table, where: str) -> Iterator[tuple[str, Table]]:
    if "array" in entry:
        yield from _arrays(entry["array"], table, where)
        return
    for key, wanted in entry.get("select", {}).items():
        table = _rows(table, key, wanted if isinstance(wanted, list) else [wanted], where)
    if "split" not in entry:
        yield "", table
        return
    by = find(table, entry["split"], where)
    for value in _present(by):
        label = f"{value:.15g}" if isinstance(value, float) else str(value)
        yield label, _rows(table, entry["split"], [value], where)


def _arrays(pattern: str, table: Table, where: str) -> Iterator[tuple[str, Table]]:
    parts: dict[str, Table] = {}
    for column in table:
        parts.setdefault(column.name.partition("[")[0], []).append(column)
    matching = {name: part for name, part in parts.items() if fnmatchcase(name, pattern)}
    if not matching:
        raise CaseError(f"{where}: no array is named like '{pattern}'; {listed(parts, pattern)}; correct `array`")
    for name, part in matching.items():
        yield name, [replace(column, name=column.name[len(name) :], group=name) for column in part]


def _rows(table: Table, key: str, wanted: list, where: str) -> Table:
    by = find(table, key, where)
    rows = np.isin(by.values.astype(str), [str(value) for value in wanted]) & ~by.absent
    if by.values.dtype.kind == "f":
        rows = np.isin(by.values, [float(value) for value in wanted if is_number(value)])
    if not rows.any():
        listing = listed(_present(by), wanted[0])
        raise CaseError(f"{where}: no row has {key} = {wanted[0]!r}; {listing}; correct `select`")
    return [
        column.take(rows) if column.group == by.group and len(column.values) == len(rows) else column
        for column in table
    ]


def _present(column: Column) -> list:
    """Each value that a column has, once."""
    known = column.values[~column.absent].tolist()
    return [value for value in dict.fromkeys(known) if value == value]


def is_number(value: Any) -> bool:
    """Whether a value, or a text, is a finite number."""
    try:
        return bool(np.isfinite(float(value)))
    except (TypeError, ValueError):
        return False


def _renamed(table: Table, names: dict, where: str) -> Table:
    given = [replace(find(table, column, where), name=name) for name, column in names.items()]
    return [column for column in table if column.name not in names] + given


def find(table: Table, name: str | int, where: str, group: str | None = None) -> Column:
    """The column of a name (an index: of the only array), of one group where it has a column of that name.

    Raises:
        CaseError: there is none, or more than one.
    """
    name = f"[{name}]" if isinstance(name, int) else name
    found = [column for column in table if name in (column.name, f"{column.group}:{column.name}")]
    found = [column for column in found if column.group == group] or found
    if not found:
        names = [column.name for column in table]
        raise CaseError(f"{where}: there is no column '{name}'; {listed(dict.fromkeys(names), name)}; correct it")
    if len(found) > 1:
        names = [f"{column.group}:{column.name}" for column in found]
        raise CaseError(f"{where}: column '{name}' is there {len(found)} times; write one of {', '.join(names[:6])}")
    return found[0]
