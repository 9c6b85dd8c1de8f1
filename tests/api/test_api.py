"""The public API: the same answers as the command line, from files or from data frames, and nothing at import."""

import json
import runpy
import subprocess
import sys
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import ROOT
from diagnosed import rubbing, undecided
from recorded import ROD, record, rod, waves

import fimpact
from fimpact.api.diagnosis import Diagnosis
from fimpact.diagnosis.pipeline import to_json

CASE = {
    "model": "rod.xml",
    "time": {"column": "t", "unit": "s"},
    "runs": [{"file": "a.csv"}, {"file": "b.csv", "held_out": True}],
    "commands": {"motor": {"column": "u", "unit": "N m"}},
    "measurements": {"angle": {"column": "q", "unit": "rad"}},
    "window": 0.5,
}
TABLES = {key: (table["column"], table["unit"]) for key, table in (CASE["commands"] | CASE["measurements"]).items()}
ENTRIES = {"commands": {"motor": TABLES["motor"]}, "measurements": {"angle": TABLES["angle"]}, "window": 0.5}


@pytest.fixture(scope="module")
def frames():
    """Logs of a rod with dry friction, by the name of their run."""
    commands = [waves(300, [0.5], seed) for seed in range(2)]
    recording = record(ROD, ("angle",), commands, 1e-3, lambda model: model.dof_frictionloss.__setitem__(0, 0.02))
    return {
        name: pd.DataFrame({"t": np.arange(300) * 0.01, "u": run.ctrl[:, 0], "q": run.measured[:, 0]})
        for name, run in zip("ab", recording.runs, strict=True)
    }


@pytest.fixture
def folder(frames, tmp_path, monkeypatch):
    """A folder with the model, the logs and the case, which is where the test works."""
    (tmp_path / "rod.xml").write_text(ROD)
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(CASE))
    for name, frame in frames.items():
        frame.to_csv(tmp_path / f"{name}.csv", index=False)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_importing_loads_no_library_and_sets_nothing():
    code = (
        "import os, sys; before = dict(os.environ); import fimpact; fimpact.__version__; dir(fimpact); "
        "print(before == dict(os.environ), [m for m in ('jax', 'matplotlib', 'mujoco', 'numpy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "True []\n", done.stderr


def test_what_computes_with_jax_sets_it_up():
    code = "import jax; import fimpact.paper.information.fisher; print(jax.numpy.zeros(1).dtype)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "float64\n", done.stderr


def test_the_package_runs_as_a_module():
    done = subprocess.run([sys.executable, "-m", "fimpact", "--version"], capture_output=True, text=True)
    assert done.stdout == f"fimpact {fimpact.__version__}\n"


def test_every_public_name_has_a_type():
    stub = (ROOT / "src" / "fimpact" / "__init__.pyi").read_text()
    assert all(hasattr(fimpact, name) and (f" as {name}\n" in stub or f"{name}: " in stub) for name in dir(fimpact))
    with pytest.raises(AttributeError, match="it has CaseError, Diagnosis"):
        fimpact.diagnos  # noqa: B018


def test_files_a_dict_and_data_frames_are_the_same_recording(folder, frames):
    of_file, of_dict = fimpact.read_case("case.yaml"), fimpact.read_case(CASE)
    of_frames = fimpact.Recording.from_frames("rod.xml", frames, time=("t", "s"), **ENTRIES)
    for own in (of_dict, of_frames):
        assert (own.xml, own.period, own.channels) == (of_file.xml, of_file.period, of_file.channels)
        assert [(run.name, run.held_out) for run in own.runs] == [("a", False), ("b", True)]
        for run, other in zip(own.runs, of_file.runs, strict=True):
            np.testing.assert_allclose(run.ctrl, other.ctrl, atol=1e-12)
            np.testing.assert_allclose(run.measured, other.measured, atol=1e-12)
    assert of_dict.origin.keys() | {"case.yaml"} == of_file.origin.keys() == {"case.yaml", "rod.xml", "a.csv", "b.csv"}
    assert of_frames.origin.keys() == {"model", "run a", "run b"}


def test_a_time_index_a_rate_and_a_gap_are_read(folder, frames):
    both = [frame.copy() for frame in frames.values()]
    both[0].loc[100:104, "q"] = np.nan
    indexed = fimpact.Recording.from_frames(
        "rod.xml", [frame.set_index("t") for frame in both], time=("t", "s"), held_out=[0], **ENTRIES
    )
    rated = fimpact.Recording.from_frames("rod.xml", both, rate=100.0, held_out=["run 0"], **ENTRIES)
    for own in (indexed, rated):
        assert [run.name for run in own.held_out] == ["run 0"] and [run.name for run in own.training] == ["run 1"]
        assert np.isnan(own.frame()["angle"]).sum() == 5 and own.frame("run 0").index.name == "time_s"
    assert "1 runs to fit, 3 s" in repr(indexed) and "judges" in indexed._repr_html_()


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"time": None}, "give either `time`"),
        ({"measurements": {"angle": "q"}}, "'angle' is 'q'; allowed: a column and its unit"),
        ({"measurements": {"angle": ("q", "furlong")}}, "furlong"),
        ({"held_out": ["c"]}, "held_out names 'c', which is no run; allowed: a, b"),
        ({"windw": 1}, "windw"),
        ({"frames": {}}, "one data frame is one run"),
        ({"frames": {"a": [1, 2]}}, "a is a list; allowed: data frames"),
        ({"model": "none.xml"}, "none.xml does not exist"),
    ],
)
def test_what_is_wrong_with_frames_is_one_line(folder, frames, changed, said):
    given = {"model": "rod.xml", "frames": frames, "time": ("t", "s"), **ENTRIES} | changed
    with pytest.raises(fimpact.CaseError) as raised:
        fimpact.Recording.from_frames(given.pop("model"), given.pop("frames"), **given)
    assert said in str(raised.value) and "\n" not in str(raised.value)


