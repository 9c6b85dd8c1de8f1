"""What a member of a set may be where the recordings show nothing of its shape."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch import suppose

SPEEDS = (0.1, 0.3, 0.8)
STRIBECK = replace(
    EFFECTS["stribeck"], probes=lambda *_: [{"coulomb": 0.1, "excess": 0.1, "speed": speed} for speed in SPEEDS]
)


def fitted(cost, values):
    placed = (Placed(STRIBECK, "joint", values, {}),)
    return SimpleNamespace(point=SimpleNamespace(cost=cost, hypothesis=SimpleNamespace(placed=placed)))


@pytest.mark.parametrize(
    ("costs", "chosen"), [((10.5, 10.0, 30.0), 0.1), ((30.0, 11.9, 10.0), 0.3), ((30.0, None, 12.1), 0.01)]
)
def test_an_experiment_is_designed_for_the_shape_that_differs_most_and_is_borne(monkeypatch, costs, chosen):
    """None stands for what cannot be simulated."""
    values, asked = {"coulomb": 0.2, "excess": 0.0, "speed": 0.01}, []
    member = SimpleNamespace(fitted=fitted(10.0, values), placed=fitted(10.0, values).point.hypothesis.placed)

    def beside_member(bench, member, wanted):
        asked.append(wanted["stribeck@joint"])
        which = SPEEDS.index(asked[-1]["speed"])
        if costs[which] is None:
            raise ValueError("cannot be simulated")
        return fitted(costs[which], asked[-1] | {"excess": 0.2 / (which + 1)})

    bench = SimpleNamespace(training=SimpleNamespace(simulator=SimpleNamespace(base=None)))
    monkeypatch.setattr(suppose, "beside_member", beside_member)
    monkeypatch.setattr(suppose, "scales", lambda *_: None)
    monkeypatch.setattr(suppose, "void", lambda member: [(0, "speed")])
    assert suppose.supposed(bench, member).point.hypothesis.placed[0].values["speed"] == chosen
    assert asked == [{"coulomb": 0.2, "excess": 0.2, "speed": speed} for speed in SPEEDS]
    monkeypatch.setattr(suppose, "void", lambda member: [])
    assert suppose.supposed(bench, member) is member.fitted
