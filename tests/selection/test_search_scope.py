"""What a search may ask: it stops asking, and says what it did not ask."""

from time import monotonic

import pytest
from recorded import rod

from fimpact.cli import main
from fimpact.effects import EFFECTS
from fimpact.selection.explanation import explain
from fimpact.selection.options import Option
from fimpact.selection.search_scope import Limits
from fimpact.smoothing.prepare import prepare

OPTIONS = [
    Option("Coulomb friction at every driven joint", 1, (0, 1)),
    Option("coulomb@shoulder", 1, (0,)),
    Option("coulomb@elbow", 1, (1,)),
    Option("rigid_body@arm", 0, (2,)),
]


def test_classes_only_are_kinds_everywhere_and_what_can_be_at_one_place_only():
    assert Limits().options(OPTIONS) == OPTIONS
    assert Limits(quick=True).options(OPTIONS) == [OPTIONS[0], OPTIONS[3]]


def test_one_family_is_all_that_is_asked_for():
    asked = Limits(family="sensing").effects(EFFECTS.values())
    assert asked and {effect.family for effect in asked} == {"sensing"}
    assert Limits().effects(EFFECTS.values()) == list(EFFECTS.values())


def test_the_time_is_over_when_it_is_over():
    assert not Limits().over and not Limits(seconds=60.0, begun=monotonic()).over
    assert Limits(seconds=60.0, begun=monotonic() - 61).over


@pytest.mark.parametrize(
    ("limits", "found", "said"),
    [
        (Limits(), ["coulomb@pivot"], []),
        (Limits(quick=True), ["coulomb@pivot"], ["--quick"]),
        (Limits(family="sensing"), [], ["--only"]),
        (Limits(seconds=1.0, begun=-1e9), [], ["--budget"]),
    ],
)
def test_a_search_says_what_it_did_not_ask(limits, found, said):
    made, lines = prepare(rod(0.03, free=True)), []
    suspects = [EFFECTS[name] for name in ("coulomb", "viscous", "sensor_bias")]
    told = explain(made.track, made.begun, made.noise, suspects, lines.append, limits)
    assert [law.name for law in told.final.placed] == found
    assert len(told.unasked) == len(said) and all(word in own for word, own in zip(said, told.unasked, strict=True))
    assert any(line.startswith("smoothing: step 1 of at most") for line in lines)


def test_a_family_may_be_named_by_a_word_of_it(capsys):
    assert main(["diagnose", "nowhere.yaml", "--only", "friction"]) == 2
    assert "nowhere.yaml does not exist" in capsys.readouterr().err
