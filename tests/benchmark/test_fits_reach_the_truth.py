"""A fit is at least as likely as the truth that it looks for: else a step of it is no step downhill.

Steps follow columns; where a column leaves out a part of what a number does, they come to rest beside the optimum, and
what is left there looks like something else that is missing.
"""

import numpy as np
import pytest

from fimpact.benchmark.drawing.draw_case import draw_case
from fimpact.benchmark.rigs.registry import RIGS
from fimpact.benchmark.truth import Truth
from fimpact.recordings import Recording
from fimpact.smoothing.parameters import parameters
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth

SLACK = 1.0  # of a log likelihood: a fit ends where a next step is small


def true_values(recording: Recording, truth: Truth, naive: np.ndarray) -> np.ndarray:
    """What the unknowns truly are, (p,): errors are shares, but of what is nothing; a mass takes its inertia along."""
    heavier = {u.site: 1 + e for u, e in zip(recording.unknowns, truth.errors, strict=True) if u.field == "mass"}
    found = np.where(naive != 0, naive * (1 + np.array(truth.errors)), truth.errors)
    return found * [heavier.get(u.site, 1.0) if u.field == "inertia" else 1.0 for u in recording.unknowns]


@pytest.mark.parametrize("system", RIGS)
def test_a_fit_is_as_likely_as_the_truth(system):
    recording, truth = draw_case(0, "null", 6006, system, {})
    made = prepare(recording)
    free = made.naive
    theta = true_values(recording, truth, made.track.simulator.theta)
    frozen = smooth(made.track, made.begun, made.noise, like=free, theta=theta, frozen=True)
    known = parameters(made.track.simulator, theta, (), ())
    at_truth = frozen.fit + 0.5 * sum(number.away**2 for number in known)
    assert frozen.converged and free.converged
    assert free.fit + 0.5 * sum(number.away**2 for number in free.numbers) < at_truth + SLACK
