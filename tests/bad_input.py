"""A small good case, ways to spoil it, and what must hold of every refusal, whatever is wrong."""

import hashlib
import re
from copy import deepcopy
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import yaml

MODEL = """<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <body name="arm">
      <joint name="shoulder" axis="0 1 0" damping="0.02"/>
      <geom name="rod" type="capsule" fromto="0 0 0 0 0 -0.4" size="0.02" mass="0.6"/>
    </body>
  </worldbody>
  <actuator><motor name="drive" joint="shoulder"/></actuator>
</mujoco>
"""
CASE = {
    "model": "arm.xml",
    "time": {"column": "time", "unit": "s"},
    "runs": [{"name": "monday", "file": "monday.csv"}, {"name": "tuesday", "file": "tuesday.csv", "held_out": True}],
    "commands": {"drive": {"column": "torque", "unit": "N m"}},
    "measurements": {"shoulder": {"column": "angle", "unit": "rad"}},
    "unknowns": [{"field": "mass", "site": "arm", "sd": 0.2}],
    "window": 0.5,
}
CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\u202a-\u202e]")
LONGEST = 500  # characters of a line


@cache
def log(pace: float) -> dict[str, np.ndarray]:
    """Columns of 4 s of the arm's motion at 50 Hz."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    data, rows = mujoco.MjData(model), []
    for k in range(200):
        data.ctrl[0] = 0.6 * np.sin(3 * pace * data.time) + 0.3 * np.sin(7 * pace * data.time)
        rows.append((0.02 * k, data.ctrl[0], data.qpos[0]))
        mujoco.mj_step(model, data, 4)
    return dict(zip(("time", "torque", "angle"), np.array(rows).T, strict=True))


def table(columns: dict) -> str:
    """The text of a CSV."""
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(columns), *(",".join(f"{x:.9g}" for x in row) for row in rows)]) + "\n"


def write(folder: Path, case=None, model: str = MODEL, files: dict | None = None) -> Path:
    """Write the case, or its text, with files, each a text, bytes, or a function of its path."""
    logs = {"monday.csv": table(log(1.0)), "tuesday.csv": table(log(1.3))}
    text = case if isinstance(case, str | bytes) else yaml.safe_dump(case or CASE, sort_keys=False)
    for name, content in {"arm.xml": model, "case.yaml": text, **logs, **(files or {})}.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if callable(content):
            content(path)
        else:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder / "case.yaml"


def with_(*path, **changed) -> dict:
    """The good case with other values at the end of `path`."""
    case = deepcopy(CASE)
    at = case
    for key in path:
        at = at[key]
    at.update(changed)
    return case


def altered(**columns) -> dict[str, str]:
    """Both logs with columns that are functions of what they were."""
    both = {"monday.csv": log(1.0), "tuesday.csv": log(1.3)}
    return {name: table(own | {k: law(own[k]) for k, law in columns.items()}) for name, own in both.items()}


def state(folder: Path) -> dict[str, str]:
    """A checksum of every file of a folder, and of folders."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
        for path in folder.rglob("*")
    }


def check_refusal(code: int, said: str, error: str, word: str) -> None:
    """What must hold of every refusal: exit code 2, a line or two for a terminal, which name what is wrong."""
    lines = error.strip().splitlines()
    assert code == 2, (code, said, error)
    assert not said
    assert 1 <= len(lines) <= 2, error
    assert max(map(len, lines)) <= LONGEST
    assert "Traceback" not in error
    assert not CONTROL.search(error), repr(error)
    assert word.lower() in error.lower(), error
