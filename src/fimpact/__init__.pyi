from fimpact.api.catalogue import catalogue as catalogue
from fimpact.api.diagnosis import Diagnosis as Diagnosis
from fimpact.api.diagnosis import diagnose as diagnose
from fimpact.api.experiment import Experiment as Experiment
from fimpact.api.experiment import Resolution as Resolution
from fimpact.api.experiment import design_experiment as design_experiment
from fimpact.api.experiment import resolve as resolve
from fimpact.api.fitting import Fit as Fit
from fimpact.api.fitting import fit as fit
from fimpact.api.recording import Recording as Recording
from fimpact.api.recording import read_case as read_case
from fimpact.cases.errors import CaseError as CaseError

__version__: str
