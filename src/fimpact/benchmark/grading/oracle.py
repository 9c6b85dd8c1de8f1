"""The oracle: it knows which effect is there and where, begins at its true size, and has to fit the rest like everybody
else."""

import numpy as np

from fimpact.benchmark.jsonl import held_out_error
from fimpact.benchmark.truth import Truth
from fimpact.diagnosis.held_out import prove
from fimpact.effects import EFFECTS
from fimpact.recordings import Recording
from fimpact.selection.forced import fit_forced
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.smoothing.prepare import prepare


def oracle_error(recording: Recording, truth: Truth) -> float | None:
    """Held-out error of the naive model with the planted effects at their sites, all values fitted; None where the
    catalogue has no such effect."""
    if any(e.name not in EFFECTS for e in truth.effects):
        return None
    try:
        return _oracle(recording, truth)
    except (np.linalg.LinAlgError, ValueError):  # a fit that breaks down costs the case its oracle, not the benchmark
        return None


def _oracle(recording: Recording, truth: Truth) -> float | None:
    prepared = prepare(recording)
    naive = prepared.naive
    places = [(EFFECTS[effect.name], effect.site) for effect in truth.effects]
    known = fit_forced(prepared, naive, places, known=[effect.values for effect in truth.effects])
    proof = prove(prepared, {"oracle": (prepared.proving, Hypothesis(known.theta, known.placed))})
    return held_out_error(proof.runs, "oracle") if proof else None
