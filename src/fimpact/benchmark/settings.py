"""Check the settings of the blind benchmark before anything runs, as `fimpact.paper.config` does for the paper's."""

from collections.abc import Iterator
from pathlib import Path

from fimpact.support.schema_check import check_keys


def check(config: dict, schema: Path) -> None:
    """Check the table ``concealed`` of a configuration.

    Args:
        config: ``{"concealed": {...}}``. schema: file of its JSON schema.

    Raises:
        ValueError: one line that names the first wrong key, its value, and what is allowed.
    """
    check_keys(config, schema)
    complaint = next(_contradictions(config["concealed"]), None)
    if complaint:
        raise ValueError(f"configuration: {complaint} (all keys: config/README.md)")


def _contradictions(settings: dict) -> Iterator[str]:
    for kind, (low, high) in settings["lambda"].items():
        if not low <= high:
            yield f"concealed.lambda.{kind} is [{low}, {high}]; the first must not be above the second: swap them"
    refitted, most = settings["refitted"], settings["compared"]
    if refitted > most:
        yield f"concealed.refitted is {refitted}; it must be at most concealed.compared, {most}"
    if not any(settings["cases"].values()):
        yield "concealed.cases has none of any kind; ask for at least one case"
