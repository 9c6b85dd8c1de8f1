"""The oracle: it knows which effect is there and where, and has to fit the rest like everybody else."""

import numpy as np

from fimpact.concealed.truth import Truth
from fimpact.effects import EFFECTS
from fimpact.mismatch.evidence import weigh_evidence
from fimpact.mismatch.explain import naive_fit
from fimpact.mismatch.insist import insisted
from fimpact.mismatch.judge import bench
from fimpact.recordings import Recording


def oracle_error(recording: Recording, truth: Truth) -> float | None:
    """Held-out error of the naive model with the planted effects at their sites, all values fitted; None where the
    catalogue has no such effect."""
    if any(e.name not in EFFECTS for e in truth.effects):
        return None
    try:
        return _oracle(recording, truth)
    except np.linalg.LinAlgError:  # a fit that breaks down costs the case its oracle, not the benchmark
        return None


def _oracle(recording: Recording, truth: Truth) -> float:
    made = bench(recording)
    naive = naive_fit(made)
    known = insisted(made, naive, [(EFFECTS[effect.name], effect.site) for effect in truth.effects])
    return weigh_evidence(made, naive, known).after
