"""From files to a recording: what comes back, and what is refused in one line."""

import pickle
import re
import struct
import zlib
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pyarrow as pa
import pytest
import scipy.io
import yaml
from case_files import (
    CASE,
    MODEL,
    TOSS,
    altered,
    at,
    column,
    entry,
    motion,
    swapped,
    write_case,
    write_case_of,
    write_csv,
)
from conftest import RECORDINGS, ROOT
from mcap_ros2.writer import Writer
from pyarrow import parquet

from fimpact.cases import CaseError, inputs, read_case
from fimpact.cases.models.naive import name_free_joints
from fimpact.cases.readers.files import read_table
from fimpact.cases.resampling import Series, on_grid, zero_order_hold
from fimpact.cases.units import factor
from fimpact.cli import main
from fimpact.simulation.state_guess import noise_level

RIGS = sorted(path.stem for path in (ROOT / "config" / "recordings").glob("*.yaml") if path.stem != "sources")


def evil() -> bytes:
    """A pickle that would write a file."""

    class Evil:
        def __reduce__(self):
            return open, ("owned", "w")

    return pickle.dumps(np.array([Evil()], dtype=object))


def hostile_npz(path: Path) -> None:
    np.savez(path, t=np.arange(9.0), q1=np.array([{"a": 1}, None], dtype=object))


def opaque_mat(path: Path) -> None:
    """A MATLAB v5 file with an object of a class, as `save` writes them."""
    scipy.io.savemat(path, {"t": np.arange(9.0)})
    flags = struct.pack("<IIII", 6, 8, 3, 0)  # class 3: mxOBJECT_CLASS
    name = struct.pack("<II", 1, 1) + b"q" + bytes(7)
    kind = struct.pack("<II", 1, 4) + b"evil" + bytes(4)
    body = flags + struct.pack("<IIii", 5, 8, 1, 1) + name + kind
    element = struct.pack("<II", 14, len(body)) + body
    with open(path, "ab") as file:
        packed = zlib.compress(element)
        file.write(struct.pack("<II", 15, len(packed)) + packed)


