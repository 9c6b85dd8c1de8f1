"""What others make of the same recording: judged alike, and never at the cost of the table."""

import json
import time

import numpy as np
import pandas as pd
import pytest
from recorded import rod

from fimpact.benchmark.comparators import compare_recording as module
from fimpact.benchmark.comparators import concealed_cases as concealed_peers
from fimpact.benchmark.comparators.compare_recording import DONE, at_most, compare_recording
from fimpact.benchmark.comparators.free_parameters import freed_knobs, own_knobs
from fimpact.benchmark.comparators.rig_summary import COLUMNS, gather, in_cell, summarise, to_markdown
from fimpact.benchmark.comparators.toolboxes import training_windows
from fimpact.diagnosis.freed_model import freed
from fimpact.effects import EFFECTS as CATALOGUE
from fimpact.smoothing.prepare import prepare


@pytest.fixture(scope="module")
def dry():
    return rod(0.03, free=True)


def test_every_peer_has_an_error_for_every_held_out_run(dry):
    lines = []
    table = compare_recording(dry, 60, lines.append)
    assert list(table.columns) == ["peer", "run", "error", "unit", "seconds", "status"]
    assert table.groupby("peer").run.apply(list).to_dict() == {peer: ["run_2"] for peer in module.PEERS}
    assert (table.status == DONE).all() and (table.unit == "rad").all() and len(lines) == 3
    error = table.groupby("peer").error.mean()
    assert error.sysid_freed < error.sysid  # with friction among what it frees, it finds what is missing


def test_a_peer_that_fails_or_is_late_leaves_an_empty_cell_and_a_reason(dry, monkeypatch):
    def fails(recording):
        raise RuntimeError("singular\nmatrix")

    peers = {"fails": fails, "late": lambda recording: time.sleep(5)}
    monkeypatch.setattr(module, "PEERS", peers)
    table = compare_recording(dry, 0.1, lambda line: None)
    assert table.error.isna().all() and list(table.run) == ["run_2"] * 2
    assert list(table.status) == ["RuntimeError: singular matrix", "stopped after 0.1 s, its time limit"]


def test_a_time_limit_ends_with_what_it_limits():
    with pytest.raises(TimeoutError, match=r"0\.05 s"), at_most(0.05):
        time.sleep(1)
    with at_most(0.05):
        pass
    time.sleep(0.1)


def test_what_is_freed_is_within_bounds_on_the_scale_of_the_motion(dry):
    more = freed(dry)
    assert [unknown.name for unknown in more.unknowns] == [
        "mass@rod", "damping@pivot", "frictionloss@pivot", "armature@pivot",
    ]  # fmt: skip
    knobs = freed_knobs(prepare(more))
    assert (knobs.low < knobs.start).all() and (knobs.start < knobs.high).all()
    assert 0.02 < knobs.high[2] < 100


def test_own_parameters_start_where_the_model_has_them_and_stay_positive(dry):
    knobs = own_knobs(prepare(dry))
    assert knobs.start == pytest.approx([0.3, 0.02]) and knobs.sd == pytest.approx([0.09, 0.01])
    assert (knobs.low > 0).all() and knobs.low[0] == pytest.approx(3e-4) and (knobs.high > knobs.start).all()


def test_refitting_every_candidate_finds_the_one_that_is_missing(dry, monkeypatch):
    few = {name: CATALOGUE[name] for name in ("coulomb", "gravity_scale")}
    monkeypatch.setattr(concealed_peers, "EFFECTS", few)
    found = concealed_peers.compare(dry, ["refit_all"])
    assert found["answer_refit_all"] == "coulomb@pivot" and found["refits"] == 2
    assert np.isfinite(found["heldout_refit_all"]) and found["refit_all_seconds"] > found["screening_seconds"]


def test_others_fit_short_windows_of_the_training_runs(dry):
    windows = training_windows(prepare(dry))
    assert windows.length == 100 and windows.names == ("run_0", "run_1") and len(windows.runs) == 8


def row(name: str, value: float, low: float | None, high: float) -> dict:
    return {"name": name, "unit": "N m", "value": value, "low": low, "high": high}


EFFECTS = [
    {"name": "coulomb@j1", "tier": "certain", "coefficients": [row("friction", 0.03, 0.028, 0.032)]},
    {"name": "viscous@j1", "tier": "certain", "coefficients": [row("damping", 0.1, 0.05, 0.15)]},
    {"name": "play@j2", "tier": "possible", "coefficients": [row("gap", 0.01, None, 1.0)]},
    {"name": "dahl@j1", "tier": "small", "coefficients": []},
]


@pytest.fixture
def made(tmp_path):
    """Files of two rigs, of one of which a peer failed."""
    diagnoses, compared = {}, {}
    for rig, errors in {"arm": [0.3, None], "cart_2": [0.2, 0.1]}.items():
        runs = [{"run": run, "error_naive": 2.0, "error_improved": 0.05, "noise_floor": 0.01} for run in ("007", "b")]
        found = {"verdict": f"Missing: {rig} | friction.", "held_out": {"unit": "rad", "runs": runs}}
        found |= {"effects": EFFECTS, "quanta": 120.0, "converged": True}
        (tmp_path / rig).mkdir()
        diagnoses[rig], compared[rig] = tmp_path / rig / "diagnosis.json", tmp_path / f"{rig}.csv"
        diagnoses[rig].write_text(json.dumps(found))
        (tmp_path / rig / "timing.json").write_text('{"seconds": 12.5}')
        rows = [("sysid_freed", run, error) for run, error in zip(("007", "b"), errors, strict=True)]
        rows += [("blackbox", run, 0.4) for run in ("007", "b")] + [("sysid", "b", 1.0)]
        pd.DataFrame(rows, columns=["peer", "run", "error"]).assign(unit="rad").to_csv(compared[rig], index=False)
    return diagnoses, compared


def test_the_summary_has_a_row_per_rig_and_run(made):
    table = summarise(*made)
    assert tuple(table.columns) == COLUMNS
    assert list(zip(table.rig, table.run, strict=True)) == [(r, n) for r in ("arm", "cart_2") for n in ("007", "b")]
    assert table.error_freed.tolist()[0] == 0.3 and np.isnan(table.error_freed[1])
    assert (table.seconds == 12.5).all() and (table.quanta == 120).all() and table.converged.all()
    assert (table.error_blackbox == 0.4).all() and (table.error_improved == 0.05).all()
    assert list(gather(made[1]).columns) == ["rig", "peer", "run", "error", "unit"]


def test_effects_fit_into_a_cell_with_their_values():
    assert in_cell(EFFECTS, "certain") == "coulomb@j1:friction=0.03±0.002;viscous@j1:damping=0.1±0.05"
    assert in_cell(EFFECTS, "possible") == "play@j2:gap=0.01±inf"


def test_the_table_for_readers_has_a_row_per_rig(made):
    lines = to_markdown(summarise(*made)).splitlines()
    assert len(lines) == 4 and all(line.count("|") == 10 for line in lines)
    assert "cart 2 | 2 | 2 rad | 150 mrad | 400 mrad | 50 mrad | 10 mrad | 12 |" in lines[3]
    lost = summarise(*made).assign(error_improved=[0.1, np.nan] * 2)  # no median of the runs that went well
    assert "| – | 10 mrad |" in to_markdown(lost)
    empty = summarise(*made).assign(error_freed=np.nan)
    assert "| – |" in to_markdown(empty)
