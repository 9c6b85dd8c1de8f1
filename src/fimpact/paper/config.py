"""Check a configuration before anything runs; cheap, because every `snakemake` does it: no jax is imported here."""

from collections.abc import Iterator
from itertools import pairwise
from math import isfinite
from pathlib import Path

import mujoco
import yaml
from jsonschema import Draft202012Validator

from fimpact.support.schema_check import as_numbers
from fimpact.support.schema_errors import in_words, most_telling, name

MJCF = Path(__file__).with_name("systems")
PLANAR = ("arm", "block")  # systems with rigid-body terms for contact_implicit, which does not run for others
NEEDED = ("fisher", "uniform")  # the design that is shown, and the baseline
SEARCH = ("criterion", "draws", "spread", "approach", "generations", "sigma", "gradients")
SEEN = {  # keys of `design` that a method looks at; a change of others does not rerun it
    "fisher": SEARCH,
    "contact_implicit": ("criterion", "draws", "transcription"),
    "uniform": (),
    "contact_blind": SEARCH,
    "best_of_n": tuple(key for key in SEARCH if key != "sigma"),
    "multisine": (),
}


def check(config: dict, schema: Path) -> None:
    """Check every key and value of a campaign.

    Args:
        config: all tables of the configuration, merged.
        schema: file of its JSON schema, to which the names of the systems are added here.

    Raises:
        ValueError: one line that names the first wrong key, its value, and what is allowed.
    """
    validator = Draft202012Validator(_with_systems(yaml.safe_load(schema.read_text()), config))
    as_numbers(validator, config)
    error = most_telling(validator.iter_errors(config))
    complaint = in_words(error) if error else next(_contradictions(config), None)
    if complaint:
        raise ValueError(f"configuration: {complaint} (all keys: config/README.md)")


def _with_systems(schema: dict, config: dict) -> dict:
    known, declared = sorted(path.stem for path in MJCF.glob("*.xml")), config.get("systems")
    names = {"enum": list(declared) if isinstance(declared, dict) else known}
    table = schema["properties"]
    table["systems"]["propertyNames"] = {"enum": known}
    table["select"]["properties"]["systems"]["items"] = names
    table["sweep"]["properties"]["surfaces"]["propertyNames"] = names
    return schema


def _contradictions(config: dict) -> Iterator[str]:
    """What no schema can say, because it takes two values to see it."""
    for path, number in _numbers(config):
        if not isfinite(number):
            yield f"{name(path)} is {number}; it must be a finite number"
    for system, settings in config["systems"].items():
        yield from _system(system, settings)
    eps = config["design"]["transcription"]["eps"]
    if any(after >= before for before, after in pairwise(eps)):
        yield f"design.transcription.eps is {eps}; each must be less than the one before: contact is tightened"
    for method in config["select"].get("first", {}):
        if method in NEEDED:
            yield f"select.first has {method}, which all others are compared with on all seeds; remove it"
    for table in ("select", "sweep"):
        for needed in NEEDED:
            if needed not in config[table]["methods"]:
                yield f"{table}.methods lacks {needed}, which all others are compared with; add it"
    for system in config["select"]["systems"]:
        if system not in config["sweep"]["surfaces"]:
            yield f"sweep.surfaces.{system} is missing; list positions of its surface, as select.systems names it"


def _system(system: str, settings: dict) -> Iterator[str]:
    key = f"systems.{system}"
    for parameter, row in settings["parameters"].items():
        yield from _ordered(f"{key}.parameters.{parameter}.bounds", row["bounds"])
        (low, high), nominal = row["bounds"], row["nominal"]
        if not low < nominal < high:
            yield f"{key}.parameters.{parameter}.nominal is {nominal}; it must lie between its bounds {low} and {high}"
        ends = sorted((nominal * (1 - settings["spread"]), nominal * (1 + settings["spread"])))
        if not low <= ends[0] <= ends[1] <= high:
            yield (
                f"{key}.spread is {settings['spread']}; {parameter} is drawn from {ends[0]:.4g} to {ends[1]:.4g}, "
                f"beyond its bounds {low} and {high}; make it smaller, or them wider"
            )
    for entry, value in settings["inputs"].items():
        if isinstance(value, list):
            yield from _ordered(f"{key}.inputs.{entry}", value)
    yield from _mjcf(key, MJCF / f"{system}.xml")


def _ordered(key: str, pair: list) -> Iterator[str]:
    if not pair[0] < pair[1]:
        yield f"{key} is {pair}; the first must be less than the second: swap them"


def _mjcf(key: str, path: Path) -> Iterator[str]:
    try:
        mujoco.MjSpec.from_string(path.read_text())
    except ValueError as error:
        yield f"{key} has an MJCF that does not parse; correct {path}: {' '.join(str(error).split())}"


def _numbers(table: dict | list, path: tuple = ()) -> Iterator[tuple[tuple, float]]:
    for part, value in table.items() if isinstance(table, dict) else enumerate(table):
        if isinstance(value, dict | list):
            yield from _numbers(value, (*path, part))
        elif isinstance(value, float):
            yield (*path, part), value