DATA = {  # data that replaces a.csv and b.csv -> what the line must say
    "degrees for radians": (column("q2", np.rad2deg), "degrees but declared as radians"),
    "degrees without a speed": (column("q1", np.rad2deg), "degrees but declared as radians"),
    "speed in degrees": (column("v2", np.rad2deg), "speed in degrees but declared as radians"),
    "commands wrong by 1000": (
        {f: motion(s) | {k: 1e3 * motion(s)[k] for k in ("u1", "u2")} for f, s in (("a.csv", 1), ("b.csv", 2))},
        "commands is wrong by 1000",
    ),
    "speed wrong by 1000": (column("v2", lambda v: 1e3 * v), "wrong by 1000"),
    "time in milliseconds": (column("t", lambda t: 1e3 * t), "wrong by 1000"),
    "swapped commands": (swapped("u1", "u2"), "swapped"),
    "swapped measurements": (swapped("q1", "q2"), "swapped"),
    "reversed speed": (column("v2", np.negative), "wrong sign"),
    "constant signal": (column("q1", lambda q: 0 * q + 0.3), "constant"),
    "silent sensor": (column("v2", lambda v: 0 * v), "silent"),
    "NaN": (column("q1", at(7, np.nan)), "nan in row 7"),
    "infinity": (column("u1", at(9, np.inf)), "inf in row 9"),
    "repeated time": (column("t", at(5, 0.016)), "repeated"),
    "backward time": (column("t", at(5, 0.001)), "backward"),
    "mostly a gap": (column("t", lambda t: np.where(t > 0.5, t + 9, t)), "is missing for 9"),
    "text in a number": ({"a.csv": motion(1) | {"q1": ["off", *motion(1)["q1"][1:]]}}, "text 'off'"),
    "decimal commas": ({"a.csv": motion(1) | {"q1": ['"0,5"'] * 751}}, "text '0,5'"),
    "one sample": ({"a.csv": {k: v[:1] for k, v in motion(1).items()}}, "has 1 samples"),
    "shorter than the window": ({"a.csv": {k: v[:60] for k, v in motion(1).items()}}, "window 0.5 s"),
    "held out a copy": ({"b.csv": motion(1)}, "the same numbers"),
    "only a header": ({"a.csv": {k: [] for k in motion(1)}}, "a.csv"),
}
CASES = {  # keys of the case that are replaced -> what the line must say
    "unknown key": (altered(colour="red"), "colour is not a key"),
    "missing key": (altered(measurements=None), "measurements"),
    "wrong type": (altered(window="long"), "window is 'long'"),
    "window within a sample": (altered(window=0.001), "less than 8 samples"),
    "mass of what has none": (altered(unknowns=[{"field": "mass", "site": "world"}]), "'world' has no mass"),
    "a bracket in a name": (
        altered(measurements=lambda m: m | {"elbow [deg]": m["elbow"] | {"joint": "elbow"}}),
        "in its name; rename it",
    ),
    "too few windows": (altered(windows=3), "windows is 3; it must be a whole number, at least 20"),
    "scientific text": (altered(rate="1e2"), "write 100.0"),
    "not finite": (altered(window=float("inf")), "finite"),
    "no file": (altered(runs=[{"file": "none.csv"}, {"file": "b.csv", "held_out": True}]), "does not exist"),
    "unknown format": (altered(runs=[{"file": "arm.xml"}, {"file": "b.csv", "held_out": True}]), "unknown format"),
    "no column": (altered(measurements=entry("q1", column="q9")), "no column 'q9'"),
    "no joint": (altered(measurements=lambda m: m | {"wrist": m["elbow"]}), "no sensor or joint"),
    "no actuator": (altered(commands=lambda c: c | {"wrist": c["elbow"]}), "'wrist' does not exist"),
    "an actuator forgotten": (altered(commands=lambda c: {"elbow": c["elbow"]}), "commands.shoulder is missing"),
    "no unit": (altered(measurements=entry("q1", unit="furlong")), "not a unit"),
    "wrong dimension": (altered(measurements=entry("q1", unit="m")), "has this in 'rad'"),
    "counts without a scale": (altered(measurements=entry("q1", unit="counts")), "counts_per_rev"),
    "volts without a gain": (altered(commands=entry("elbow", unit="V")), "gain"),
    "motor side without ratio": (altered(commands=entry("elbow", meaning="motor")), "ratio is missing"),
    "no unknown of this name": (altered(unknowns=[{"field": "mas", "site": "lower"}]), "did you mean 'mass'"),
    "no site of this name": (altered(unknowns=[{"field": "mass", "site": "lowr"}]), "no site 'lowr'"),
    "nothing held out": (altered(runs=[{"file": "a.csv"}, {"file": "b.csv"}]), "held_out: true"),
    "all held out": (altered(runs=[{"file": "a.csv", "held_out": True}]), "at least one to fit"),
    "same rows": (
        altered(runs=[{"file": "a.csv", "name": "1"}, {"file": "a.csv", "name": "2", "held_out": True}]),
        "same rows",
    ),
    "two runs of one name": (altered(runs=[{"file": "a.csv"}, {"file": "a.csv", "held_out": True}]), "two runs"),
    "time faster than a simulation": (altered(time={"column": "t", "unit": "us"}), "correct time.unit"),
    "dates in milliseconds": (altered(time={"column": "date", "unit": "ms"}), "write `unit: s`"),
    "clocks apart": (altered(measurements=entry("q1", time="t2")), "must be of one clock"),
    "a torque in amperes": (
        altered(measurements=lambda m: m | {"felt": {"column": "u2", "unit": "A"}}),
        "has this in 'N m'",
    ),
    "rate above the recorded": (altered(rate=1000.0), "rate is 1000"),
    "start of no joint": (altered(start={"wrist": {"position": 0}}), "'wrist' does not exist"),
    "start of a wrong size": (altered(start={"elbow": {"position": [0, 1]}}), "has 2 numbers"),
    "extends itself": (altered(extends="case.yaml"), "comes back"),
    "composed and decomposed letters": (altered(measurements=entry("q1", column="gelenk_o\u0308")), "no column"),
}