def test_a_diagnosis_is_tables_pictures_and_a_page(tmp_path):
    found = Diagnosis(rubbing())
    assert found.verdict == rubbing().verdict in repr(found) and found.answer == "coulomb@pivot"
    row = found.effects.iloc[0]
    assert (row.effect, row.site, row.parameter, row.unit) == ("coulomb", "pivot", "friction", "N m")
    assert row.low < row.value < row.high and row.value == pytest.approx(0.03, rel=0.2)
    (joint,) = found.missing_force.to_dict("records")
    assert joint["joint"] == "pivot" and joint["left"] < joint["naive"]
    run = found.result.recording.training[0]
    series = found.missing_force_in(run.name)
    assert list(series) == ["pivot"] and len(series) == len(run.measured)
    assert np.abs(found.missing_force_in(run.name, improved=True)).mean().iloc[0] < np.abs(series).mean().iloc[0]
    with pytest.raises(ValueError, match="allowed: "):
        found.missing_force_in("sunday")
    assert "<td>coulomb</td>" in found._repr_html_()
    before = plt.get_fignums()
    pictures = [found.plot_missing_force(), found.plot_joints(), found.plot_held_out()]
    assert all(picture.axes[0].get_xlabel() for picture in pictures) and plt.get_fignums() == before  # not shown twice
    assert found.held_out.attrs["unit"] == "rad" and {"error_naive", "error_improved"} <= set(found.held_out)
    assert json.loads((found.save(tmp_path / "page").parent / "diagnosis.json").read_text())["verdict"] == found.verdict


def test_an_experiment_is_designed_and_a_further_run_decides():
    found = Diagnosis(undecided())
    assert fimpact.design_experiment(Diagnosis(rubbing())) is None
    experiment = fimpact.design_experiment(found)
    assert list(experiment.commands) == ["motor"] and experiment.commands.index[-1] < experiment.seconds
    assert experiment.pairs.loc[0, "separation"] > 0 and set(experiment.start["quantity"]) == {"qpos", "qvel"}
    with pytest.raises(fimpact.CaseError, match="no run that was not diagnosed"):
        fimpact.resolve(found, found.result.recording)
    (held,) = found.result.recording.held_out  # what was held out serves as the log of the experiment
    played = replace(found.result.recording, runs=(replace(held, name="played", held_out=False),))
    resolved = fimpact.resolve(found, played)
    assert resolved.weights["name"].iloc[0] == "coulomb@pivot" == resolved.left[0]
    assert resolved.weights["weight"].sum() == pytest.approx(1) and "Left: coulomb@pivot" in resolved._repr_html_()


def test_the_answer_is_that_of_the_command(folder):
    """Through all stages, in its quick form."""
    from fimpact.cli import main

    found = fimpact.diagnose(fimpact.read_case("case.yaml"), quick=True, only="friction")
    found.save("api")
    assert main(["diagnose", "case.yaml", "--out", "cli", "--quick", "--only", "friction"]) == 0
    assert (folder / "api" / "diagnosis.json").read_bytes() == (folder / "cli" / "diagnosis.json").read_bytes()
    with pytest.raises(fimpact.CaseError, match="only: family 'frictoin'"):
        fimpact.diagnose(found.result.recording, only="frictoin")


def test_named_effects_are_fitted():
    fitted = fimpact.fit(rod(0.03, free=True), "coulomb@pivot")
    row = fitted.parameters.set_index("of").loc["coulomb@pivot"]
    assert row["low"] < 0.03 * 1.1 and row["high"] > 0.03 * 0.9 and "held-out error" in fitted.summary


def test_the_catalogue_has_a_row_for_each_effect():
    table = fimpact.catalogue()
    assert table.loc["coulomb", "mjcf"] == "joint frictionloss" and (table["equation"] != "").all()


def test_the_typed_example_has_a_main():
    """It is checked by mypy in strict mode and run in the tutorial; here only that it loads."""
    assert callable(runpy.run_path(str(ROOT / "docs" / "examples" / "from_frames.py"))["main"])


def test_resolving_needs_alike_recordings():
    found = Diagnosis(undecided())
    other = fimpact.Recording(**{**vars(found.result.recording), "period": 0.5})
    with pytest.raises(fimpact.CaseError, match="period"):
        fimpact.resolve(found, other)


def test_the_schema_of_the_page_is_that_of_the_data():
    assert Diagnosis(rubbing()).data == to_json(rubbing())
