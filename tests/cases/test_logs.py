"""Logs as robots write them: wrapped angles, clocks of their own, gears, dropouts, names of any kind."""

import mujoco
import numpy as np
import pytest
import yaml
from case_files import CASE, MODEL, TOSS, altered, entry, motion, write_case, write_case_of, write_csv

from fimpact.cases import CaseError, read_case
from fimpact.cases.drafting.column_names import unit
from fimpact.cases.resampling import Series, on_grid
from fimpact.cli import main
from fimpact.effects import EFFECTS
from fimpact.simulation.state_guess import noise_level


@pytest.mark.parametrize("low", [-np.pi, 0.0])
def test_an_angle_that_starts_again_after_a_turn_goes_on(low, tmp_path):
    path = write_case_of(tmp_path, CASE, MODEL.replace(' range="-170 170"', ""))
    turns = {name: motion(seed)["q1"] + motion(seed)["t"] * 5 for name, seed in (("a.csv", 1), ("b.csv", 2))}
    for name, seed in (("a.csv", 1), ("b.csv", 2)):
        read = (turns[name] - low) % (2 * np.pi) + low
        write_csv(tmp_path / name, motion(seed) | {"q1": read})
    path.write_text(path.read_text() + "accept: [units, swapped, sign]\n")
    run = read_case(path).runs[0]
    off = run.measured[:, 0] - turns["a.csv"][: len(run.measured)]
    np.testing.assert_allclose(off, off[0], atol=1e-9)


def test_a_quick_joint_that_really_turns_far_stays_as_it_is(tmp_path):
    rough = np.random.default_rng(0).uniform(-3, 3, 751)  # noise, not a sensor that starts again
    path = write_case(tmp_path, altered(accept=["units", "swapped", "sign"]))
    write_csv(tmp_path / "a.csv", motion(1) | {"q1": rough})
    assert np.ptp(read_case(path).runs[0].measured[:, 0]) < 6


def test_measurements_between_commands_are_read_off_as_they_are(tmp_path):
    path, rng = write_case(tmp_path, CASE), np.random.default_rng(0)
    for name, seed in (("a", 1), ("b", 2)):
        m = motion(seed)
        write_csv(tmp_path / f"{name}.csv", {"t": m["t"][::2], "u1": m["u1"][::2], "u2": m["u2"][::2]})
        seen = {k: m[k][1::2] + 1e-3 * rng.standard_normal(375) for k in ("q1", "q2", "v2")}
        write_csv(tmp_path / f"{name}_seen.csv", {"time": m["t"][1::2]} | seen)
    runs = [{"file": ["a.csv", "a_seen.csv"]}, {"file": ["b.csv", "b_seen.csv"], "held_out": True}]
    late = {key: {**one, "time": "time"} for key, one in CASE["measurements"].items()}
    case = altered(runs=runs, measurements=late)
    del case["measurements"]["elbow"]["noise"]
    path = write_case_of(tmp_path, case, MODEL)
    assert noise_level(read_case(path))[1] == pytest.approx(1e-3, rel=0.15)


def test_what_lies_between_samples_keeps_its_turning_points():
    time = np.cumsum(np.random.default_rng(0).uniform(0.008, 0.012, 500))
    grid = time[5] + 0.01 * np.arange(400)
    found = on_grid(Series(time, np.sin(6 * time)), grid[0], 0.01, 400)
    np.testing.assert_allclose(found, np.sin(6 * grid), atol=1e-5)


def test_stamps_in_whole_milliseconds_have_the_period_of_all_of_them():
    time = np.round(np.arange(900) / 148, 3)
    assert Series(time, time).period == pytest.approx(1 / 148, rel=1e-3)
    assert Series(np.delete(time, [5, 6, 100, 300]), time).period == pytest.approx(1 / 148, rel=2e-3)


GEARED = MODEL.replace('joint="shoulder"/><motor', 'joint="shoulder" gear="-6"/><motor')


