"""From a case to its page: the same each time, and a model that needs nothing of ours."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from test_cases import RECORDINGS, ROOT, write_csv
from test_model import XML, diagnosis_of, record

from fimpact.cases import read_case
from fimpact.cli import main
from fimpact.diagnose_recording import diagnose_recording
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch.model import check_model, write_model

CASE = {
    "model": "rod.xml",
    "time": {"column": "t", "unit": "s"},
    "runs": [{"file": "a.csv"}, {"file": "b.csv"}, {"file": "c.csv", "held_out": True}],
    "commands": {"motor": {"column": "u", "unit": "N m"}},
    "measurements": {"angle": {"column": "q", "unit": "rad"}},
    "unknowns": [{"field": "mass", "site": "rod", "sd": 0.2}],
    "window": 0.2,
}


@pytest.fixture(scope="module")
def case(tmp_path_factory) -> Path:
    """A small case: a pendulum with a dry pivot, three runs of 0.4 s."""
    folder = tmp_path_factory.mktemp("rod")
    recording = record(0.02)
    for name, run in zip("abc", recording.runs[2:], strict=False):
        rows = range(len(run.measured))
        time = [f"{k * recording.period:.2f}" for k in rows]
        write_csv(folder / f"{name}.csv", {"t": time, "u": run.ctrl[:, 0].tolist(), "q": run.measured[:, 0].tolist()})
    (folder / "rod.xml").write_text(XML)
    (folder / "case.yaml").write_text(yaml.safe_dump(CASE))
    return folder / "case.yaml"


def test_the_same_case_gives_the_same_bytes_in_another_process(case, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    one, other = tmp_path / "one", tmp_path / "other"
    diagnose_recording(case, None, one, lambda line: None)
    command = [sys.executable, "-m", "fimpact.cli", "diagnose", str(case), "--out", str(other)]
    done = subprocess.run(command, env=os.environ | {"PYTHONHASHSEED": "1"}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    files = {path.relative_to(one) for path in one.rglob("*") if path.is_file()}
    assert not list(one.rglob("__pycache__"))
    assert {Path(name) for name in ("diagnosis.json", "report.html", "figures/motion.gif", "improved.xml")} <= files
    assert files == {path.relative_to(other) for path in other.rglob("*") if path.is_file()}
    for name in files:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name


def test_a_folder_that_is_not_ours_is_refused_before_the_work(case, tmp_path, monkeypatch, capsys):
    (tmp_path / "thesis.tex").touch()
    monkeypatch.setattr("fimpact.diagnose_recording.diagnose", lambda *_: pytest.fail("an hour's work was lost"))
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
    diagnosis = diagnosis_of(recording, Placed(EFFECTS["linear_drag"], "ball", {"coefficient": 0.01}))
    assert diagnosis.evidence.after < 0.5 * diagnosis.evidence.before
    written = write_model(diagnosis, tmp_path)
    assert tmp_path / "improved.xml" in written.files
    assert check_model(diagnosis, tmp_path) < 0.02
    subprocess.run([sys.executable, "-c", PLAIN], cwd=tmp_path, check=True)


def test_effects_that_are_insisted_on_are_fitted_and_no_others(case, tmp_path, capsys):
    code = main(["fit", str(case), "coulomb@pivot", "viscous@pivot", "-o", str(tmp_path / "fit.json")])
    said = capsys.readouterr().out.splitlines()
    found = json.loads((tmp_path / "fit.json").read_text())
    mass, friction, damping = found["parameters"]
    assert code == 0 and [row["of"] for row in found["parameters"]] == ["mass@rod", "coulomb@pivot", "viscous@pivot"]
    # The robot is damped less than its model, which no further damping mends, and less dry friction partly does.
    assert mass["low"] < 0.3 < mass["high"] and 0.005 < friction["after"] < 0.02 and damping["after"] == 0
    assert found["evidence"]["improvement"] > 0.5
    assert [line.partition(" ")[0] for line in said] == ["mass", "coulomb", "viscous", "held-out"]


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


def test_what_no_training_run_shows_is_not_insisted_on(case, capsys, monkeypatch):
    monkeypatch.setattr("fimpact.fit_recording.insisted", lambda made, naive, places: naive)
    assert main(["fit", str(case), "coulomb@pivot"]) == 2
    assert "coulomb@pivot: the training runs" in capsys.readouterr().err
