"""The page stands alone, says what was found, is the same each time, and is never half written."""

import base64
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_model import diagnosis_of, record

from fimpact import report, report_contents
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed, words
from fimpact.mismatch.diagnose import Diagnosis
from fimpact.mismatch.locate import locate
from fimpact.mismatch.nameless import Stranger
from fimpact.mismatch.naming import Naming
from fimpact.mismatch.pulses import pulses
from fimpact.mismatch.step import Step
from fimpact.report import check_folder, write_report
from fimpact.report_contents import describe_inputs, to_text
from fimpact.report_numbers import pair, short
from fimpact.report_where import timeline


def diagnosed(*placed: Placed) -> Diagnosis:
    found = diagnosis_of(record(0.02), *placed)
    problem, naming = found.bench.training, found.naming
    kept = pulses(problem, naming.naive.fitted)
    steps = [Step([], np.zeros(0), [naming.best] if placed else [])]
    members = [naming.best] if placed else []
    named = Naming(
        naming.naive, steps, naming.best, members, 0.01, Stranger(0.5, 1.0, ""), 1.0, 1.0, naming.covariance, kept
    )
    location = locate(problem, naming.naive.fitted, kept)
    verdict = "Missing: dry friction." if placed else "Nothing is missing that these recordings can show."
    return Diagnosis(found.recording, found.bench, named, location, found.evidence, verdict)


@pytest.fixture(scope="module")
def diagnosis() -> Diagnosis:
    return diagnosed(Placed(EFFECTS["coulomb"], "pivot", {"friction": 0.015}))


