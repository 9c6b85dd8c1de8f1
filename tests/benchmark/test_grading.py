"""The claim's lines and pictures, from tables whose answers are known."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from concealed_cases import cases
from conftest import ROOT, marked

from fimpact.benchmark.grading import case_table, claim
from fimpact.benchmark.grading.answers import size_of
from fimpact.benchmark.grading.claim_lines import ClaimLine, coverage, share, with_interval
from fimpact.benchmark.grading.confusion import named
from fimpact.benchmark.grading.pictures import APART, FIGURES, draw_bins
from fimpact.benchmark.grading.score import COLUMNS, gather, score_case
from fimpact.benchmark.jsonl import as_lines, each, held_out_error, read_rows, runs_of
from fimpact.benchmark.plan import case_names, compared, plan
from fimpact.benchmark.rigs.registry import RIGS
from fimpact.benchmark.site_equivalence import places
from fimpact.benchmark.truth import Planted, Truth
from fimpact.support import atomic_files, tables

REFERENCE = ROOT / "results" / "reference" / "concealed" / "cases.csv"
SETTINGS = {
    "seed": 5,
    "cases": {"single": 6, "null": 3, "double": 2, "outside": 1, "twin": 2},
    "rigs": list(RIGS),
    "cases_per_job": 4,
    "compared": 0.3333,
    "refitted": 0.2,
}


@pytest.fixture(scope="module")
def table(tmp_path_factory) -> pd.DataFrame:
    """A benchmark's table as it is read from disk."""
    path = tmp_path_factory.mktemp("cases") / "cases.csv"
    tables.write(cases({"single": 60, "null": 20, "double": 10, "outside": 10, "twin": 10}), path)
    return case_table.read_cases(path)


def line(table: pd.DataFrame, what: str) -> ClaimLine:
    return next(m for m in claim.measure(table) if m.what.startswith(what))


def test_the_table_keeps_its_null_kind_and_its_empty_cells(table):
    assert set(table.kind) == {"single", "null", "double", "outside", "twin"}
    assert table.detected.dtype == bool
    assert table[table.kind == "null"].located.isna().all()
    assert list(table.columns[: len(COLUMNS)]) == COLUMNS


def test_a_table_with_a_broken_flag_is_refused(table, tmp_path):
    broken = table.astype(object)
    broken.loc[3, "detected"] = "perhaps"
    tables.write(broken, tmp_path / "cases.csv")
    with pytest.raises(ValueError, match="detected must be True, False or empty"):
        case_table.read_cases(tmp_path / "cases.csv")


def test_shares_have_wilson_intervals():
    found = share("x", pd.Series([True] * 8 + [False] * 2 + [None]))
    assert (found.value, found.n) == (0.8, 10)
    assert (found.low, found.high) == pytest.approx((0.4902, 0.9433), abs=1e-4)


def test_averages_have_bootstrap_intervals():
    found = with_interval("x", pd.Series(np.arange(101.0)), np.median, str)
    assert found.low < 50 == found.value < found.high


@pytest.mark.parametrize(
    ("value", "sign", "verdict"),
    [(0.98, 1, "aim"), (0.92, 1, "bar"), (0.5, 1, "missed"), (0.5, 0, "–"), (np.nan, 1, "–"), (0.9, -1, "aim")],
)
def test_verdicts(value, sign, verdict):
    assert ClaimLine("x", value, 0.0, 1.0, 5, sign, 0.9, 0.95).verdict == verdict


@pytest.mark.parametrize(("held", "verdict"), [(95, "aim"), (90, "bar"), (80, "missed"), (100, "missed")])
def test_intervals_may_be_too_wide_as_well(held, verdict):
    assert coverage("x", pd.Series([held]), pd.Series([100])).verdict == verdict


def test_intervals_of_one_case_are_no_cases_of_their_own():
    held, total = pd.Series([10] * 19 + [0]), pd.Series([10] * 20)
    found, alone = coverage("x", held, total), coverage("x", held / 10, total / 10)
    assert (found.low, found.high, found.n) == (alone.low, alone.high, 200)
    assert found.low < 0.86


@pytest.mark.parametrize(
    ("name", "values", "size"),
    [
        ("coulomb", {"friction": 0.05}, 0.05),
        ("gain", {"change": -0.1}, -0.1),
        ("torque_ripple", {"sine": 0.03, "cosine": -0.04, "cycles": 7.0}, 0.05),
        ("magnet", {"force": 2.0, "reach": 0.1}, 2.0),
    ],
)
def test_the_size_is_the_amplitude(name, values, size):
    assert size_of(Planted(name, "joint_1", values, 40.0, 0.9, 0.9, "free")) == pytest.approx(size)