@pytest.mark.parametrize(
    ("keys", "torque"),
    [
        ({"meaning": "link"}, 1.0),
        ({"meaning": "motor", "ratio": 6}, -6.0),
        ({"meaning": "motor"}, -6.0),
        ({"meaning": "motor", "ratio": 1}, -1.0),
        ({"meaning": "command"}, -6.0),
    ],
)
def test_the_joint_gets_the_torque_that_was_logged(keys, torque, tmp_path):
    case = altered(commands=entry("shoulder", **keys), accept=["sign", "units"])
    write_case(tmp_path, case)
    recording = read_case(write_case_of(tmp_path, case, GEARED))
    model = recording.spec().compile()
    data = mujoco.MjData(model)
    data.ctrl[:] = recording.runs[0].ctrl[10]
    mujoco.mj_forward(model, data)
    u1 = motion(1)["u1"]
    mean = u1[10] if keys["meaning"] == "command" else (u1[10] + u1[11]) / 2
    assert data.qfrc_actuator[0] == pytest.approx(torque * mean, rel=1e-4)


def test_a_short_stretch_between_gaps_is_left_out(tmp_path):
    path = write_case(tmp_path, altered(window=0.3))
    keep = np.r_[0:300, 350:370, 420:751]
    write_csv(tmp_path / "a.csv", {k: v[keep] for k, v in motion(1).items()})
    assert [run.name for run in read_case(path).training] == ["a part 1", "a part 3"]
    case = altered(window=0.3, start={"shoulder": {"position": 0.5, "position_sd": 0.01}})
    recording = read_case(write_case_of(tmp_path, case, MODEL))
    opening, later = recording.training
    assert opening.qpos[0] == 0.5 and later.qpos is None
    assert opening.opens and not later.opens and recording.start_sd[0] == pytest.approx(0.01)
    bursts = np.concatenate([np.arange(k, k + 16) for k in range(0, 700, 28)])
    write_csv(tmp_path / "b.csv", {k: v[bursts] for k, v in motion(2).items()})
    with pytest.raises(CaseError, match="the longest part between them has 16 samples"):
        read_case(path)


