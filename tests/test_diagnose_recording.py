"""From a case to its page: the same each time, and a model that needs nothing of ours."""

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
