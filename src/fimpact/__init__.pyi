from fimpact.api import CaseError as CaseError
from fimpact.api import Diagnosis as Diagnosis
from fimpact.api import Experiment as Experiment
from fimpact.api import Fit as Fit
from fimpact.api import Recording as Recording
from fimpact.api import Resolution as Resolution
from fimpact.api import catalogue as catalogue
from fimpact.api import design_experiment as design_experiment
from fimpact.api import diagnose as diagnose
from fimpact.api import fit as fit
from fimpact.api import read_case as read_case
from fimpact.api import resolve as resolve

__version__: str
