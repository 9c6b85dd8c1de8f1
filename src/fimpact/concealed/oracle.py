"""The oracle: it knows which effect is there and where, and has to fit the rest like everybody else."""

import numpy as np

from fimpact.concealed.truth import Planted, Truth
from fimpact.effects import EFFECTS
from fimpact.mismatch.coordinates import coordinates
from fimpact.mismatch.evidence import weigh_evidence
from fimpact.mismatch.explain import Explanation, explain, refit, sharpened
from fimpact.mismatch.judge import Bench, again, base_fit, bench, settle
from fimpact.mismatch.pulses import pulses
from fimpact.mismatch.scales import scales
from fimpact.mismatch.score import proposals, screen
from fimpact.mismatch.simulate import Hypothesis
from fimpact.recordings import Recording

TRIES = 2  # probes of an effect from which its refit begins


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
    simulator = made.training.simulator
    naive = explain(*base_fit(made, coordinates(simulator), Hypothesis(simulator.theta)))
    current = naive
    for effect in truth.effects:
        current = _with(made, current, effect)
    if current is not naive:
        fitted = again(made, made.training, current.fitted)
        judged = settle(made.held_out, fitted.point.hypothesis, current.judged.point)
        current = explain(fitted, again(made, made.held_out, judged))
        current = sharpened(made, pulses(made.training, naive.fitted), current)
    return weigh_evidence(made, naive, current).after


def _with(made: Bench, current: Explanation, effect: Planted) -> Explanation:
    """`current` with the planted effect refitted from its best probes."""
    problem = made.training
    every = proposals([EFFECTS[effect.name]], problem, scales(problem, current.fitted.point))
    tried = screen(problem, current.fitted, [p for p in every if p.site == effect.site])
    ranked = sorted(tried, key=lambda c: -c.gain)[:TRIES]
    return min((refit(made, current, c) for c in ranked), key=lambda e: e.deviance, default=current)
