"""What others make of the same recording: judged alike, and never at the cost of the table."""

import json
import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from test_model import XML, diagnosis_of, record

from fimpact import compare_recording as module
from fimpact.compare_recording import DONE, at_most, compare_recording
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.knobs import freed, freed_knobs
from fimpact.mismatch.judge import bench
from fimpact.mismatch.per_run import NOISE, error_per_run, floor_per_run, unit_of
from fimpact.rig_summary import COLUMNS, gather, summarise, to_markdown


@pytest.fixture(scope="module")
def dry():
    return record(0.02)


def test_every_peer_has_an_error_for_every_held_out_run(dry):
    lines = []
    table = compare_recording(dry, 60, lines.append)
    assert list(table.columns) == ["peer", "run", "error", "unit", "seconds", "status"]
    assert table.groupby("peer").run.apply(list).to_dict() == {peer: ["run 4", "run 5"] for peer in module.PEERS}
    assert (table.status == DONE).all() and (table.unit == "rad").all() and len(lines) == 3
    error = table.groupby("peer").error.mean()
    assert error.sysid_freed < error.sysid  # with friction among what it frees, it finds what is missing


def test_a_peer_that_fails_or_is_late_leaves_an_empty_cell_and_a_reason(dry, monkeypatch):
    def fails(recording):
        raise RuntimeError("singular\nmatrix")

    peers = {"fails": fails, "late": lambda recording: time.sleep(5)}
    monkeypatch.setattr(module, "PEERS", peers)
    table = compare_recording(dry, 0.1, lambda line: None)
    assert table.error.isna().all() and list(table.run) == ["run 4", "run 5"] * 2
    assert list(table.status[::2]) == ["RuntimeError: singular matrix", "stopped after 0.1 s, its time limit"]


def test_a_time_limit_ends_with_what_it_limits():
    with pytest.raises(TimeoutError, match=r"0\.05 s"), at_most(0.05):
        time.sleep(1)
    with at_most(0.05):
        pass
    time.sleep(0.1)


def test_what_is_freed_is_within_bounds_on_the_scale_of_the_motion(dry):
    more = freed(dry)
    assert [unknown.name for unknown in more.unknowns] == [
        "mass@rod", "damping@pivot", "frictionloss@pivot", "armature@pivot", "friction@bar",
    ]  # fmt: skip
    knobs = freed_knobs(bench(more).training)
    assert (knobs.low < knobs.start).all() and (knobs.start < knobs.high).all()
    assert 0.02 < knobs.high[2] < 100


def test_errors_per_run_are_in_the_unit_of_the_measurement(dry):
    diagnosis = diagnosis_of(dry, Placed(EFFECTS["coulomb"], "pivot", {"friction": 0.015}))
    made, naming, evidence = diagnosis.bench, diagnosis.naming, diagnosis.evidence
    errors, floors = error_per_run(made, naming.best.judged), floor_per_run(made)
    assert unit_of(made) == "rad" and list(errors) == list(floors) == ["run 4", "run 5"]
    assert np.sqrt(np.mean(np.square(list(errors.values())))) == pytest.approx(evidence.by_channel["angle"][1])
    assert all(0.5 * floors[run] < errors[run] < 2 * floors[run] for run in errors)
    assert all(2e-5 < floor < 2e-4 for floor in floors.values())


def test_channels_of_several_units_are_told_in_the_one_that_most_have(dry):
    sensors = '<jointvel name="rate" joint="pivot"/><jointpos name="angle" joint="pivot"/>'
    xml = XML.replace('<jointpos name="angle" joint="pivot"/>', sensors)
    channels = {"rad/s": ("rate", "angle"), "rad": ("angle", "rate")}
    for unit, names in channels.items():
        runs = tuple(replace(run, measured=np.repeat(run.measured, 2, 1)) for run in dry.runs)
        noise = np.array([0.01 if name == "rate" else 2e-4 for name in names])
        made = bench(replace(dry, xml=xml, channels=names, noise=noise, runs=runs))
        assert unit_of(made) == unit
        assert max(floor_per_run(made).values()) < noise[0]
        assert min(floor_per_run(made).values()) > 0.5 * noise[0]


def test_channels_without_a_unit_are_told_in_standard_deviations(dry, monkeypatch):
    monkeypatch.setattr("fimpact.mismatch.per_run.channel_unit", lambda model, channel: "")
    made = bench(dry)
    assert unit_of(made) == NOISE and all(0.5 < floor < 1 for floor in floor_per_run(made).values())


@pytest.fixture
def made(tmp_path):
    """Files of two rigs, of one of which a peer failed."""
    diagnoses, compared = {}, {}
    for rig, errors in {"arm": [0.3, None], "cart_2": [0.2, 0.1]}.items():
        runs = [{"run": run, "error_naive": 2.0, "error_improved": 0.05, "noise_floor": 0.01} for run in ("007", "b")]
        found = {"verdict": f"Missing: {rig} | friction.", "held_out": {"unit": "rad", "runs": runs}}
        diagnoses[rig], compared[rig] = tmp_path / f"{rig}.json", tmp_path / f"{rig}.csv"
        diagnoses[rig].write_text(json.dumps(found))
        rows = [("sysid_freed", run, error) for run, error in zip(("007", "b"), errors, strict=True)]
        rows += [("blackbox", run, 0.4) for run in ("007", "b")] + [("sysid", "b", 1.0)]
        pd.DataFrame(rows, columns=["peer", "run", "error"]).assign(unit="rad").to_csv(compared[rig], index=False)
    return diagnoses, compared


def test_the_summary_has_a_row_per_rig_and_run(made):
    table = summarise(*made)
    assert tuple(table.columns) == COLUMNS
    assert list(zip(table.rig, table.run, strict=True)) == [(r, n) for r in ("arm", "cart_2") for n in ("007", "b")]
    assert table.error_peer_freed.tolist()[0] == 0.3 and np.isnan(table.error_peer_freed[1])
    assert (table.error_blackbox == 0.4).all() and (table.error_improved == 0.05).all()
    assert list(gather(made[1]).columns) == ["rig", "peer", "run", "error", "unit"]


def test_the_table_for_readers_has_a_row_per_rig(made):
    lines = to_markdown(summarise(*made)).splitlines()
    assert len(lines) == 4 and all(line.count("|") == 9 for line in lines)
    assert "cart 2 | 2 | 2 rad | 150 mrad | 400 mrad | 50 mrad | 10 mrad |" in lines[3]
    lost = summarise(*made).assign(error_improved=[0.1, np.nan] * 2)  # no median of the runs that went well
    assert "| – | 10 mrad |" in to_markdown(lost)
    empty = summarise(*made).assign(error_peer_freed=np.nan)
    assert "| – |" in to_markdown(empty)
