"""Tables as text: CSV as people and programs write it, and JSON lines."""

import csv as rows
import re
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from fimpact.cases.errors import CaseError, summarise_exception
from fimpact.cases.readers.arrow_tables import arrow
from fimpact.cases.readers.columns import Table

COMMENTS = ("#", "%", "//")
LOOKED_AT = 1000  # lines among which the names of the columns are


@dataclass(frozen=True)
class Layout:
    """How a CSV is laid out: what parts its cells, its columns' names and units, and the lines before its numbers."""

    delimiter: str
    names: list[str]
    units: dict[str, str]
    skipped: int


def csv(path: Path) -> Table:
    """Columns of a CSV of any delimiter, with comment lines or none and with a row of units or none.

    Raises:
        CaseError: it is empty, has no line of names, or lines with more or fewer cells.
    """
    with open(path, encoding="utf-8-sig", newline=None) as file:
        layout = _layout(list(islice(file, LOOKED_AT)), path)
    from pyarrow import csv

    # Blank is "no sample"; the text nan stays a number that is not one, and is judged later.
    convert = csv.ConvertOptions(null_values=[""], strings_can_be_null=True)
    cells = csv.ParseOptions(delimiter=layout.delimiter.replace(" ", ","))
    read = csv.ReadOptions(skip_rows=layout.skipped, column_names=layout.names)
    try:
        table = csv.read_csv(_plain(path, layout), read, cells, convert)
    except Exception as error:
        raise CaseError(
            f"data file {path}: {summarise_exception(error)}; every line must have as many cells as the first; "
            "the file may be truncated: complete it or remove the broken line"
        ) from None
    return arrow(table, path, layout.units)


def json_lines(path: Path) -> Table:
    """Columns of a file with one JSON object in each line; of objects within it, ``outer.inner``."""
    from pyarrow import json

    return arrow(json.read_json(path), path)


def _plain(path: Path, layout: Layout):
    """The file, or its text without comments below the names and with commas for blanks, which Arrow cannot read."""
    import pyarrow as pa

    marks = "|".join(map(re.escape, COMMENTS)).encode()
    text = path.read_bytes()
    if layout.delimiter != " " and not re.search(rb"\n\s*(?:" + marks + rb")", text):
        return pa.BufferReader(text)
    lines = text.splitlines()
    below = [line for line in lines[layout.skipped :] if not re.match(rb"\s*(?:" + marks + rb")", line)]
    if layout.delimiter == " ":
        below = [re.sub(rb"[ \t]+", b",", line.strip()) for line in below]
    return pa.BufferReader(b"\n".join([b""] * layout.skipped + below))


def _layout(lines: list[str], path: Path) -> Layout:
    told = [index for index, line in enumerate(lines) if line.strip() and not _comment(line)]
    if not told:
        raise CaseError(f"data file {path} is empty; its first line must name the columns; write it again")
    first, numbers = told[0], next((index for index in told[1:]), None)
    delimiter = _delimiter(lines[first], lines[numbers] if numbers is not None else "")
    names, skipped = _cells(lines[first], delimiter), first + 1
    if all(map(_number, names)) and names != [str(index) for index in range(len(names))]:
        names, skipped = _commented(lines[:first], delimiter, names, path), first
        return Layout(delimiter, names, {}, skipped)
    if numbers is None:
        return Layout(delimiter, names, {}, skipped)
    units = _cells(lines[numbers], delimiter)
    following = _cells(lines[told[2]], delimiter) if len(told) > 2 else []
    if len(units) != len(names) or any(map(_number, units)) or not any(map(_number, following)):
        return Layout(delimiter, names, {}, skipped)
    plain = [re.sub(r"^[\[(]|[\])]$", "", unit.strip()) for unit in units]
    return Layout(delimiter, names, dict(zip(names, plain, strict=True)), numbers + 1)


def _commented(before: list[str], delimiter: str, numbers: list[str], path: Path) -> list[str]:
    """Names in the last comment above the numbers, where NumPy writes them."""
    for line in reversed(before):
        names = _cells(line.strip().lstrip("#%/ "), delimiter) if _comment(line) else []
        if len(names) == len(numbers) and not any(map(_number, names)):
            return names
    raise CaseError(
        f"data file {path} begins with the numbers {', '.join(numbers[:3])}; its first line must name the columns, one "
        f"for each of {len(numbers)}; add it"
    )


def _comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def _delimiter(header: str, following: str) -> str:
    found = max(",;\t", key=header.count)
    columns = len(header.split())
    if found not in header and columns > 1 and columns == len(following.split()):
        return " "
    return found


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    return [cell.strip() for cell in next(rows.reader([line.rstrip("\r\n")], delimiter=delimiter), [])]


def _number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
