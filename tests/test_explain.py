"""What is refitted from where."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from fimpact.effects import EFFECTS
from fimpact.mismatch import explain


@dataclass(frozen=True)
class Candidate:
    """As much of one as a refit is asked from."""

    placed: SimpleNamespace
    strength: float


@pytest.mark.parametrize(
    ("effect", "limited", "costs", "expected"),
    [
        ("contact_stiffness", True, (9.0, 4.0), 4.0),
        ("contact_stiffness", True, (4.0, 9.0), 4.0),
        ("contact_stiffness", True, (np.nan, 9.0), 9.0),  # it diverged
        ("contact_stiffness", False, (9.0, 4.0), 9.0),
        ("coulomb", True, (9.0, 4.0), 9.0),  # there is no friction below none
    ],
)
def test_what_ends_at_its_limit_is_tried_from_the_other_side(monkeypatch, effect, limited, costs, expected):
    candidate = Candidate(SimpleNamespace(effect=EFFECTS[effect]), -0.5)

    def refitted(bench, current, started, worst):
        assert worst == 7.0
        placed = SimpleNamespace(at_limit=limited and started is candidate)
        return SimpleNamespace(placed=[placed], deviance=costs[started.strength > 0])

    monkeypatch.setattr(explain, "_refit", refitted)
    assert explain.refit(None, None, candidate, worst=7.0).deviance == expected


def test_what_is_white_but_louder_than_the_sensors_counts_as_far_from_their_noise():
    assert explain.Explanation((), None, None, 0.0, dispersion=2.0, noise=3.0).loudness == 18.0
