"""What the page says about how often such answers were right."""

from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from conftest import ROOT
from diagnosed import nothing, rubbing, undecided

from fimpact.benchmark.grading.strata import track_record as counted
from fimpact.benchmark.rigs.registry import RIGS
from fimpact.diagnosis import blind_record
from fimpact.diagnosis import track_record as told
from fimpact.diagnosis.track_record import rig_like, track_record

PUBLISHED = ROOT / "results" / "reference" / "concealed" / "track_record.csv"
TOUCHING = ("arm_contact", "leg")


@pytest.mark.parametrize("rig", RIGS)
def test_a_robot_of_the_benchmark_is_like_itself(rig):
    assert rig_like(RIGS[rig].naive, apart=rig not in TOUCHING) == rig


def test_the_page_cites_what_was_published():
    packaged = Path(blind_record.__file__).with_name(blind_record.TABLE)
    assert packaged.read_bytes() == PUBLISHED.read_bytes()


def test_counts_are_those_of_the_cases():
    rows = [
        # system, kind, lambda, answer, answer_set, confidence, detected, right, in_set
        ("leg", "single", 100, "a@x", "a@x", 0.99, True, True, True),
        ("leg", "single", 100, "b@x", "b@x", 0.99, True, False, False),
        ("leg", "single", 100, "a@x", "a@x|b@x", 0.6, True, False, True),
        ("leg", "single", 10, "none", "none", 1.0, False, False, False),
        ("leg", "null", 0, "none", "none", 1.0, False, True, True),
        ("block", "outside", 100, "unnamed", "unnamed", 1.0, True, False, None),
    ]
    names = "system kind lambda answer answer_set confidence detected right in_set".split()
    found = counted(pd.DataFrame(rows, columns=names)).set_index("rig")
    assert found.loc["leg"].tolist() == [5, 2, 1, 1, 1, 3, 3]
    assert found.loc["block"].tolist() == [1, 0, 0, 0, 0, 1, 1]


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (rubbing, "7 of 8 answers that left no choice were right in every name"),
        (undecided, "4 of 5 answers that left a choice held the truth"),
        (nothing, "6 of 9 effects were found"),
    ],
)
def test_an_answer_cites_the_row_of_its_rig(monkeypatch, made, words):
    row = {"rig": "arm_free", "certain": "8", "right": "7", "choices": "5", "held": "4", "visible": "9", "found": "6"}
    monkeypatch.setattr(told, "rows", lambda: {"arm_free": row})
    assert words in track_record(made())
    monkeypatch.setattr(told, "rows", lambda: {})
    assert track_record(made()) == ""


def test_an_answer_is_trusted_as_far_as_such_answers_were_right_blind(monkeypatch):
    rows = {rig: {"certain": "4", "right": "3", "choices": "0", "held": "0"} for rig in ("leg", "block")}
    monkeypatch.setattr(blind_record, "rows", lambda: rows)
    assert blind_record.share_that_held(choice=False) == pytest.approx(7 / 10)
    assert blind_record.share_that_held(choice=True) == pytest.approx(1 / 2)
    assert rubbing().confidence == pytest.approx(7 / 10)
    assert undecided().confidence == pytest.approx(1 / 1.4 / 2)
    assert nothing().confidence is None


def test_something_without_a_name_is_a_rival_of_what_is_told_but_not_of_small_refinements():
    left = replace(rubbing().explanation.left, instead={"coulomb@pivot": 1.0})
    doubted = replace(rubbing(), explanation=replace(rubbing().explanation, left=left))
    assert doubted.answer_set == ["coulomb@pivot", "unnamed"]
    assert doubted.confidence == pytest.approx(blind_record.share_that_held(choice=True) / 2)
    small = replace(doubted, explanation=replace(doubted.explanation, slight=frozenset(["coulomb@pivot"])))
    assert small.answer_set == ["coulomb@pivot"]