def test_every_line_of_the_claim_is_there(table):
    text = claim.to_markdown(table)
    for part in ("false alarms", "λ ≥ 30", "arm_contact", "calibration", "contact mode", "share of the oracle's"):
        assert part in text
    for part in ("hold the truth", "both named", "confidently wrong", "designed over random", "exported", "BIC"):
        assert part in text
    assert len(claim.to_table(table)) == text.count("\n|") - 2 * 2


def test_lines_count_what_they_say(table):
    null = table[table.kind == "null"]
    assert line(table, "false alarms").value == pytest.approx(null.detected.mean())
    seen = table[(table.kind != "null") & (table["lambda"] >= 30)]
    assert line(table, "detected where").n == len(seen)
    twins = table[table.kind == "twin"]
    wins = twins.resolved_designed.dropna().astype(bool)
    assert line(table, "… resolved rightly").value == pytest.approx(wins.sum() / len(twins))


def test_a_benchmark_without_a_kind_says_so(table):
    assert "no such case" in claim.to_markdown(table[table.kind == "null"])


def test_perfect_confidence_has_no_calibration_error():
    stated = np.array([[0.75, 1.0], [0.75, 1.0], [0.75, 1.0], [0.75, 0.0]])
    assert claim.error_of(stated) == 0.0
    assert claim.error_of(np.array([[1.0, 0.0]])) == 1.0


def test_improvement_is_a_share_of_the_oracles(table):
    two = table.head(2).assign(heldout_before=[3.0, 1.0], heldout_after=[2.0, 1.0], heldout_oracle=[1.0, 0.999])
    assert claim.recovered_share(two).tolist() == [0.5]


@pytest.mark.parametrize("name", FIGURES)
def test_pictures_are_stable(table, name, tmp_path):
    for turn in ("first", "second"):
        FIGURES[name](table, tmp_path / turn)
    assert (tmp_path / "first.svg").read_bytes() == (tmp_path / "second.svg").read_bytes()


@pytest.mark.parametrize("name", FIGURES)
def test_pictures_of_a_few_cases(name, tmp_path):
    few = cases({"single": 2, "null": 1})
    FIGURES[name](few, tmp_path / "few")
    assert (tmp_path / "few.png").exists()


def test_counts_under_the_calibration_curve_stand_apart():
    figure, ax = plt.subplots()
    draw_bins(ax, np.array([[0.2, 0.2, 4], [0.765, 0.8, 11], [0.807, 0.8, 35], [0.82, 0.9, 7], [0.98, 1, 129]]))
    places = {text.get_text(): text.xy[0] for text in ax.texts if text.get_text().isdigit()}
    plt.close(figure)
    assert list(places) == ["4", "11", "35", "7", "129"] and places["4"] == 0.2
    assert min(np.diff(list(places.values()))) > APART - 1e-9


def test_answers_are_grouped_by_effect():
    assert [named(a) for a in ("coulomb@joint_1", "a@b+c@d", "none")] == ["coulomb", "several", "none"]


def test_the_plan_hides_kinds_in_its_order():
    made = plan(SETTINGS)
    assert [c.name for c in made] == case_names(SETTINGS) == [f"{i:02d}" for i in range(1, 15)]
    assert sorted(c.kind for c in made) != [c.kind for c in made]
    assert {(c.kind, c.index) for c in made} == {(k, i) for k, n in SETTINGS["cases"].items() for i in range(n)}


def test_the_comparators_run_on_the_stated_share():
    assert len(compared(SETTINGS)) == 5
    assert set(compared(SETTINGS)) < set(case_names(SETTINGS))
    assert set(compared(SETTINGS, "refitted")) < set(compared(SETTINGS))


def test_a_share_of_the_cases_is_the_first_of_the_same():
    some = SETTINGS | {"share": 0.5}
    assert plan(some) == plan(SETTINGS)[:7] and case_names(some) == case_names(SETTINGS)[:7]
    assert compared(some) == sorted(set(compared(SETTINGS)) & set(case_names(some)))


def test_a_failed_case_is_a_row(tmp_path):
    def work(case):
        if case == "2":
            raise ValueError("no")
        return {"answer": "none"}

    rows = list(each("123", work, lambda text: None))
    (tmp_path / "rows.jsonl").write_text(as_lines(rows))
    assert [row["status"] for row in read_rows(tmp_path / "rows.jsonl").values()] == [
        "done",
        "failed: ValueError: no",
        "done",
    ]
    with pytest.raises(ValueError, match="no"):
        list(each("2", work, lambda text: None, strict=True))


