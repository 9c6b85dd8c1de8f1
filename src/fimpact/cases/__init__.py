"""From a user's files to a `fimpact.recordings.Recording`: one YAML file, a *case*, says how to read them."""

from fimpact.cases.errors import CaseError

__all__ = ["CaseError", "inputs", "read_case"]


def __getattr__(name: str):
    """Import what reads cases, and MuJoCo with it, once it is asked for: `fimpact --help` needs none of it."""
    if name not in __all__:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    from fimpact.cases import case

    return getattr(case, name)