def refused(path: Path, capsys) -> str:
    """The one line with which `fimpact check` ends, after it is sure that nothing was written."""
    before = sorted(path.parent.rglob("*"))
    assert main(["check", str(path)]) == 2
    out = capsys.readouterr()
    assert out.out == "" and out.err.count("\n") == 1 and "Traceback" not in out.err
    assert sorted(path.parent.rglob("*")) == before
    return out.err


@pytest.mark.parametrize("name", DATA)
def test_broken_data_ends_with_one_line(name, tmp_path, capsys):
    files, words = DATA[name]
    path = write_case(tmp_path, CASE)
    for file, columns in files.items():
        write_csv(tmp_path / file, columns)
    assert words in refused(path, capsys)


@pytest.mark.parametrize("name", CASES)
def test_broken_case_ends_with_one_line(name, tmp_path, capsys):
    case, words = CASES[name]
    assert words in refused(write_case(tmp_path, case), capsys)


MODELS = {
    "include leaves the folder": ('<mujoco><include file="../secret.xml"/></mujoco>', "leaves its folder"),
    "include of itself": ('<mujoco><include file="arm.xml"/></mujoco>', "again from within itself"),
    "include that is not there": ('<mujoco><include file="none.xml"/></mujoco>', "does not exist"),
    "entities": ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', "declares entities"),
    "not XML": ("<mujoco>", "is not XML"),
    "a URDF": ('<robot name="arm"><link name="upper"/></robot>', "is a URDF"),
    "an actuator with a state": (
        MODEL.replace('motor name="elbow"', 'general dyntype="filter" dynprm="0.05" name="elbow"'),
        "'elbow' has a state of its own",
    ),
    "a gain of its own": (
        MODEL.replace('motor name="elbow"', 'general gainprm="35" name="elbow"'),
        "commands.elbow.ctrl_unit is missing",
    ),
    "a delay of its own": (
        MODEL.replace('motor name="elbow"', 'motor delay="0.01" nsample="9" name="elbow"'),
        "a delay",
    ),
    "not MJCF": ("<mujoco><robot/></mujoco>", "does not compile"),
    "a separator in a name": (MODEL.replace('"upper"', '"up|per"'), "rename it"),
}


@pytest.mark.parametrize("name", MODELS)
def test_broken_model_ends_with_one_line(name, tmp_path, capsys):
    (tmp_path / "secret.xml").write_text(MODEL)
    (tmp_path / "in").mkdir()
    path = write_case(tmp_path / "in", CASE)
    (tmp_path / "in" / "arm.xml").write_text(MODELS[name][0], encoding="utf-8")
    assert MODELS[name][1] in refused(path, capsys)


FILES = {
    "truncated csv": ("a.csv", lambda p: p.write_text(p.read_text()[:-25]), "truncated"),
    "empty csv": ("a.csv", lambda p: p.write_text(""), "is empty"),
    "latin-1 csv": ("a.csv", lambda p: p.write_bytes("t,q\xe9\n1,2\n".encode("latin-1")), "cannot be read"),
    "pickled npz": ("a.npz", hostile_npz, "pickled"),
    "pickle named npz": ("a.npz", lambda p: p.write_bytes(evil()), "cannot be read"),
    "pickle named mat": ("a.mat", lambda p: p.write_bytes(evil()), "cannot be read"),
    "class object in mat": ("a.mat", opaque_mat, "a.mat"),
    "damaged parquet": ("a.parquet", lambda p: p.write_bytes(b"PAR1 nothing"), "cannot be read"),
    "damaged mcap": ("a.mcap", lambda p: p.write_bytes(b"\x89MCAP0\r\n"), "cannot be read"),
}