def test_a_part_without_a_case_is_empty(tmp_path):
    atomic_files.write_text(as_lines([]), tmp_path / "rows.jsonl")
    assert read_rows(tmp_path / "rows.jsonl") == {}


def test_experiments_become_runs():
    arrays = {f"07/designed/{name}": np.zeros((2, 1)) for name in ("ctrl", "qpos", "qvel", "measured")}
    runs = runs_of(arrays)
    assert list(runs) == ["07/designed"] and runs["07/designed"].measured.shape == (2, 1)


def test_places_are_the_same_whatever_names_them():
    rig = RIGS["arm_contact"]
    assert places(rig.naive, rig.channels, "motor_2") == places(rig.naive, rig.channels, "joint_2") == {"joint_2"}
    assert places(rig.naive, rig.channels, "link_3") == {"joint_3"}
    assert places(rig.naive, rig.channels, "wall") == places(rig.naive, rig.channels, "tip_wall") == {"tip_wall"}
    assert places(rig.naive, rig.channels, "wrist_force") == {"wrist_force[0]", "wrist_force[1]"}
    assert places(rig.naive, rig.channels, "world") == places(rig.naive, rig.channels, "all") == set()


def test_held_out_errors_are_in_standard_deviations_of_the_noise():
    runs = [{"noise_floor": 2.0, "error_naive": 2.0, "error_improved": None}, {"noise_floor": 1.0, "error_naive": 7.0}]
    assert held_out_error(runs, "naive") == 5.0 and held_out_error([], "naive") is None
    assert held_out_error(runs[:1], "improved") == np.inf


COULOMB = Planted("coulomb", "joint_2", {"friction": 0.05}, 40.0, 0.95, 0.9, "free")


def truth(kind: str, effects: tuple[Planted, ...], rival: Planted | None = None) -> Truth:
    return Truth(kind, "arm_free", effects, 40.0, 0.95, 0.9, rival, 0.0, 0.0, (), (), (), (), 0.0, 0.1, (0,))


@pytest.fixture
def recording(monkeypatch):
    """As much of a recording as scoring looks at where no oracle is asked."""
    monkeypatch.setattr("fimpact.benchmark.grading.score.oracle_error", lambda recording, truth: 1.0)
    rig = RIGS["arm_free"]
    return type("Known", (), {"xml": rig.xml, "channels": rig.channels})


def answer(best: str, *others: str, **more) -> dict:
    row = {"status": "done", "answer": best, "answer_set": [best, *others], "confidence": 0.9, "acts_in": "any"}
    interval = {"name": "friction", "unit": "N m", "value": 0.05, "low": 0.04, "high": 0.06}
    effect = {"name": "coulomb@joint_2", "coefficients": [interval]}
    missing = [{"joint": f"joint_{i}", "naive": size, "applied": 1.0} for i, size in ((1, 0.1), (2, 0.2))]
    runs = [{"run": "a", "noise_floor": 0.5, "error_naive": 1.0, "error_improved": 0.55}]
    rest = {"effects": [effect], "missing_force": missing, "held_out": {"runs": runs}, "seconds": {"fitting": 2.0}}
    return {"diagnosis": row | rest | more}


def test_a_right_answer_scores(recording):
    row = score_case("01", truth("single", (COULOMB,)), recording, answer("coulomb@joint_2"))
    assert list(row)[: len(COLUMNS)] == COLUMNS
    assert (row["planted"], row["site"], row["size"]) == ("coulomb@joint_2", "joint_2", "0.05")
    assert row["detected"] and row["right"] and row["in_set"] and row["located"] and row["place_right"]
    assert (row["covered"], row["intervals"], row["confidence"], row["seconds"]) == (1, 1, 0.9, 2.0)
    assert (row["heldout_before"], row["heldout_after"], row["noise_floor"]) == (2.0, 1.1, 1.0)


@pytest.mark.parametrize(("acts", "right"), [("contact", False), ("any", True), (None, None)])
def test_the_contact_mode_is_that_of_the_name(recording, acts, right):
    planted = Planted("coulomb", "joint_2", {"friction": 0.05}, 100.0, 0.95, 0.9, "any")
    row = score_case("01", truth("single", (planted,)), recording, answer("coulomb@joint_2", acts_in=acts))
    assert (row["mode"], row["mode_right"]) == (acts, right)


