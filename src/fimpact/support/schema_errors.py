"""What a JSON schema found wrong, in one line that names the key, the value, and what is allowed there."""

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any

from jsonschema import ValidationError

Complaint = Any  # a ValidationError that was raised: its stubs say of every field that it may be unset

MOST = 1000  # letters of a name, and names, beyond which the nearest takes long to find
NAMES = {"integer": "a whole number", "number": "a number", "string": "text", "array": "a list", "object": "a table"}


def most_telling(errors: Iterable[ValidationError]) -> ValidationError | None:
    """The error to report: a key that does not exist before a value that is wrong, the outermost first."""
    return min(errors, key=lambda error: (error.validator not in UNKNOWN_KEY, len(error.absolute_path)), default=None)


def in_words(error: Complaint) -> str:
    """One line about `error`."""
    return SPECIAL.get(error.validator, _wrong_value)(error)


def name(path: Iterable[str | int]) -> str:
    """A key as one would say it: systems.arm.noise, select.seeds[3]."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).lstrip(".")


def among(allowed: Sequence, got: object) -> str:
    """The list of what is allowed, with the nearest to what was given."""
    near = get_close_matches(str(got)[:MOST], [str(value) for value in allowed[:MOST]], 1)
    return f"allowed: {', '.join(map(str, allowed))}" + (f"; did you mean '{near[0]}'?" if near else "")


def _unknown_key(error: Complaint) -> str:
    allowed = list(error.schema["properties"])
    key = next(key for key in error.instance if key not in allowed)
    return f"{name([*error.absolute_path, key])} is not a key; {among(allowed, key)}"


def _unknown_name(error: Complaint) -> str:
    return (
        f"{name([*error.absolute_path, error.instance])} is not known; {among(error.validator_value, error.instance)}"
    )


def _unknown_value(error: Complaint) -> str:
    return f"{name(error.absolute_path)} is {error.instance!r}; {among(error.validator_value, error.instance)}"


def _missing_key(error: Complaint) -> str:
    key = next(key for key in error.validator_value if key not in error.instance)
    return f"{name([*error.absolute_path, key])} is missing; add it"


def _wrong_value(error: Complaint) -> str:
    return f"{name(error.absolute_path) or 'the file'} is {error.instance!r}; it must be {_wanted(error)}"


def _wanted(error: Complaint) -> str:
    limit = error.validator_value
    wanted = {
        "type": lambda: NAMES[limit] + _scientific(error.instance),
        "minimum": lambda: f"at least {limit}",
        "exclusiveMinimum": lambda: f"greater than {limit}",
        "maximum": lambda: f"at most {limit}",
        "minItems": lambda: "a list with at least one entry",
        "minProperties": lambda: "a table with at least one entry",
        "uniqueItems": lambda: "a list in which nothing is repeated",
    }
    return error.schema.get("description") or wanted[error.validator]()


def _scientific(value: object) -> str:
    # YAML 1.1 reads 1e-3 as text.
    try:
        return f": write {float(value)!r}" if isinstance(value, str) else ""
    except ValueError:
        return ""


SPECIAL = {
    "additionalProperties": _unknown_key,
    "required": _missing_key,
    "enum": lambda error: _unknown_name(error) if "propertyNames" in error.schema_path else _unknown_value(error),
}
UNKNOWN_KEY = ("additionalProperties", "propertyNames")
