"""The page stands alone, says what was found, is the same each time, and is never half written."""

import base64
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosed import nothing, rubbing, undecided

from fimpact.diagnosis.identifiability.sentences import Told
from fimpact.effects import EFFECTS
from fimpact.effects.base import words
from fimpact.report import contents as report_contents
from fimpact.report import page as report
from fimpact.report.contents import describe_inputs, to_text
from fimpact.report.numbers import estimate, pair, short
from fimpact.report.page import check_folder, write_report


@pytest.fixture(scope="module")
def diagnosis():
    return rubbing()


@pytest.fixture(scope="module")
def written(diagnosis, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "pendulum"
    write_report(diagnosis, folder, provenance={"inputs": {"log.csv": "0" * 64}})
    return folder


@pytest.fixture
def quick(monkeypatch):
    """No film, which takes most of the time that a page takes."""
    monkeypatch.setattr(report_contents, "draw_film", lambda *_: "No film: how elbow stood was not measured.")


def test_the_folder_holds_page_data_figures_and_model(written):
    assert {p.name for p in written.iterdir()} == {"report.html", "diagnosis.json", "figures", "improved.xml"}
    names = {p.name for p in (written / "figures").iterdir()}
    pictures = {f"{figure}.{kind}" for figure in ("horizon", "force", "joints") for kind in ("svg", "png")}
    assert names == {"motion.gif", *pictures}
    assert [p.name for p in written.parent.iterdir()] == [written.name]


def test_the_page_needs_no_network_and_no_script(written):
    page = (written / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"https?://|//cdn|<script|<link|@import|\bsrc=\"(?!data:)", page)
    assert page.count("<svg") == 3
    assert "prefers-color-scheme: dark" in page
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    assert set(re.findall(r'(?:href="#|url\(#)([^")]+)', page)) <= set(ids)


def test_the_proof_comes_first_and_the_force_next(written):
    page = (written / "report.html").read_text(encoding="utf-8")
    assert re.findall(r"<h2>(.*?)</h2>", page)[:2] == [
        "How far ahead each model predicts runs that no fit has seen", "The force that the model lacks",
    ]  # fmt: skip


def test_the_film_is_on_the_page_which_stays_small(written):
    page = (written / "report.html").read_text(encoding="utf-8")
    film = (written / "figures" / "motion.gif").read_bytes()
    assert f'src="data:image/gif;base64,{base64.b64encode(film).decode()}"' in page
    assert len(page.encode()) - len(film) * 4 / 3 < 1e6 and len(film) < 1.5e6


def test_where_nothing_can_be_drawn_the_page_says_so(diagnosis, quick, tmp_path):
    page = write_report(diagnosis, tmp_path / "blind", provenance={}).read_text(encoding="utf-8")
    assert "No film: how elbow stood was not measured." in page and "data:image/gif" not in page
    assert json.loads((tmp_path / "blind" / "diagnosis.json").read_text())["film"]["file"] == ""


def test_every_held_out_run_has_its_errors_in_the_unit_of_the_measurement(written):
    found = json.loads((written / "diagnosis.json").read_text(encoding="utf-8"))["held_out"]
    (row,) = found["runs"]
    assert found["unit"] == "rad" and row["run"] == "run_2" and found["overall"]["naive"] == row["error_naive"]
    assert row["error_improved"] < row["error_naive"] and len(found["horizons"]) == len(found["curve"]["naive"])


def test_the_page_says_what_was_found(written, diagnosis):
    page = (written / "report.html").read_text(encoding="utf-8")
    value = diagnosis.effects[0].rows[0]
    for text in (
        "Missing: coulomb at pivot",
        pair(value["after"], (value["high"] - value["low"]) / 2) + " N m",
        EFFECTS["coulomb"].sentence,
        "noise floor",
        "log.csv",
        "0" * 64,
        "improved.xml",
        "joint frictionloss",
        "&lt;dynamics friction&gt;",
        "physxJointAxis:angular:staticFrictionEffort",
    ):
        assert text.lower() in page.lower(), text
    data = json.loads((written / "diagnosis.json").read_text(encoding="utf-8"))
    assert data["schema"] == 3 and data["model"]["files"] == ["improved.xml"]
    assert data["model"]["difference"] < 0.02
    assert data["provenance"]["inputs"] == {"log.csv": "0" * 64}


def test_the_headline_is_one_sentence_and_the_rest_stands_below(diagnosis, quick, written, tmp_path):
    said = replace(diagnosis, verdict="Missing: dry friction (0.3 ± 0.1 N m). It explains 9%. More may be missing.")
    page = write_report(said, tmp_path / "said", provenance={}).read_text(encoding="utf-8")
    assert "<h1>Missing: dry friction (0.3 ± 0.1 N m).</h1>" in page
    assert '<p class="lead">It explains 9%. More may be missing.</p>' in page
    assert '<p class="lead">' not in (written / "report.html").read_text(encoding="utf-8")


def test_what_misses_a_rule_stands_below_what_is_certain_with_the_rule(diagnosis, quick, tmp_path):
    certain = diagnosis.effects[0]
    doubted = replace(certain, tier="possible", why_not="a value lies at its bound")
    said = replace(diagnosis, effects=(doubted, certain))
    page = write_report(said, tmp_path / "doubt", provenance={}).read_text(encoding="utf-8")
    assert page.index("<td>certain</td>") < page.index("<td>may be<br><small>a value lies at its bound</small></td>")


def test_a_model_that_held_out_runs_refuse_is_not_exported(diagnosis, quick, tmp_path):
    rows = tuple(row | {"error_improved": row["error_naive"]} for row in diagnosis.proof.runs)
    refused = replace(diagnosis, proof=replace(diagnosis.proof, runs=rows))
    page = write_report(refused, tmp_path / "refused", provenance={}).read_text(encoding="utf-8")
    assert "it predicts held-out runs no better than the naive fit" in page
    assert not (tmp_path / "refused" / "improved.xml").exists()


def test_what_the_data_cannot_tell_apart_is_told_by_the_difference(quick, tmp_path):
    page = write_report(undecided(), tmp_path / "two", provenance={}).read_text(encoding="utf-8")
    assert '<tr><td>coulomb at pivot</td><td>viscous at pivot</td><td class="n">29 %</td></tr>' in page


def test_without_held_out_runs_nothing_is_proven(diagnosis, quick, tmp_path):
    recording = replace(diagnosis.recording, runs=diagnosis.recording.training)
    left = diagnosis.remainder | {"held_out": []}
    unproven = replace(diagnosis, recording=recording, proof=None, remainder=left)
    page = write_report(unproven, tmp_path / "unproven", provenance={}).read_text(encoding="utf-8")
    assert "no run was held out: nothing is proven" in page and (tmp_path / "unproven" / "improved.xml").exists()


def test_the_same_diagnosis_gives_the_same_bytes(written, diagnosis, tmp_path):
    write_report(diagnosis, tmp_path / "again", provenance={"inputs": {"log.csv": "0" * 64}})
    for name in ("diagnosis.json", "report.html", "improved.xml", "figures/force.svg"):
        assert (tmp_path / "again" / name).read_bytes() == (written / name).read_bytes()


def test_a_failure_leaves_the_earlier_report_and_nothing_else(written, diagnosis, quick, monkeypatch):
    before = (written / "report.html").read_bytes()

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(report, "pictures", fail)
    for folder in (written, written.with_name("new")):
        with pytest.raises(OSError, match="disk full"):
            write_report(diagnosis, folder, provenance={})
    assert [p.name for p in written.parent.iterdir()] == [written.name]
    assert (written / "report.html").read_bytes() == before


def test_other_peoples_files_are_not_replaced(diagnosis, tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(FileExistsError, match=r"thesis\.tex"):
        write_report(diagnosis, tmp_path, provenance={})
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_a_folder_that_cannot_be_replaced_is_refused_before_the_work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder in (".", "..", tmp_path):
        with pytest.raises(OSError, match="choose"):
            check_folder(Path(folder))
    with pytest.raises(FileExistsError, match="is no folder"):
        check_folder(Path("/dev/null"))


def test_a_report_behind_a_link_is_replaced_where_it_is(diagnosis, quick, tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to("there")
    write_report(diagnosis, tmp_path / "link", provenance={})
    assert (tmp_path / "link").is_symlink() and (tmp_path / "there" / "report.html").is_file()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "there"]


def test_nothing_missing_is_a_page_too(tmp_path):
    page = write_report(nothing(), tmp_path / "none", provenance={}).read_text(encoding="utf-8")
    assert "Nothing is missing" in page
    assert "No model is exported: no effect was added." in page
    assert not (tmp_path / "none" / "improved.xml").exists()


def test_numbers_are_written_for_readers():
    assert [short(x) for x in (0.012345, -2.0, 1.5e-7, None, np.nan)] == ["0.0123", "−2", "1.5×10⁻⁷", "–", "–"]
    assert pair(0.020123, 0.00192) == "0.0201 ± 0.0019"
    assert pair(2.5e-4, 5.7e-4) == "(2.5 ± 5.7)×10⁻⁴"
    row = {"value": 0.02, "low": None, "high": 0.1, "unit": "N m"}
    assert estimate(row) == "0.02 N m" and estimate(row | {"low": -0.06, "unit": "1"}) == "0.020 ± 0.080"
    assert words("coulomb@joint_2+sensor_bias@q1") == "coulomb at joint_2 and sensor bias at q1"


def test_json_is_sorted_rounded_and_without_nan():
    text = to_text({"b": np.float64(1 / 3), "a": (np.nan, np.int64(2), True, None)})
    assert json.loads(text) == {"a": [None, 2, True, None], "b": 0.3333333333}
    assert text.index('"a"') < text.index('"b"')


def test_inputs_are_named_by_their_hash(tmp_path):
    (tmp_path / "log.csv").write_bytes(b"")
    found = describe_inputs([tmp_path / "log.csv"])
    assert found["inputs"]["log.csv"].startswith("e3b0c44298fc1c14")
    assert set(found["versions"]) >= {"python", "mujoco", "numpy", "fimpact"}
    (tmp_path / "later").mkdir()
    (tmp_path / "later" / "log.csv").write_bytes(b"1")
    found = describe_inputs([tmp_path / "log.csv", tmp_path / "later" / "log.csv"])
    assert len(set(found["inputs"].values())) == 2


def test_the_page_says_what_the_recordings_cannot_show(diagnosis, tmp_path, quick):
    unseen = Told("unseen", ("coulomb@wrist",), "Coulomb friction at wrist (it never moves)", "Move wrist alone.")
    said = replace(diagnosis, unshown=(unseen,))
    page = write_report(said, tmp_path / "page", provenance={}, again="my.yaml --out page").read_text(encoding="utf-8")
    assert "What these recordings cannot show" in page
    assert "Coulomb friction at wrist (it never moves)." in page
    assert "fimpact diagnose my.yaml --out page" in page
    told = json.loads((tmp_path / "page" / "diagnosis.json").read_text(encoding="utf-8"))["cannot_show"]
    assert told == [{"kind": "unseen", "names": ["coulomb@wrist"], "what": unseen.what, "motion": unseen.motion}]