def toss(folder, dropout: list[float], **changes):
    """A case of a thrown cube with a dropout in its orientation."""
    time = 0.01 * np.arange(60)
    turn = np.column_stack([np.cos(time), 0 * time, np.sin(time), 0 * time])
    for name, drop in (("a.csv", 4.9), ("b.csv", 4.8)):
        own = turn if name == "b.csv" else np.where((np.arange(60) // 5 == 4)[:, None], dropout, turn)
        place = {"x": time, "y": 0 * time, "z": 1 - drop * time**2}
        write_csv(folder / name, {"t": time} | place | dict(zip("abcd", own.T, strict=True)))
    body = {"body": "cube", "unit": "m", "quantity": "position", "columns": ["x", "y", "z"]}
    turned = {"body": "cube", "unit": "1", "quantity": "orientation", "columns": list("abcd")}
    case = altered(commands={}, measurements={"place": body, "turn": turned}, unknowns=[], window=0) | changes
    return write_case_of(folder, case, TOSS)


def test_a_model_whose_gravity_is_switched_off_may_lean(tmp_path):
    flat = MODEL.replace('<option timestep="0.002"/>', '<option timestep="0.002"><flag gravity="disable"/></option>')
    write_case(tmp_path, CASE)
    recording = read_case(write_case_of(tmp_path, altered(accept=["units", "swapped", "sign"]), flat))
    model = recording.spec().compile()
    data = mujoco.MjData(model)
    data.qpos[:] = 1.0
    mujoco.mj_forward(model, data)
    assert not data.qacc.any()
    EFFECTS["gravity_tilt"].law(model, "world", 0.0, 0.1, 0.0)
    mujoco.mj_forward(model, data)
    assert data.qacc.all()


def test_an_orientation_of_no_length_is_no_orientation(tmp_path):
    with pytest.raises(CaseError, match=r"has length 0 \(5 such rows\)"):
        read_case(toss(tmp_path, [0.0] * 4))
    run = read_case(toss(tmp_path, [0.0] * 4, nan="missing")).runs[0]
    assert np.isnan(run.measured[21:24, 3:]).all() and np.isfinite(run.measured[:, :3]).all()


@pytest.mark.parametrize("objtype", ["body", "xbody"])
def test_a_free_body_starts_where_its_sensors_say(objtype, tmp_path):
    sensors = "".join(
        f'<frame{kind} name="{name}" objtype="{objtype}" objname="cube"/>'
        for kind, name in (("pos", "place"), ("quat", "turn"))
    )
    path = toss(tmp_path, [1.0, 0, 0, 0])
    case = yaml.safe_load(path.read_text())
    for one in case["measurements"].values():
        del one["body"], one["quantity"]
    path = write_case_of(tmp_path, case, TOSS.replace("</mujoco>", f"<sensor>{sensors}</sensor></mujoco>"))
    assert read_case(path).runs[0].qpos[2] == pytest.approx(1.0, abs=1e-3)


def test_a_sensor_that_the_mjcf_cuts_off_cannot_have_read_more(tmp_path):
    cut = MODEL.replace('<jointpos name="q1" joint', '<jointpos name="q1" cutoff="0.1" joint')
    write_case(tmp_path, CASE)
    with pytest.raises(CaseError, match=r"cut off at 0\.1"):
        read_case(write_case_of(tmp_path, CASE, cut))


def test_an_attached_model_is_read_from_the_folder_of_the_mjcf(tmp_path):
    write_case(tmp_path, CASE)
    part = '<mujoco><worldbody><body name="tool"><geom size=".01" mass=".01" contype="0" conaffinity="0"/></body>'
    (tmp_path / "tool.xml").write_text(part + "</worldbody></mujoco>")
    whole = MODEL.replace("<worldbody>", '<asset><model name="t" file="tool.xml"/></asset><worldbody>').replace(
        '<joint name="elbow"', '<attach model="t" body="tool" prefix="x_"/><joint name="elbow"'
    )
    model = read_case(write_case_of(tmp_path, CASE, whole)).spec().compile()
    assert model.body("x_tool").mass[0] == 0.01
    with pytest.raises(CaseError, match="leaves its folder"):
        read_case(write_case_of(tmp_path, CASE, whole.replace('"tool.xml"', '"../tool.xml"')))


def test_a_case_finds_the_files_of_the_one_that_it_extends(tmp_path):
    path = write_case(tmp_path, CASE)
    (tmp_path / "child").mkdir()
    child = tmp_path / "child" / "case.yaml"
    child.write_text(f"extends: ../{path.name}\nwindow: 0.4\n")
    assert read_case(child).window == 0.4


TELLING = {
    "a text after a blank": ({"q1": lambda q: [None, "ERR", *q[2:]]}, {}, "holds the text 'ERR'"),
    "whole seconds": ({"t": np.floor}, {}, "fraction of a second as `time.fraction`"),
    "a fraction without seconds": (
        {},
        {"time": {"rate": 250, "fraction": {"column": "t", "unit": "ns"}}},
        "time has fraction and rate; allowed: column and unit, and a fraction where there is one, or rate",
    ),
    "a fraction of another unit": (
        {},
        {"time": {"column": "t", "unit": "s", "fraction": {"column": "q1", "unit": "m"}}},
        "time.fraction",
    ),
    "a row of the file": ({"q1": lambda q: [None] * 40 + [*q[40:60], np.nan, *q[61:]]}, {}, "in row 60"),
    "a column with blanks": (
        {"date": lambda _: [None, *["x"] * 750]},
        {"runs": [{"file": "a.csv", "split": "date"}, {"file": "b.csv", "select": {"date": "y"}, "held_out": True}]},
        "no row has date = 'y'; allowed: x;",
    ),
    "a unit without a gain": ({}, {"commands": entry("shoulder", unit="m")}, "unit is 'm', but"),
    "a state with a deviation": (
        {},
        {"runs": [{"file": "a.csv", "state": {"elbow": {"position_sd": 0.1}}}, {"file": "b.csv", "held_out": True}]},
        "position_sd",
    ),
}


@pytest.mark.parametrize("name", TELLING)
def test_what_is_refused_is_the_cause(name, tmp_path, capsys):
    columns, changes, words = TELLING[name]
    path = write_case(tmp_path, altered(**changes))
    for file, seed in (("a.csv", 1), ("b.csv", 2)):
        own = motion(seed) | {"date": ["x"] * 751}
        write_csv(tmp_path / file, own | {k: change(np.asarray(own[k])) for k, change in columns.items()})
    assert main(["check", str(path)]) == 2
    assert words in capsys.readouterr().err


def test_a_free_joint_of_a_body_without_a_name_asks_for_one(tmp_path):
    path = toss(tmp_path, [1.0, 0, 0, 0])
    case = yaml.safe_load(path.read_text())
    for one in case["measurements"].values():
        del one["body"]
        one["joint"] = "free"
    nameless = TOSS.replace('<body name="cube"><freejoint/>', '<body><freejoint name="free"/>')
    with pytest.raises(CaseError, match="the body of 'free' has no name"):
        read_case(write_case_of(tmp_path, case, nameless))


def first(folder, columns: dict, capsys) -> tuple[dict, str]:
    """The case that `fimpact init` writes of a log, and what it says."""
    (folder / "arm.xml").write_text(MODEL.replace('name="q1"', 'name="shoulder"'))
    write_csv(folder / "log.csv", columns)
    out = folder / "first.yaml"
    assert main(["init", str(folder / "arm.xml"), str(folder / "log.csv"), "-o", str(out)]) == 0
    return yaml.safe_load(out.read_text()), capsys.readouterr().out


def test_init_takes_what_was_measured_and_not_what_was_wished(tmp_path, capsys):
    m = motion(1)
    log = {"t_ns": m["t"], "elbow_des_rad": m["q2"], "shoulder_vel_rad_s": m["v1"], "shoulder_rad": m["q1"]}
    case, said = first(tmp_path, log | {"elbow_pos_m": m["q2"], "tau0_N_m": m["u1"], "tau1_N_m": m["u2"]}, capsys)
    found = {key: (one["column"], one["unit"]) for key, one in case["measurements"].items()}
    assert found == {
        "shoulder velocity": ("shoulder_vel_rad_s", "rad/s"),
        "shoulder": ("shoulder_rad", "rad"),
        "elbow position": ("elbow_pos_m", "?"),
    }
    assert "elbow_des_rad (as 'elbow_pos_m')" in said
    assert {key: one["column"] for key, one in case["commands"].items()} == {
        "shoulder": "tau0_N_m",
        "elbow": "tau1_N_m",
    }


def test_init_leaves_open_what_depends_on_the_unit_of_time(tmp_path, capsys):
    counted = np.arange(len(motion(1)["t"]))
    case, said = first(tmp_path, {"time": counted, "q[0]": motion(1)["q1"], "q[1]": motion(1)["q2"]}, capsys)
    assert case["runs"][0]["stop"] == "?" and "about 70 % of it" in said
    assert [one["joint"] for one in case["measurements"].values()] == ["shoulder", "elbow"]


def test_seconds_and_their_fraction_are_one_time(tmp_path, capsys):
    stamps = np.round(1.7e18 + 1e9 * motion(1)["t"]).astype(np.int64)
    stamped = {"header.stamp.sec": stamps // 10**9, "header.stamp.nanosec": stamps % 10**9}
    case, said = first(tmp_path, stamped | {"shoulder_rad": motion(1)["q1"], "elbow_rad": motion(1)["q2"]}, capsys)
    assert case["time"]["fraction"] == {"column": "header.stamp.nanosec", "unit": "ns"}
    assert "time" not in said and "stamp" not in said
    path = write_case(tmp_path, altered(time=case["time"]))
    for name, seed in (("a.csv", 1), ("b.csv", 2)):
        write_csv(tmp_path / name, stamped | motion(seed))
    read = read_case(path)
    assert read.period == 0.004
    np.testing.assert_allclose(read.runs[0].measured[:, 0], motion(1)["q1"], atol=1e-5)


def test_init_says_that_numbers_need_points(tmp_path, capsys):
    (tmp_path / "arm.xml").write_text(MODEL)
    (tmp_path / "log.csv").write_text("t;elbow_rad\n0,0;0,1\n0,1;0,2\n")
    assert main(["init", str(tmp_path / "arm.xml"), str(tmp_path / "log.csv"), "-o", str(tmp_path / "c.yaml")]) == 2
    assert "write decimal points" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("speed_m_s", "m/s"),
        ("tau_mN_m", "mN m"),
        ("t_ms", "ms"),
        ("a [°]", "deg"),
        ("joint_a", "?"),
        ("x_m", "m"),
        ("volt", "V"),
        ("rpm", "rpm"),
    ],
)
def test_a_name_ends_with_its_unit(name, expected):
    assert unit(name) == expected