def test_a_wrong_name_at_the_right_place_is_located(recording):
    row = score_case("01", truth("single", (COULOMB,)), recording, answer("gain@motor_2", "coulomb@joint_2"))
    assert row["located"] and row["in_set"] and not row["right"]
    assert row["covered"] is None


def test_unnamed_is_located_by_the_missing_force(recording):
    magnet = Planted("magnet", "link_3", {"force": 1.0}, 40.0, 0.95, 0.9, "free")
    row = score_case("01", truth("outside", (magnet,)), recording, answer("unnamed"))
    assert row["detected"] and row["located"] is False


def test_nothing_planted(recording):
    row = score_case("01", truth("null", ()), recording, answer("none"))
    assert (row["planted"], row["site"], row["right"], row["located"]) == ("none", "none", True, None)


def test_two_effects_are_right_in_any_order(recording):
    spring = Planted("spring", "joint_1", {"stiffness": 1.0}, 40.0, 0.9, 0.9, "free")
    both = truth("double", (spring, COULOMB))
    assert score_case("01", both, recording, answer("coulomb@joint_2+spring@joint_1"))["right"]
    row = score_case("01", both, recording, answer("coulomb@joint_2"))
    assert row["partly"] and not row["right"]


def test_twins_are_resolved_when_the_rival_is_gone(recording):
    dahl = Planted("dahl", "joint_2", {"friction": 0.05}, 40.0, 0.9, 0.9, "free")
    told = answer("coulomb@joint_2", "dahl@joint_2")
    told["resolved"] = {
        "designed": {"answer_set": ["coulomb@joint_2"]},
        "random": {"answer_set": ["coulomb@joint_2", "dahl@joint_2"]},
    }
    row = score_case("01", truth("twin", (COULOMB,), dahl), recording, told)
    assert row["both_in_set"] and row["resolved_designed"] and row["resolved_random"] is False
    other = replace(dahl, name="spring")  # once it is planted, another name is left
    assert score_case("01", truth("twin", (other,), COULOMB), recording, told)["resolved_designed"] is False


def test_another_set_is_resolved_when_the_truth_is_left_alone(recording):
    told = answer("coulomb@joint_2", "dahl@joint_2")
    told["resolved"] = {
        "designed": {"answer_set": ["coulomb@joint_2"]},
        "random": {"answer_set": ["coulomb@joint_2", "stribeck@joint_2"]},
    }
    row = score_case("01", truth("single", (COULOMB,)), recording, told)
    assert row["resolved_designed"] is True and row["resolved_random"] is False and row["both_in_set"] is None
    row = score_case("01", truth("outside", (COULOMB,)), recording, told)
    assert row["resolved_designed"] is None


def test_a_failed_diagnosis_said_nothing(recording):
    told = {"diagnosis": {"case": "01", "status": "failed: ValueError: no"}}
    row = score_case("01", truth("single", (COULOMB,)), recording, told)
    assert (row["answer"], row["detected"], row["right"]) == ("none", False, False)


def test_parts_are_gathered_in_order(recording, tmp_path):
    for name, stages in (("02", {"seconds_locating": 1.0}), ("01", {"seconds_fitting": 2.0, "seconds_locating": 1.0})):
        row = score_case(name, truth("single", (COULOMB,)), recording, answer("coulomb@joint_2"))
        (tmp_path / name).write_text(as_lines([row | stages | {"job_seconds": 1.0}]))
    table = gather([tmp_path / "02", tmp_path / "01"])
    assert table.case.tolist() == ["01", "02"] and list(table.columns[: len(COLUMNS)]) == COLUMNS
    assert list(table.columns) == list(gather([tmp_path / "01", tmp_path / "02"]).columns)
    assert list(table.columns[-3:]) == ["seconds_fitting", "seconds_locating", "job_score"]


@pytest.mark.skipif(not REFERENCE.exists(), reason=f"the benchmark's table was not committed yet: {REFERENCE}")
def test_the_readmes_show_the_committed_measures():
    shown = marked(REFERENCE.with_name("README.md"), "concealed")
    assert shown == claim.to_markdown(case_table.read_cases(REFERENCE))
    head, *rows = [line for line in shown.splitlines() if line.startswith("|") and "| – | – |" not in line]
    assert marked(ROOT / "docs" / "benchmark.md", "bars").splitlines() == [
        head,
        *rows[: rows.index(head)],
    ]  # the comparators' is next
