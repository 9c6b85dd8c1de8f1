"""Check a table of a configuration against its JSON schema."""

from functools import reduce
from operator import getitem
from pathlib import Path

import yaml
from jsonschema import Draft202012Validator

from fimpact.support.schema_errors import in_words, most_telling


def check_keys(config: dict, schema: Path, **names: list[str]) -> None:
    """Check a table against its JSON schema alone.

    Args:
        names: by the definition of the schema that stands for it, the names that are known only here.

    Raises:
        ValueError: one line that names the first wrong key, its value, and what is allowed.
    """
    rules = yaml.safe_load(schema.read_text())
    for definition, known in names.items():
        rules["$defs"][definition] = {"enum": known}
    validator = Draft202012Validator(rules)
    as_numbers(validator, config)
    error = most_telling(validator.iter_errors(config))
    if error:
        raise ValueError(f"configuration: {in_words(error)} (all keys: config/README.md)")


def as_numbers(validator: Draft202012Validator, config: dict) -> None:
    """Numbers where numbers belong: of ``--config 'table={key: 5}'`` snakemake makes text."""
    for error in list(validator.iter_errors(config)):
        if error.validator == "type" and error.validator_value in ("number", "integer"):
            *above, last = error.absolute_path
            table = reduce(getitem, above, config)
            if isinstance(error.instance, str) and type(number := yaml.safe_load(error.instance)) in (int, float):
                table[last] = number
