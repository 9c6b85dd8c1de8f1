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

_HOMES = {
    "CaseError": "fimpact.cases.errors",
    "Diagnosis": "fimpact.api.diagnosis",
    "Experiment": "fimpact.api.experiment",
    "Fit": "fimpact.api.fitting",
    "Recording": "fimpact.api.recording",
    "Resolution": "fimpact.api.experiment",
    "catalogue": "fimpact.api.catalogue",
    "design_experiment": "fimpact.api.experiment",
    "diagnose": "fimpact.api.diagnosis",
    "fit": "fimpact.api.fitting",
    "read_case": "fimpact.api.recording",
    "resolve": "fimpact.api.experiment",
}
__all__ = sorted((*_HOMES, "__version__"))


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module 'fimpact' has no attribute '{name}'; it has {', '.join(__all__)}")
    value = version("fimpact") if name == "__version__" else getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
