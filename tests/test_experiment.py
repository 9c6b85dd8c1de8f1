"""The experiment that is handed out: what a robot needs to play it, and nothing where none would help."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from test_report import diagnosed

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.experiment import MANY, described, next_experiment
from fimpact.mismatch.discriminate import NEEDED, Experiment, repeats
from fimpact.report import write_report

FRICTION = Placed(EFFECTS["coulomb"], "pivot", {"friction": 0.015})
DAMPING = Placed(EFFECTS["viscous"], "pivot", {"damping": 0.01})


@pytest.fixture(scope="module")
def undecided():
    found, other = diagnosed(FRICTION), diagnosed(DAMPING).naming.best
    return replace(found, naming=replace(found.naming, members=[found.naming.best, replace(other, weight=0.4)]))


@pytest.fixture(scope="module")
def designed(undecided):
    return next_experiment(undecided)


def test_one_name_needs_no_experiment():
    assert next_experiment(diagnosed(FRICTION)) is None


def test_the_files_hold_commands_and_start_within_what_was_recorded(undecided, designed, tmp_path):
    page = write_report(undecided, tmp_path / "out", designed, provenance={})
    played = pd.read_csv(page.parent / "experiment.csv", index_col="time")
    begin = pd.read_csv(page.parent / "experiment-start.csv")
    assert begin.quantity.tolist() == ["qpos", "qvel"] and begin.of.tolist() == ["pivot", "pivot"]
    assert begin.value.tolist() == pytest.approx([designed.qpos[0], designed.qvel[0]], rel=1e-6)
    recorded = np.concatenate([run.ctrl for run in undecided.recording.training])
    assert played.motor.to_numpy() == pytest.approx(designed.ctrl[:, 0], rel=1e-6)
    low, high = recorded.min(), recorded.max()
    assert low - 1e-6 <= played.motor.min() < played.motor.max() <= high + 1e-6
    assert np.diff(played.index) == pytest.approx(undecided.recording.period)
    told = json.loads((page.parent / "diagnosis.json").read_text(encoding="utf-8"))["experiment"]
    assert told["pairs"][0]["separation"] == pytest.approx(designed.separation, rel=1e-6)
    assert [(p["one"], p["other"]) for p in told["pairs"]] == [("coulomb@pivot", "viscous@pivot")]
    assert "The experiment that would tell them apart" in page.read_text(encoding="utf-8")
    write_report(undecided, tmp_path / "out", designed, provenance={})  # its own files are replaced


def test_where_none_would_help_the_page_says_so_and_no_file_is_written(undecided, designed, tmp_path):
    hopeless = replace(designed, pairs=np.array([NEEDED / (MANY + 1)]))
    assert repeats(hopeless.separation) == MANY + 1 and described(undecided, hopeless)["files"] == []
    page = write_report(undecided, tmp_path / "out", hopeless, provenance={})
    assert "None within the commands and starts" in page.read_text(encoding="utf-8")
    assert not list(page.parent.glob("experiment*"))


def test_a_pair_that_nothing_tells_apart_does_not_spoil_the_others(undecided):
    third = replace(undecided.naming.members[1], placed=(replace(DAMPING, site="other"),))
    three = replace(undecided, naming=replace(undecided.naming, members=[*undecided.naming.members, third]))
    model = undecided.bench.training.simulator.base
    found = Experiment(np.zeros((3, model.nu)), np.zeros(1), np.zeros(1), 0.01, np.array([30.0, 0.0, 4.0]), 0.1)
    told = described(three, found)
    assert [pair["repeats"] for pair in told["pairs"]] == [1, None, 3] and told["files"]