@pytest.fixture(scope="module")
def written(diagnosis, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "pendulum"
    write_report(diagnosis, folder, provenance={"inputs": {"log.csv": "0" * 64}})
    return folder


def test_thinned_windows_are_not_shown_as_if_one_followed_the_other(diagnosis):
    thinned = replace(diagnosis, recording=replace(diagnosis.recording, windows=20))
    assert "fitted windows" not in timeline(diagnosis).axes[1].get_xlabel()
    assert timeline(thinned).axes[1].get_xlabel().startswith("time in fitted windows of 3 training runs")


def test_the_folder_holds_page_data_figures_and_model(written):
    assert {p.name for p in written.iterdir()} == {"report.html", "diagnosis.json", "figures", "improved.xml"}
    figures = ("overlay", "mechanism", "timeline", "state", "candidates")
    names = {p.name for p in (written / "figures").iterdir()}
    assert names == {"motion.gif", *(f"{figure}.{kind}" for figure in figures for kind in ("svg", "png"))}
    assert [p.name for p in written.parent.iterdir()] == [written.name]


def test_the_page_needs_no_network_and_no_script(written):
    page = (written / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"https?://|//cdn|<script|<link|@import|\bsrc=\"(?!data:)", page)
    assert page.count("<svg") == 5
    assert "prefers-color-scheme: dark" in page
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    assert set(re.findall(r'(?:href="#|url\(#)([^")]+)', page)) <= set(ids)


def test_the_film_is_on_the_page_which_stays_small(written):
    page = (written / "report.html").read_text(encoding="utf-8")
    film = (written / "figures" / "motion.gif").read_bytes()
    assert f'src="data:image/gif;base64,{base64.b64encode(film).decode()}"' in page
    assert len(page.encode()) - len(film) * 4 / 3 < 1e6 and len(film) < 1.5e6


def test_where_nothing_can_be_drawn_the_page_says_so(diagnosis, tmp_path, monkeypatch):
    monkeypatch.setattr(report_contents, "draw_film", lambda *_: "No film: how elbow stood was not measured.")
    page = write_report(diagnosis, tmp_path / "blind", provenance={}).read_text(encoding="utf-8")
    assert "No film: how elbow stood was not measured." in page and "data:image/gif" not in page
    assert json.loads((tmp_path / "blind" / "diagnosis.json").read_text())["film"]["file"] == ""


def test_an_effect_at_its_limit_is_called_a_stand_in(written, diagnosis, tmp_path, monkeypatch):
    monkeypatch.setattr(report_contents, "draw_film", lambda *_: "No film.")
    monkeypatch.setattr(Placed, "at_limit", True)
    page = write_report(diagnosis, tmp_path / "limit", provenance={}).read_text(encoding="utf-8")
    text = "it stands in for something else"
    assert text in page and text not in (written / "report.html").read_text(encoding="utf-8")


def test_every_held_out_run_has_its_errors_in_the_unit_of_the_measurement(written, diagnosis):
    found = json.loads((written / "diagnosis.json").read_text(encoding="utf-8"))["held_out"]
    assert found["unit"] == "rad" and [row["run"] for row in found["runs"]] == ["run 4", "run 5"]
    mean = [np.sqrt(np.mean([row[name] ** 2 for row in found["runs"]])) for name in ("error_naive", "error_improved")]
    assert mean == pytest.approx(diagnosis.evidence.by_channel["angle"], rel=1e-6)


def test_the_page_says_what_was_found(written, diagnosis):
    page = (written / "report.html").read_text(encoding="utf-8")
    for text in (
        "Missing: dry friction.",
        EFFECTS["coulomb"].sentence,
        "noise floor",
        "log.csv",
        "0" * 64,
        "improved.xml",
    ):
        assert text.lower() in page.lower()
    data = json.loads((written / "diagnosis.json").read_text(encoding="utf-8"))
    assert data["model"]["files"] == ["improved.xml"]
    assert data["model"]["difference"] < 0.02
    assert data["provenance"]["inputs"] == {"log.csv": "0" * 64}


def test_the_headline_is_one_sentence_and_the_rest_stands_below(diagnosis, written, tmp_path):
    said = replace(diagnosis, verdict="Missing: dry friction (0.3 ± 0.1 N m). It explains 9%. More may be missing.")
    page = write_report(said, tmp_path / "said", provenance={}).read_text(encoding="utf-8")
    assert "<h1>Missing: dry friction (0.3 ± 0.1 N m).</h1>" in page
    assert '<p class="lead">It explains 9%. More may be missing.</p>' in page
    assert "<h1>Missing: dry friction.</h1>" in (written / "report.html").read_text(encoding="utf-8")


def test_a_name_that_held_out_runs_refuse_is_not_what_it_is(diagnosis, written, tmp_path):
    assert "<h2>What it is</h2>" in (written / "report.html").read_text(encoding="utf-8")
    refused = replace(diagnosis, evidence=replace(diagnosis.evidence, low=-0.01))
    page = write_report(refused, tmp_path / "refused", provenance={}).read_text(encoding="utf-8")
    assert "The likeliest name, which held-out runs refuse" in page and "What it is" not in page


def test_the_same_diagnosis_gives_the_same_bytes(written, diagnosis, tmp_path):
    write_report(diagnosis, tmp_path / "again", provenance={"inputs": {"log.csv": "0" * 64}})
    for name in ("diagnosis.json", "report.html", "improved.xml", "figures/state.svg"):
        assert (tmp_path / "again" / name).read_bytes() == (written / name).read_bytes()


def test_a_failure_leaves_the_earlier_report_and_nothing_else(written, diagnosis, monkeypatch):
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


def test_a_report_behind_a_link_is_replaced_where_it_is(diagnosis, tmp_path, monkeypatch):
    monkeypatch.setattr(report_contents, "draw_film", lambda *_: "No film.")
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to("there")
    write_report(diagnosis, tmp_path / "link", provenance={})
    assert (tmp_path / "link").is_symlink() and (tmp_path / "there" / "report.html").is_file()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "there"]


def test_nothing_missing_is_a_page_too(tmp_path):
    page = write_report(diagnosed(), tmp_path / "none", provenance={}).read_text(encoding="utf-8")
    assert "Nothing is missing" in page
    assert "No model is exported: no effect was added." in page
    assert not (tmp_path / "none" / "improved.xml").exists()


def test_numbers_are_written_for_readers():
    assert [short(x) for x in (0.012345, -2.0, 1.5e-7, None, np.nan)] == ["0.0123", "−2", "1.5×10⁻⁷", "–", "–"]
    assert pair(0.020123, 0.00192) == "0.0201 ± 0.0019"
    assert pair(2.5e-4, 5.7e-4) == "(2.5 ± 5.7)×10⁻⁴"
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
