"""The public API: everything that the command line does, for a notebook or a script. `fimpact` has the same names."""

from fimpact.api.catalogue import catalogue
from fimpact.api.diagnosis import Diagnosis, diagnose
from fimpact.api.experiment import Experiment, Resolution, design_experiment, resolve
from fimpact.api.fitting import Fit, fit
from fimpact.api.recording import Recording, read_case
from fimpact.cases.errors import CaseError

__all__ = [
    "CaseError",
    "Diagnosis",
    "Experiment",
    "Fit",
    "Recording",
    "Resolution",
    "catalogue",
    "design_experiment",
    "diagnose",
    "fit",
    "read_case",
    "resolve",
]
