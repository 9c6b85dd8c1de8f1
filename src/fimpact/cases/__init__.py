"""From a user's files to a `fimpact.recordings.Recording`: one YAML file, a *case*, says how to read them."""

from fimpact.cases.case import inputs, read_case
from fimpact.cases.errors import CaseError

__all__ = ["CaseError", "inputs", "read_case"]
