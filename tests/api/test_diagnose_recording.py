"""From a case to its page: the same each time, and a model that needs nothing of ours."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from case_files import write_csv
from conftest import RECORDINGS, ROOT
from diagnosed import diagnosis_of
from recorded import ROD, rod

from fimpact.api.commands.diagnose_recording import diagnose_recording
from fimpact.cases import read_case
from fimpact.cli import main
from fimpact.report.page import write_report

CASE = {
    "model": "rod.xml",
    "time": {"column": "t", "unit": "s"},
    "runs": [{"file": "a.csv"}, {"file": "b.csv"}, {"file": "c.csv", "held_out": True}],
    "commands": {"motor": {"column": "u", "unit": "N m"}},
    "measurements": {"angle": {"column": "q", "unit": "rad"}},
    "unknowns": [{"field": "mass", "site": "rod", "sd": 0.3}, {"field": "damping", "site": "pivot", "sd": 0.5}],
    "window": 0.5,
}


@pytest.fixture(scope="module")
def case(tmp_path_factory) -> Path:
    """A small case: a rod with a dry pivot, three runs of 4 s."""
    folder = tmp_path_factory.mktemp("rod")
    recording = rod(0.03, free=True)
    for name, run in zip("abc", recording.runs, strict=True):
        rows = range(len(run.measured))
        time = [f"{k * recording.period:.2f}" for k in rows]
        write_csv(folder / f"{name}.csv", {"t": time, "u": run.ctrl[:, 0].tolist(), "q": run.measured[:, 0].tolist()})
    (folder / "rod.xml").write_text(ROD)
    (folder / "case.yaml").write_text(yaml.safe_dump(CASE))
    return folder / "case.yaml"


def test_the_same_case_gives_the_same_bytes_in_another_process(case, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    one, other = tmp_path / "one", tmp_path / "other"
    diagnose_recording(case, None, one, lambda line: None)
    command = [sys.executable, "-m", "fimpact.cli", "diagnose", str(case), "--out", str(other)]
    done = subprocess.run(command, env=os.environ | {"PYTHONHASHSEED": "1"}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    timing = json.loads((one / "timing.json").read_text())
    assert 0 < timing["seconds"] < timing["seconds_with_page"]
    files = {path.relative_to(one) for path in one.rglob("*") if path.is_file()} - {Path("timing.json")}
    assert not list(one.rglob("__pycache__"))
    assert {Path(name) for name in ("diagnosis.json", "report.html", "figures/motion.gif", "improved.xml")} <= files
    assert files == {path.relative_to(other) for path in other.rglob("*") if path.is_file()} - {Path("timing.json")}
    for name in files:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name


def test_a_folder_that_is_not_ours_is_refused_before_the_work(case, tmp_path, monkeypatch, capsys):
    (tmp_path / "thesis.tex").touch()
    monkeypatch.setattr(
        "fimpact.api.commands.diagnose_recording.diagnose", lambda *_: pytest.fail("an hour's work was lost")
    )
    assert main(["diagnose", str(case), "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith(f"fimpact: {tmp_path} holds thesis.tex, no report of ours")
    assert main(["diagnose", str(case), "--out", str(tmp_path / "thesis.tex" / "page")]) == 2
    assert "cannot be written or replaced" in capsys.readouterr().err


PLAIN = """
import sys; sys.modules["fimpact"] = None
import mujoco, numpy as np
model = mujoco.MjModel.from_xml_path("improved.xml")
data = mujoco.MjData(model)
for _ in range(100): mujoco.mj_step(model, data)
assert np.isfinite(data.qpos).all()
"""


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason=f"the measured recordings are not there: {RECORDINGS}")
def test_the_improved_model_of_a_rig_needs_plain_mujoco_only(tmp_path):
    recording = read_case(ROOT / "config" / "recordings" / "ball_drops.yaml", RECORDINGS)
    diagnosis = diagnosis_of(recording, ("linear_drag@ball",))
    (row,) = diagnosis.proof.runs
    assert row["error_improved"] < 0.5 * row["error_naive"]
    page = write_report(diagnosis, tmp_path / "page", provenance={})
    model = json.loads((page.parent / "diagnosis.json").read_text())["model"]
    assert "improved.xml" in model["files"] and model["difference"] < 0.02
    subprocess.run([sys.executable, "-c", PLAIN], cwd=page.parent, check=True)


def test_effects_that_are_insisted_on_are_fitted_and_no_others(case, tmp_path, capsys):
    code = main(["fit", str(case), "coulomb@pivot", "-o", str(tmp_path / "fit.json")])
    said = capsys.readouterr().out.splitlines()
    found = json.loads((tmp_path / "fit.json").read_text())
    assert code == 0 and [row["of"] for row in found["parameters"]] == [
        "mass@rod", "damping@pivot", "coulomb@pivot",
    ]  # fmt: skip
    mass, damping, friction = found["parameters"]
    assert mass["low"] < 0.3 < mass["high"] and friction["after"] == pytest.approx(0.03, rel=0.03)
    assert damping["naive"] != damping["after"] == pytest.approx(0.02, rel=0.1)
    (run,) = found["held_out"]["runs"]
    assert run["error_improved"] < 0.6 * run["error_naive"]
    assert [line.partition(" ")[0] for line in said] == ["mass", "damping", "coulomb", "held-out"]


def test_fit_and_diagnose_have_the_same_naive_error(case, tmp_path, capsys):
    main(["fit", str(case), "coulomb@pivot", "-o", str(tmp_path / "fit.json")])
    fitted = json.loads((tmp_path / "fit.json").read_text())["held_out"]
    proof = diagnosis_of(read_case(case), ("coulomb@pivot",)).proof
    assert (
        fitted["unit"] == proof.unit and f"naive fit: {proof.runs[0]['error_naive']:.3g} rad" in capsys.readouterr().out
    )
    assert fitted["runs"][0]["error_naive"] == pytest.approx(proof.runs[0]["error_naive"], rel=1e-9)


def test_what_is_left_out_of_a_brief_diagnosis_changes_no_answer(case):
    whole, brief = (diagnosis_of(read_case(case), ("coulomb@pivot",), brief=own) for own in (False, True))
    assert (brief.answer, brief.verdict) == (whole.answer, whole.verdict)
    assert len(whole.proof.horizons) > len(brief.proof.horizons) == 1 and whole.remainder["held_out"]
    assert not brief.remainder["held_out"] and "freed" not in brief.proof.curves
    for row, own in zip(whole.proof.runs, brief.proof.runs, strict=True):
        for name in ("error_naive", "error_improved"):
            assert own[name] == pytest.approx(row[name], rel=0.05)


@pytest.mark.parametrize(
    ("names", "complaint"),
    [
        (["coulomb"], "write EFFECT@SITE"),
        (["warp@pivot"], "effect 'warp' not found"),
        (["coulomb@elbow"], "site of coulomb 'elbow' does not exist; allowed: pivot"),
        (["coulomb@pivot", "coulomb@pivot"], "said twice"),
        (["coulomb@pivot", "-o", "nowhere/fit.json"], "nowhere is not a folder"),
        (["coulomb@pivot", "-o", "."], ". is a folder; name a file"),
    ],
)
def test_what_cannot_be_insisted_on_is_said_in_a_line(case, capsys, names, complaint):
    assert main(["fit", str(case), *names]) == 2
    said = capsys.readouterr()
    assert complaint in said.err and said.err.count("\n") == 1 and not said.out


def test_a_fit_that_does_not_converge_is_not_used_as_if_it_had(case, capsys, monkeypatch):
    from fimpact.api.commands import fit_recording as module

    fitted = module.fit_forced
    monkeypatch.setattr(module, "fit_forced", lambda *given: replace(fitted(*given), converged=False))
    assert main(["fit", str(case), "coulomb@pivot"]) == 2
    assert "the fit with coulomb@pivot does not converge" in capsys.readouterr().err
