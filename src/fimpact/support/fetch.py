"""Fetch: data files that others publish, put in their place only if they are what they should be."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml
from jsonschema import Draft202012Validator

from fimpact.support.schema_errors import in_words, most_telling

PATIENCE = 60  # s that a server may be silent
ROW = {
    "file": {"type": "string", "pattern": r"^(?!.*\.\.)[^/].*$", "description": "a path inside the data folder"},
    "url": {"type": "string", "pattern": "^https?://.", "description": "an address that begins with http or https"},
    "sha256": {"type": "string", "pattern": "^[0-9a-f]{64}$", "description": "64 hex digits, as sha256sum prints them"},
    "licence": {"type": "string"},
}
TABLE = {"type": "object", "additionalProperties": False, "required": list(ROW), "properties": ROW}
SCHEMA = {"type": "array", "items": TABLE}


@dataclass(frozen=True)
class Source:
    """One published file: its path inside the data folder, address, sha256 in hex, and licence."""

    file: str
    url: str
    sha256: str
    licence: str


def read_sources(path: Path | str) -> tuple[Source, ...]:
    """The files that a table such as config/recordings/sources.yaml offers.

    Raises:
        ValueError: not such a table; one line that names the key, its value and what is allowed.
    """
    try:
        rows = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise ValueError(f"{path} is not YAML: {' '.join(str(error).split())}; correct it") from None
    wrong = most_telling(Draft202012Validator(SCHEMA).iter_errors(rows))
    if wrong:
        raise ValueError(f"{path}: {in_words(wrong)} (each row: {', '.join(ROW)})")
    return tuple(Source(**row) for row in rows)


def find_source(sources: Sequence[Source], file: str) -> Source:
    """The one of `sources` that offers `file`.

    Raises:
        ValueError: none does.
    """
    found = [source for source in sources if source.file == file]
    if not found:
        allowed = ", ".join(source.file for source in sources)
        raise ValueError(f"'{file}' is offered by no source; allowed: {allowed}; config/recordings/README.md says more")
    return found[0]


def fetch(source: Source, path: Path | str) -> None:
    """Download `source` to a draft beside `path`, and rename it to `path` once its sha256 is right.

    Raises:
        ValueError: no such address, no answer, or another file than expected, in one line; nothing is left behind.
    """
    import pooch  # here, because every `snakemake` reads the table and hardly one of them fetches
    import requests

    path = Path(path)
    pooch.get_logger().setLevel("WARNING")
    download = pooch.HTTPDownloader(timeout=PATIENCE)
    try:
        pooch.retrieve(source.url, f"sha256:{source.sha256}", path.name, path.parent, downloader=download)
    except requests.HTTPError as error:
        answer = f"{error.response.status_code} {error.response.reason}" if error.response is not None else "nothing"
        raise ValueError(f"{source.url} answers {answer}; {_instead(path)}") from None
    except requests.RequestException as error:
        reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise ValueError(f"{source.url} cannot be reached ({reason}); {_instead(path)}") from None
    except ValueError as error:
        if "hash" not in str(error):
            raise
        raise ValueError(
            f"{source.url} gave a file that is not the one expected (sha256 {source.sha256}); nothing was kept: "
            f"it was cut short, or it has changed; try again, or {_instead(path)}"
        ) from None


def _instead(path: Path) -> str:
    return f"get the file by hand and put it at {path}"
