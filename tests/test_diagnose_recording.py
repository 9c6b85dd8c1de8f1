"""From a case to its page: the same each time, and a model that needs nothing of ours."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from test_cases import RECORDINGS, ROOT, write_csv
from test_model import XML, record

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


def diagnosed(case: Path, out: Path, *options: str, seed: int = 0) -> Path:
    """The folder that a process of its own wrote."""
    command = [sys.executable, "-m", "fimpact.cli", "diagnose", case.name, "--out", str(out), *options]
    environment = os.environ | {"PYTHONHASHSEED": str(seed)}
    done = subprocess.run(command, cwd=case.parent, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out


def test_the_same_case_gives_the_same_bytes_in_another_process(case, tmp_path):
    first, second = (diagnosed(case, tmp_path / name, seed=seed) for name, seed in (("one", 1), ("other", 2)))
    files = {path.relative_to(first) for path in first.rglob("*") if path.is_file()}
    assert {Path("diagnosis.json"), Path("report.html"), Path("figures/motion.gif")} <= files
    assert files == {path.relative_to(second) for path in second.rglob("*") if path.is_file()}
    for name in files:
        assert (first / name).read_bytes() == (second / name).read_bytes(), name