@pytest.mark.parametrize("name", FILES)
def test_hostile_or_damaged_file_ends_with_one_line(name, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file, write, words = FILES[name]
    path = write_case(tmp_path, altered(runs=[{"file": file}, {"file": "b.csv", "held_out": True}]))
    write(tmp_path / file)
    assert words in refused(path, capsys)
    assert not Path("owned").exists()


def test_bad_yaml_and_bad_usage_end_with_one_line(tmp_path, capsys):
    path = tmp_path / "case.yaml"
    bomb = "a: &a [" + "x, " * 30 + "]\n" + "".join(f"{n}: &{n} [{f'*{m}, ' * 30}]\n" for m, n in pairwise("abcdefg"))
    odd = ("a: !!bool maybe", "a: !!int ''", "a: !!timestamp x", bomb, "a: &a [*a]")
    for text in ("a: [", "a: 1\na: 2", "just text", "!!python/object/apply:os.system [true]", *odd):
        path.write_text(text)
        refused(path, capsys)
    with pytest.raises(SystemExit, match="2"):
        main(["check"])
    assert capsys.readouterr().err.count("\n") == 1


def test_a_good_case_comes_back_in_si_units_on_its_grid(tmp_path, capsys):
    path = write_case(tmp_path, CASE)
    recording = read_case(path)
    assert recording.channels == ("q1", "elbow", "elbow speed") and recording.period == pytest.approx(0.004)
    assert [run.held_out for run in recording.runs] == [False, True]
    np.testing.assert_allclose(recording.runs[0].measured, np.column_stack([motion(1)[k] for k in ("q1", "q2", "v2")]))
    np.testing.assert_allclose(recording.runs[0].ctrl, np.column_stack([motion(1)[k] for k in ("u1", "u2")]))
    np.testing.assert_equal(recording.noise, [np.nan, 0.001, np.nan])
    model = recording.spec().compile()
    assert model.nsensor == 4 and (recording.period / model.opt.timestep) % 1 == pytest.approx(0)
    assert inputs(path) == [tmp_path / "arm.xml", tmp_path / "a.csv", tmp_path / "b.csv"]
    assert main(["check", str(path)]) == 0 and "good" in capsys.readouterr().out


def test_a_case_depends_on_the_cases_that_it_extends(tmp_path):
    path = write_case(tmp_path, CASE)
    (tmp_path / "over.yaml").write_text(yaml.safe_dump({"extends": path.name, "window": 1.0}))
    (tmp_path / "top.yaml").write_text(yaml.safe_dump({"extends": "over.yaml"}))
    assert inputs(tmp_path / "top.yaml")[:3] == [tmp_path / "over.yaml", path, tmp_path / "arm.xml"]


def test_a_doubt_that_is_meant_can_be_accepted(tmp_path):
    path = write_case(tmp_path, altered(accept=["sign"]))
    for file, columns in column("v2", np.negative).items():
        write_csv(tmp_path / file, columns)
    read_case(path)


def joint_states(path: Path, columns: dict) -> None:
    text = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    header = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    stamp = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    rule = "=" * 80 + "\n"
    with open(path, "wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", rule.join([text, header, stamp]))
        for t, *row in zip(*(columns[k] for k in ("t", "u1", "u2", "q1", "q2", "v1", "v2")), strict=True):
            when = round(t * 1e9) + 10**18
            head = {"stamp": {"sec": when // 10**9, "nanosec": when % 10**9}, "frame_id": ""}
            message = {
                "header": head,
                "name": ["j1", "j2"],
                "effort": row[:2],
                "position": row[2:4],
                "velocity": row[4:],
            }
            writer.write_message("/joint_states", schema, message, when, when)
        writer.finish()


MCAP = {
    "q1": "position/j1",
    "q2": "position/j2",
    "v2": "velocity/j2",
    "u1": "effort/j1",
    "u2": "effort/j2",
    "t": "time",
}
FORMATS = {
    "parquet": (lambda p, c: parquet.write_table(pa.table(c), p), {}),
    "npz": (lambda p, c: np.savez(p, **c), {}),
    "mat": (lambda p, c: scipy.io.savemat(p, c), {}),
    "mcap": (joint_states, {"columns": MCAP}),
}


@pytest.mark.parametrize("ending", FORMATS)
def test_every_format_gives_the_same_recording(ending, tmp_path):
    expected = read_case(write_case(tmp_path, CASE))
    write, keys = FORMATS[ending]
    for name, seed in (("a", 1), ("b", 2)):
        write(tmp_path / f"{name}.{ending}", motion(seed))
    runs = [{"file": f"a.{ending}", **keys}, {"file": f"b.{ending}", "held_out": True, **keys}]
    got = read_case(write_case(tmp_path, altered(runs=runs)))
    for one, other in zip(got.runs, expected.runs, strict=True):
        np.testing.assert_allclose(one.measured, other.measured, atol=2e-5)
        np.testing.assert_allclose(one.ctrl, other.ctrl, atol=2e-5)


def test_cells_structs_and_rows_of_arrays_are_columns(tmp_path):
    cells = np.empty((2, 1), object)
    for i in range(2):
        m = motion(i + 1)
        cells[i, 0] = {"time": m["t"], "y": np.stack([m[k] for k in ("q1", "q2", "v2", "u1", "u2")])}
    scipy.io.savemat(tmp_path / "log.mat", {"run": cells})
    rename = dict(zip(("q1", "q2", "v2", "u1", "u2"), range(5), strict=True))
    runs = [
        {
            "name": str(i),
            "file": "log.mat",
            "held_out": i == 1,
            "columns": {"t": f"run{{{i}}}.time"} | {name: f"run{{{i}}}.y[{k}]" for name, k in rename.items()},
        }
        for i in range(2)
    ]
    got = read_case(write_case(tmp_path, altered(runs=runs)))
    np.testing.assert_allclose(got.runs[1].measured[:, 1], motion(2)["q2"], atol=1e-9)


def test_rows_of_one_file_are_split_into_runs(tmp_path):
    both = {k: np.concatenate([motion(1)[k], motion(2)[k]]) for k in motion(1)} | {"run": [1] * 751 + [2] * 751}
    write_csv(tmp_path / "log.csv", both)
    runs = [
        {"file": "log.csv", "select": {"run": 1}, "name": "one"},
        {"file": "log.csv", "select": {"run": [2]}, "split": "run", "held_out": True},
    ]
    got = read_case(write_case(tmp_path, altered(runs=runs)))
    assert [run.name for run in got.runs] == ["one", "log 2"]


@pytest.mark.parametrize(
    ("one", "other", "words"),
    [
        ({}, {"select": {"half": 2}}, "the same rows"),
        ({"select": {"half": [1, 2]}}, {"select": {"half": 2}}, "the same rows"),
        ({"stop": 1.0}, {"start": 0.9, "columns": {"w": "u1"}}, "the same rows"),
        ({"select": {"half": 1}}, {"select": {"half": 2}}, ""),
        ({"stop": 1.0}, {"start": 1.1}, ""),
        ({"columns": {"q1": "q1"}}, {"columns": {"q1": "o1", "q2": "o2", "v2": "p2"}}, ""),
    ],
)
def test_no_row_is_both_for_training_and_held_out(one, other, words, tmp_path, capsys):
    path = write_case(tmp_path, altered(runs=[{"file": "a.csv", **one}, {"file": "a.csv", "name": "b", **other}]))
    both = motion(1) | {"half": [1] * 400 + [2] * 351} | dict(zip(("o1", "o2", "p2"), swap(motion(2)), strict=True))
    write_csv(tmp_path / "a.csv", both)
    case = yaml.safe_load(path.read_text())
    case["runs"][1]["held_out"] = True
    path.write_text(yaml.safe_dump(case))
    if words:
        assert words in refused(path, capsys)
    else:
        assert [run.held_out for run in read_case(path).runs] == [False, True]


def swap(columns: dict) -> list:
    return [columns[name] for name in ("q1", "q2", "v2")]


def test_files_of_one_name_are_told_apart_by_their_folder(tmp_path):
    path = write_case(tmp_path, CASE)
    expected = read_case(path)
    for name, seed in (("a", 1), ("b", 2)):
        for folder, kept in (("arm", ("q1", "q2", "v2")), ("drive", ("u1", "u2"))):
            (tmp_path / folder).mkdir(exist_ok=True)
            write_csv(tmp_path / folder / f"{name}.csv", {k: motion(seed)[k] for k in ("t", *kept)})
    pairs = [[f"{folder}/{name}.csv" for folder in ("arm", "drive")] for name in "ab"]
    runs = [{"file": files, "name": str(i), "held_out": i == 1} for i, files in enumerate(pairs)]
    for one, other in zip(read_case(write_case(tmp_path, altered(runs=runs))).runs, expected.runs, strict=True):
        np.testing.assert_array_equal(one.ctrl, other.ctrl)


def test_counts_beside_a_clocks_nanoseconds_are_counts(tmp_path):
    m = motion(1)
    both = np.stack([np.round(m["t"] * 1e9) + 1.7e18, np.round(m["q1"] * 1e4)], 1).astype(np.int64)
    np.savez(tmp_path / "log.npz", log=both)
    time, counts = (column.values for column in read_table(tmp_path / "log.npz"))
    np.testing.assert_array_equal(counts, np.round(m["q1"] * 1e4))
    np.testing.assert_allclose(np.diff(time), 4e6, atol=300)


def test_yaml_may_merge_tables(tmp_path):
    path = write_case(tmp_path, CASE)
    text = path.read_text().replace("  shoulder:\n    column: u1\n", "  shoulder: &drive\n    column: u1\n")
    text = text.replace("  elbow:\n    column: u2\n    unit: N m\n", "  elbow:\n    <<: *drive\n    column: u2\n", 1)
    assert "<<" in text
    path.write_text(text)
    np.testing.assert_allclose(read_case(path).runs[0].ctrl[:, 1], motion(1)["u2"])


def test_two_free_bodies_need_no_names():
    body = '<body><freejoint/><geom size="1"/></body>'
    tree = ElementTree.fromstring(f"<mujoco><worldbody>{body}{body}</worldbody></mujoco>")
    name_free_joints(tree)
    assert len({joint.get("name") for joint in tree.iter("freejoint")}) == 2


def test_what_the_mjcf_includes_is_an_input(tmp_path):
    path = write_case(tmp_path, CASE)
    (tmp_path / "body.xml").write_text("<mujocoinclude><worldbody/></mujocoinclude>")
    (tmp_path / "arm.xml").write_text(MODEL.replace("<worldbody>", '<include file="body.xml"/><worldbody>', 1))
    assert [file.name for file in inputs(path)] == ["arm.xml", "body.xml", "a.csv", "b.csv"]


def test_units_gains_and_counts_are_converted(tmp_path):
    case = altered(
        measurements=lambda m: m | {"q1": m["q1"] | {"unit": "counts", "counts_per_rev": 4096}},
        commands=entry("shoulder", unit="mV", gain="2 N m/V"),
        time={"column": "t", "unit": "ms"},
    )
    path = write_case(tmp_path, case)
    for name, seed in (("a.csv", 1), ("b.csv", 2)):
        m = motion(seed)
        other = {"q1": np.round(m["q1"] / 2 / np.pi * 4096), "u1": m["u1"] * 500, "t": m["t"] * 1000}
        write_csv(tmp_path / name, m | other)
    run = read_case(path).runs[0]
    np.testing.assert_allclose(run.measured[:, 0], motion(1)["q1"], atol=np.pi / 4096 + 1e-9)
    np.testing.assert_allclose(run.ctrl[:, 0], motion(1)["u1"])
    assert factor("rpm", "rad/s", "x") == pytest.approx(2 * np.pi / 60)
    with pytest.raises(CaseError):
        factor("Hz", "rad/s", "x")


def test_names_with_spaces_and_letters_of_any_language_work(tmp_path):
    case = altered(measurements=lambda m: {"größe 角": m["q1"] | {"joint": "shoulder"}, "elbow": m["elbow"]})
    case["measurements"]["größe 角"]["column"] = "Gelenk größe"
    path = write_case(tmp_path, case)
    for name, seed in (("a.csv", 1), ("b.csv", 2)):
        write_csv(tmp_path / name, {{"q1": "Gelenk größe"}.get(k, k): v for k, v in motion(seed).items()})
    assert read_case(path).channels == ("größe 角", "elbow")


def test_gaps_slower_channels_and_jitter_are_normal(tmp_path):
    path = write_case(tmp_path, CASE)
    m = motion(1)
    slow = [v if i % 5 == 0 else None for i, v in enumerate(m["q2"])]
    keep = np.r_[0:300, 305:751]
    jitter = m["t"] + np.random.default_rng(0).uniform(-5e-4, 5e-4, 751)
    columns = {k: [v[i] for i in keep] for k, v in (m | {"q2": slow, "t": jitter}).items()}
    write_csv(tmp_path / "a.csv", columns)
    recording = read_case(path)
    run = recording.runs[0]
    known = np.isfinite(run.measured)
    assert 0.97 < known[:, 0].mean() < 1 and 0.18 < known[:, 1].mean() < 0.22 and np.isfinite(run.ctrl).all()
    rows = np.flatnonzero(known[:, 0])
    shifted = np.interp(jitter[0] + recording.period * rows, m["t"], m["q1"])
    np.testing.assert_allclose(run.measured[rows, 0], shifted, atol=0.02)


def test_a_date_or_a_clock_beside_the_columns_is_no_matter(tmp_path):
    path = write_case(tmp_path, CASE)
    expected = read_case(path)
    write_csv(tmp_path / "a.csv", {"date": ["2024-05-01"] * 751, "clock": ["14:03:22"] * 751} | motion(1))
    np.testing.assert_equal(read_case(path).runs[0].measured, expected.runs[0].measured)


def test_the_noise_of_a_slower_sensor_comes_from_its_own_samples(tmp_path):
    path, rng = write_case(tmp_path, CASE), np.random.default_rng(0)
    for name, seed in (("a.csv", 1), ("b.csv", 2)):
        read = motion(seed)["v2"] + 0.01 * rng.standard_normal(751)
        write_csv(tmp_path / name, motion(seed) | {"v2": [v if k % 2 == 0 else None for k, v in enumerate(read)]})
    assert noise_level(read_case(path))[2] == pytest.approx(0.01, rel=0.2)


def test_a_channel_without_any_noise_asks_for_it(tmp_path):
    path = write_case(tmp_path, altered(accept=["constant"]))
    for name, columns in column("q1", lambda q: 0 * q + 0.3).items():
        write_csv(tmp_path / name, columns)
    with pytest.raises(ValueError, match="declare its `noise`"):
        noise_level(read_case(path))


def test_an_unnamed_free_joint_and_quaternions_of_either_sign_work(tmp_path):
    time = 0.01 * np.arange(60)
    spin = np.column_stack([np.cos(4 * time), 0 * time, np.sin(4 * time), 0 * time])
    flipped = spin * np.where(np.arange(60) % 7 < 4, -1.0, 1.0)[:, None]
    late = time + np.where(np.arange(60) % 2, 0.002, 0.0)
    for name, drop in (("a.csv", 4.9), ("b.csv", 4.8)):
        place = {"x": time, "y": 0 * time, "z": 1 - drop * time**2}
        write_csv(tmp_path / name, {"t": late} | place | dict(zip("abcd", flipped.T, strict=True)))
    body = {"body": "cube", "unit": "m", "quantity": "position", "columns": ["x", "y", "z"]}
    turn = {"body": "cube", "unit": "1", "quantity": "orientation", "columns": list("abcd")}
    case = altered(commands={}, measurements={"place": body, "turn": turn}, unknowns=[], window=0)
    path = write_case_of(tmp_path, case, TOSS)
    run = read_case(path).runs[0]
    assert np.nanmin(np.sum(run.measured[1:, 3:] * run.measured[:-1, 3:], 1)) > 0.99
    assert run.qpos[3:] @ run.measured[0, 3:] > 0.99


def test_an_orientation_has_the_sign_that_the_model_reads(tmp_path):
    turn = {"body": "lower", "unit": "1", "quantity": "orientation", "columns": list("abcd")}
    path = write_case(tmp_path, altered(measurements=lambda m: m | {"turn": turn}))
    for name, seed in (("a.csv", 1), ("b.csv", 2)):
        half = (motion(seed)["q1"] + motion(seed)["q2"]) / 2
        read = {"a": -np.cos(half), "b": 0 * half, "c": np.sin(half), "d": 0 * half}
        write_csv(tmp_path / name, motion(seed) | read)
    assert read_case(path).runs[0].measured[0, 3:] == pytest.approx([1, 0, 0, 0], abs=1e-9)


def test_a_long_gap_in_the_commands_cuts_the_run(tmp_path):
    path = write_case(tmp_path, altered(window=0.3))
    keep = np.r_[0:300, 400:751]
    write_csv(tmp_path / "a.csv", {k: v[keep] for k, v in motion(1).items()})
    assert [run.name for run in read_case(path).training] == ["a part 1", "a part 2"]


def test_decimation_keeps_motion_impulses_and_white_noise():
    time = np.arange(20001) * 1e-3
    noise = np.random.default_rng(0).normal(size=time.size)
    smooth = on_grid(Series(time, np.sin(3 * time)), 0.0, 0.01, 2000)
    np.testing.assert_allclose(smooth, np.sin(3 * time[:20000:10]), atol=1e-4)
    white = on_grid(Series(time, noise), 0.0, 0.01, 2000)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.06 and 0.25 < white.std() < 0.4
    for steps in (True, False):
        kept = zero_order_hold(Series(time, noise), 0.0, 0.01, 2000, steps)
        whole = noise[:20000].sum() if steps else np.trapezoid(noise, dx=1.0)
        assert kept.sum() * 10 == pytest.approx(whole)


def test_includes_inside_the_folder_are_resolved_with_every_digit(tmp_path):
    path = write_case(tmp_path, CASE)
    body = re.search(r"<worldbody>.*</worldbody>", MODEL, re.S).group()
    (tmp_path / "body.xml").write_text(f"<mujocoinclude>{body.replace('0.5', '0.512345678901')}</mujocoinclude>")
    (tmp_path / "arm.xml").write_text(MODEL.replace(body, '<include file="body.xml"/>'))
    assert read_case(path).spec().compile().body("upper").mass[0] == pytest.approx(0.512345678901, abs=1e-15)


def test_init_takes_an_actuators_own_name_or_the_unit_of_a_drive_for_its_command(tmp_path, capsys):
    write_case(tmp_path, CASE)
    names = {"t": "t_s", "u1": "shoulder_Nm", "u2": "elbow [A]", "q1": "shoulder_rad", "q2": "elbow_deg"}
    write_csv(tmp_path / "log.csv", {names[k]: v for k, v in motion(1).items() if k in names})
    assert main(["init", str(tmp_path / "arm.xml"), str(tmp_path / "log.csv"), "-o", str(tmp_path / "first.yaml")]) == 0
    first = yaml.safe_load((tmp_path / "first.yaml").read_text())
    assert {name: entry["column"] for name, entry in first["commands"].items()} == {
        "shoulder": "shoulder_Nm",
        "elbow": "elbow [A]",
    }
    assert [entry["column"] for entry in first["measurements"].values()] == ["shoulder_rad", "elbow_deg"]


def test_init_matches_names_and_says_what_is_open(tmp_path, capsys):
    write_case(tmp_path, CASE)
    names = {"t": "time [s]", "u1": "shoulder torque [N m]", "u2": "elbow_torque_Nm", "q1": "shoulder pos (rad)"}
    names |= {"q2": "elbow_rad", "v2": "elbow velocity [rad s⁻¹]", "v1": "temperature"}
    write_csv(tmp_path / "log.csv", {names[k]: v for k, v in motion(1).items()})
    out = tmp_path / "first.yaml"
    assert main(["init", str(tmp_path / "arm.xml"), str(tmp_path / "log.csv"), "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "temperature" in said and "the unit of 'elbow velocity [rad s⁻¹]'" in said
    assert main(["check", str(out)]) == 2 and "'?'" in capsys.readouterr().err
    out.write_text(out.read_text().replace("'?'", "rad/s"))
    assert main(["check", str(out)]) == 0
    assert main(["init", str(tmp_path / "arm.xml"), str(tmp_path / "log.csv"), "-o", str(out)]) == 2


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason=f"the measured recordings are not there: {RECORDINGS}")
@pytest.mark.parametrize("rig", RIGS)
def test_the_cases_of_the_rigs_read(rig):
    recording = read_case(ROOT / "config" / "recordings" / f"{rig}.yaml", RECORDINGS)
    model = recording.spec().compile()
    assert recording.training and recording.held_out
    seconds = sum(len(run.measured) for run in recording.training) * recording.period
    fitted = min(seconds, recording.windows * recording.window or seconds)
    assert fitted / model.opt.timestep < 30_000
    assert all(np.isfinite(run.ctrl).all() for run in recording.runs)
