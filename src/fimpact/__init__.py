"""Find the physics that a robot model lacks, from its MJCF and a log; the public API.

    import fimpact

    recording = fimpact.read_case("case.yaml")
    found = fimpact.diagnose(recording)
    print(found.verdict)
    found.save("page")

Importing this package configures nothing and loads no library; what a name needs is loaded when it is first used.
`__init__.pyi` has the types.
"""

from importlib import import_module
from importlib.metadata import version
from typing import Any

__all__ = [
    "CaseError",
    "Diagnosis",
    "Experiment",
    "Fit",
    "Recording",
    "Resolution",
    "__version__",
    "catalogue",
    "design_experiment",
    "diagnose",
    "fit",
    "read_case",
    "resolve",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module 'fimpact' has no attribute '{name}'; it has {', '.join(__all__)}")
    value = version("fimpact") if name == "__version__" else getattr(import_module("fimpact.api"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
