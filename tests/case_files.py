"""The case that the tests of readers share: an arm, its log of 3 s, and ways to change either."""

from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import yaml

MODEL = """<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 -1 0" damping="0.02" range="-170 170"/>
      <geom name="upper" type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.5" contype="0" conaffinity="0"/>
      <body name="lower" pos="0 0 -0.3">
        <joint name="elbow" axis="0 -1 0" damping="0.02" range="-170 170"/>
        <geom name="lower" type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.2" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="shoulder" joint="shoulder"/><motor name="elbow" joint="elbow"/></actuator>
  <sensor><jointpos name="q1" joint="shoulder"/><jointactuatorfrc name="felt" joint="elbow"/></sensor>
</mujoco>"""
TOSS = """<mujoco><worldbody><body name="cube"><freejoint/><geom size="0.05" mass="0.3"/></body></worldbody></mujoco>"""

CASE = {
    "model": "arm.xml",
    "time": {"column": "t", "unit": "s"},
    "runs": [{"file": "a.csv"}, {"file": "b.csv", "held_out": True}],
    "commands": {"shoulder": {"column": "u1", "unit": "N m"}, "elbow": {"column": "u2", "unit": "N m"}},
    "measurements": {
        "q1": {"column": "q1", "unit": "rad"},
        "elbow": {"column": "q2", "unit": "rad", "noise": 0.001},
        "elbow speed": {"joint": "elbow", "column": "v2", "unit": "rad/s"},
    },
    "unknowns": [{"field": "mass", "site": "lower", "sd": 0.2}],
    "window": 0.5,
}


@cache
def motion(seed: int) -> dict[str, np.ndarray]:
    """Columns of 3 s of the arm's motion under smooth torques, every 4 ms."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    rates, phases = rng.uniform(3, 9, (2, 2)), rng.uniform(0, 6, (2, 2))
    rows = []
    for k in range(751):
        t = 0.004 * k
        data.ctrl[:] = [0.6, 0.15] * np.sin(rates * t + phases).sum(axis=0)
        rows.append([t, *data.ctrl, *data.qpos, *data.qvel])
        mujoco.mj_step(model, data, 2)
    return dict(zip(("t", "u1", "u2", "q1", "q2", "v1", "v2"), np.array(rows).T, strict=True))


def write_csv(path: Path, columns: dict) -> None:
    """A CSV of columns; None and "" are empty cells."""
    rows = zip(*[list(values) for values in columns.values()], strict=True)
    lines = [",".join(columns), *(",".join("" if value is None else str(value) for value in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_case(folder: Path, case: dict) -> Path:
    """Write the case of the arm, its model and its data."""
    for name, seed in (("a.csv", 1), ("b.csv", 2)):
        dates = [f"2024-05-01T12:00:{t:012.9f}" for t in motion(seed)["t"]]
        write_csv(folder / name, motion(seed) | {"date": dates, "t2": motion(seed)["t"] + 1e5})
    return write_case_of(folder, case, MODEL)


def write_case_of(folder: Path, case: dict, model: str) -> Path:
    """Write the case and its model."""
    (folder / "arm.xml").write_text(model, encoding="utf-8")
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(case, allow_unicode=True, sort_keys=False), encoding="utf-8")
    return path


def altered(**changes) -> dict:
    """The good case with other top-level keys; a function gets the old value."""
    old = yaml.safe_load(yaml.safe_dump(CASE, sort_keys=False))
    return old | {key: change(old.get(key)) if callable(change) else change for key, change in changes.items()}


def column(name: str, change) -> dict:
    """Both files with one column changed."""
    return {file: motion(seed) | {name: change(motion(seed)[name])} for file, seed in (("a.csv", 1), ("b.csv", 2))}


def swapped(one: str, other: str) -> dict:
    """Both files with two columns exchanged."""
    return {f: motion(s) | {one: motion(s)[other], other: motion(s)[one]} for f, s in (("a.csv", 1), ("b.csv", 2))}


def at(row: int, value: float):
    """A change of one row."""
    return lambda values: np.concatenate([values[:row], [value], values[row + 1 :]])


def entry(name: str, **keys):
    """A change of one measurement or command."""
    return lambda table: table | {name: table[name] | keys}
