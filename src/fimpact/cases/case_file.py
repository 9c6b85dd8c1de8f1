"""The case file itself: YAML, what it extends, and its schema."""

from collections.abc import Mapping
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jsonschema import Draft202012Validator

from fimpact.cases.errors import CaseError, summarise_exception
from fimpact.support.schema_errors import in_words, most_telling, name

SCHEMA = Path(__file__).with_name("schema.yaml")
MAX_VALUES = 100_000  # values of a case
LARGEST = 1e15  # of any number in a case


class _Loader(yaml.SafeLoader):
    """Safe YAML in which a key that is given twice is an error, not a silent replacement."""


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict:
    keys = [key.value if isinstance(key, yaml.ScalarNode) else str(key) for key, _ in node.value]
    twice = [key for index, key in enumerate(keys) if key in keys[:index] and key != "<<"]
    if twice:
        raise yaml.YAMLError(f"the key '{twice[0]}' is given twice in line {node.start_mark.line + 1}")
    loader.flatten_mapping(node)
    return {str(key): value for key, value in loader.construct_mapping(node, deep=True).items()}


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


@cache
def _schema() -> dict:
    return yaml.safe_load(SCHEMA.read_text(encoding="utf-8"))


def load(path: Path) -> dict:
    """The tables of a case, with `extends` resolved and paths made absolute, checked against the schema.

    Raises:
        CaseError: not a file, not YAML, or a key or value that the schema does not allow.
    """
    return _checked(_read(Path(path), ()), str(path))


def load_mapping(case: Mapping, folder: Path) -> dict:
    """The tables of a case that is written in Python, with relative paths counted from `folder`, as `load` has them.

    Raises:
        CaseError: a key or value that the schema does not allow.
    """
    plain = _plain(case)
    if _entries(plain) > MAX_VALUES:
        raise CaseError(f"the case has more than {MAX_VALUES} entries; leave out what it does not need")
    return _checked(_extended(_anchored(plain, folder), folder / "case", ()), "the case")


def _plain(value: object) -> Any:
    """Paths as text, tuples as lists, numbers of NumPy as Python's: what YAML would have given."""
    if isinstance(value, Mapping):
        return {str(key): _plain(own) for key, own in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(own) for own in value]
    if isinstance(value, np.generic):
        return value.item()
    return str(value) if isinstance(value, Path) else value


def _checked(case: dict, where: str) -> dict:
    error = most_telling(Draft202012Validator(_schema()).iter_errors(case))
    complaint = in_words(error) if error else _not_finite(case) or _not_printable(case)
    if complaint:
        raise CaseError(f"{where}: {complaint} (all keys: `fimpact keys`)")
    return case


def bases(path: Path) -> list[Path]:
    """The cases that a valid case extends, nearest first."""
    case = yaml.load(path.read_text(encoding="utf-8"), _Loader)
    if not isinstance(case.get("extends"), str):
        return []
    base = path.parent / case["extends"]
    return [base, *bases(base)]


def _read(path: Path, seen: tuple[Path, ...]) -> dict:
    if not path.is_file():
        raise CaseError(f"case {path} does not exist; correct the path, or write one with `fimpact init`")
    if path.resolve() in seen:
        raise CaseError(f"{path}: `extends` comes back to this file; remove it from one of them")
    try:
        case = yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except OSError:
        raise
    except Exception as error:
        raise CaseError(f"{path} is not YAML: {summarise_exception(error)}; correct it") from None
    if _entries(case) > MAX_VALUES:
        raise CaseError(
            f"{path} has more than {MAX_VALUES} entries once its aliases are unfolded; write it without them"
        )
    if not isinstance(case, dict):
        raise CaseError(f"{path} is not a table of keys; `fimpact keys` shows an example")
    return _extended(_anchored(case, path.parent), path, seen)


def _entries(value: object) -> int:
    """How many values are nested in `value`, counted up to a little beyond `MAX_VALUES`."""
    left, count = [value], 0
    while left and count <= MAX_VALUES:
        part, count = left.pop(), count + 1
        left += part.values() if isinstance(part, dict) else part if isinstance(part, list) else ()
    return count


def _extended(case: dict, path: Path, seen: tuple[Path, ...]) -> dict:
    if not isinstance(case.get("extends"), str):
        return case
    base = _read(path.parent / case["extends"], (*seen, path.resolve()))
    if "runs" in base and "runs" not in case:  # its files are where its own folder is
        base = {"data": str((path.parent / case["extends"]).parent)} | base
    return _merged(base, {key: value for key, value in case.items() if key != "extends"})


def _anchored(case: dict, folder: Path) -> dict:
    paths = {key: str(folder / case[key]) for key in ("model", "data") if isinstance(case.get(key), str)}
    return case | paths


def _merged(base: dict, over: dict) -> dict:
    both = {key: _merged(base[key], over[key]) for key in over if _tables(base.get(key), over[key])}
    return base | over | both


def _tables(one: object, other: object) -> bool:
    return isinstance(one, dict) and isinstance(other, dict)


def _not_printable(table: object) -> str | None:
    """A key or a text that no terminal should be sent."""
    if isinstance(table, dict | list):
        parts = table.items() if isinstance(table, dict) else enumerate(table)
        return next((c for part, value in parts if (c := _not_printable(part) or _not_printable(value))), None)
    if isinstance(table, str) and not table.isprintable():
        return f"{table!a} has a character that cannot be printed; allowed: letters, digits and signs; rename it"
    return None


def _not_finite(table: dict | list, path: tuple = ()) -> str | None:
    """A number that is none, or that no case has."""
    for part, value in table.items() if isinstance(table, dict) else enumerate(table):
        if part == "select":  # any value of a column
            continue
        if isinstance(value, dict | list) and (complaint := _not_finite(value, (*path, part))):
            return complaint
        if isinstance(value, float) and not isfinite(value):
            return f"{name((*path, part))} is {value}; it must be a finite number"
        if isinstance(value, int | float) and value and not 1 / LARGEST <= abs(value) <= LARGEST:
            got = f"{value:g}" if isinstance(value, float) else f"a number of {len(str(abs(value)))} digits"
            return f"{name((*path, part))} is {got}; it must be 0, or between {1 / LARGEST:g} and {LARGEST:g} in size"
    return None
