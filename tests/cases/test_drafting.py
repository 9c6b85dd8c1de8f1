"""`fimpact init`: what it makes of the words of LeRobot, of ROS and of home-made tables."""

import re

import numpy as np
import pandas as pd
import pytest
import yaml
from servo_logs import EPOCH, JOINTS, RANGES, RATE, array, bag, header, lerobot, mcap, messages, mjcf, run, state, table

from fimpact.cases import read_case
from fimpact.cli import main

RUNS = run(1), run(2), run(3)


def first(folder, logs: list, capsys, xml: str = mjcf()) -> tuple[dict, str]:
    """The case that `fimpact init` writes of logs, and what it says."""
    (folder / "arm.xml").write_text(xml)
    out = folder / "case.yaml"
    assert main(["init", str(folder / "arm.xml"), *map(str, logs), "-o", str(out)]) == 0
    return yaml.safe_load(out.read_text()), capsys.readouterr().out


def filled(folder, **units: str):
    """Fill in what is asked for, by its label, and read the case."""
    path = folder / "case.yaml"
    text = path.read_text()
    for label, unit in units.items():
        assert text.count(f"&{label} '?'") == 1
        text = text.replace(f"&{label} '?'", f"&{label} {unit}")
    path.write_text(text)
    assert main(["check", str(path)]) == 0
    return read_case(path)


def csv(folder, runs) -> list:
    table(runs).to_csv(folder / "log.csv", index=False)
    return [folder / "log.csv"]


def tables(folder, runs) -> list:
    table(runs).to_parquet(folder / "log.parquet")
    return [folder / "log.parquet"]


def bags(folder, runs) -> list:
    return [bag(folder / f"bag{i}", messages(one)) for i, one in enumerate(runs)]


FORMATS = {
    "csv": csv,
    "parquet": tables,
    "lerobot v3": lambda folder, runs: [lerobot(folder / "set", runs)],
    "lerobot v2.1": lambda folder, runs: [lerobot(folder / "set", runs, "v2.1")],
    "mcap": lambda folder, runs: [mcap(folder / f"{i}.mcap", messages(one)) for i, one in enumerate(runs)],
    "bags": bags,
    "db3": lambda folder, runs: [next(one.glob("*.db3")) for one in bags(folder, runs)],
}


@pytest.mark.parametrize("name", FORMATS)
def test_the_same_runs_in_any_format_are_the_same_arrays_with_nothing_to_fill_in(name, tmp_path, capsys):
    case, said = first(tmp_path, FORMATS[name](tmp_path, RUNS), capsys)
    assert "to fill in: nothing" in said and "'?'" not in said
    got = filled(tmp_path)
    assert [one.held_out for one in got.runs] == [False, False, True] and got.period == 1 / RATE
    assert list(case["commands"]) == JOINTS and [one["joint"] for one in case["measurements"].values()] == JOINTS
    for one, expected in zip(got.runs, RUNS, strict=True):
        np.testing.assert_allclose(one.measured, np.radians(expected["state"]), atol=1e-12)
        np.testing.assert_allclose(one.ctrl, np.radians(expected["action"]), atol=1e-12)
    columns = [one["column"] for part in ("commands", "measurements") for one in case[part].values()]
    assert len(set(columns)) == 12


def test_shares_of_a_range_are_asked_for_once_and_are_what_they_stand_for(tmp_path, capsys):
    logs = table(RUNS)
    for column, (lowest, highest) in zip(logs.columns[:12], np.degrees([*RANGES, *RANGES]), strict=True):
        low = 0 if "gripper" in column else -100
        logs[column] = low + (100 - low) * (logs[column] - lowest) / (highest - lowest)
    logs.to_csv(tmp_path / "log.csv", index=False)
    case, said = first(tmp_path, [tmp_path / "log.csv"], capsys)
    assert (
        said.count("once, at &") == 2
        and "deg and -100..100 (of the joint's range) fit the joints' ranges alike" in said
    )
    got = filled(tmp_path, angle="'-100..100'", gripper="'0..100'")
    np.testing.assert_allclose(got.runs[1].measured, np.radians(RUNS[1]["state"]), atol=1e-12)
    np.testing.assert_allclose(got.runs[1].ctrl, np.radians(RUNS[1]["action"]), atol=1e-12)
    case["measurements"]["gripper position"] |= {"unit": "0..100", "gain": "2 rad/count"}
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(case))
    assert main(["check", str(tmp_path / "case.yaml")]) == 2
    unlimited = re.sub('range="[^"]*"', "", mjcf())
    (tmp_path / "arm.xml").write_text(unlimited)
    del case["measurements"]["gripper position"]["gain"]
    for one in [*case["commands"].values(), *case["measurements"].values()]:
        one["unit"] = "0..100"
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(case))
    assert main(["check", str(tmp_path / "case.yaml")]) == 2
    assert "but the MJCF gives it none" in capsys.readouterr().err


def test_whole_steps_of_an_encoder_are_degrees(tmp_path, capsys):
    small = [one | {k: np.round(0.4 * one[k] * 4095 / 360) * 360 / 4095 for k in ("action", "state")} for one in RUNS]
    _, said = first(tmp_path, csv(tmp_path, small), capsys)
    assert "is deg, for they are whole steps of an encoder" in said


HOME_MADE = {  # time, commands, measurements: names of a table's columns -> unit of time
    "ros2_control": ("stamp", "goal_position_{}", "present_position_{}", 1e-3, "ms"),
    "target and actual": ("t", "target_{}", "actual_{}", 1e-6, "us"),
    "q_des and q_meas": ("time", "q_des[{}]", "q_meas[{}]", 1.0, "s"),
    "reference and feedback": ("time", "reference.{}", "feedback.{}", 1e-3, "ms"),
    "command and state": ("Time", "joint_command/{}", "joint_state/{}", 1e-9, "ns"),
}


@pytest.mark.parametrize("name", HOME_MADE)
@pytest.mark.parametrize("named", [True, False])
def test_words_of_recorders_are_known(name, named, tmp_path, capsys):
    time, action, reading, scale, unit = HOME_MADE[name]
    keys = JOINTS if named else range(6)
    log = {time: RUNS[0]["time"] / scale}
    log |= {action.format(key): np.radians(RUNS[0]["action"][:, i]) for i, key in enumerate(keys)}
    log |= {reading.format(key): np.radians(RUNS[0]["state"][:, i]) for i, key in enumerate(keys)}
    pd.DataFrame(log).to_csv(tmp_path / "log.csv", index=False)
    case, said = first(tmp_path, [tmp_path / "log.csv"], capsys)
    assert [one["column"] for one in case["commands"].values()] == [action.format(key) for key in keys]
    assert [one["column"] for one in case["measurements"].values()] == [reading.format(key) for key in keys]
    assert case["time"] == {"column": time, "unit": unit} and "to fill in: nothing" in said
    assert ("by its number alone: check it" in said) != named
    np.testing.assert_allclose(filled(tmp_path).runs[0].measured[:100], np.radians(RUNS[0]["state"][:100]), atol=1e-9)


def test_what_stands_in_another_order_of_words_is_taken_by_it(tmp_path, capsys):
    names = "Rotation Pitch Elbow WristPitch WristRoll Jaw".split()
    xml = mjcf()
    for old, new in zip(JOINTS, names, strict=True):
        xml = xml.replace(f'"{old}"', f'"{new}"')
    case, said = first(tmp_path, csv(tmp_path, RUNS), capsys, xml)
    assert [one["column"] for one in case["commands"].values()] == [f"action.{name}.pos" for name in JOINTS]
    assert said.count("by its order alone: check it") == 2


def test_commands_in_another_order_than_the_joints_are_told_by_how_they_move(tmp_path, capsys):
    content = messages(RUNS[0])
    for _, kind, _, message in content:
        if kind.endswith("Float64MultiArray"):
            message["data"] = [message["data"][i] for i in (0, 2, 1, 3, 4, 5)]
    _, said = first(tmp_path, [mcap(tmp_path / "log.mcap", content)], capsys)
    for joint, other in (("shoulder_lift", "elbow_flex"), ("elbow_flex", "shoulder_lift")):
        assert f"moves as '{other}' does, not as '{joint}'" in said
    assert said.count("moves as") == 2
    (tmp_path / "case.yaml").unlink()
    _, said = first(tmp_path, [mcap(tmp_path / "log.mcap", messages(RUNS[0]))], capsys)
    assert "correlation with how their joints move: 0.9" in said


@pytest.mark.parametrize("xml", [mjcf(), re.sub("<actuator>.*</actuator>", "", mjcf())])
def test_commands_alone_are_no_measurements(xml, tmp_path, capsys):
    logs = table(RUNS)
    logs.drop(columns=[name for name in logs if "observation" in name]).to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "arm.xml").write_text(xml)
    assert main(["init", str(tmp_path / "arm.xml"), str(tmp_path / "log.csv"), "-o", str(tmp_path / "case.yaml")]) == 2
    assert "names a joint or sensor" in capsys.readouterr().err and not (tmp_path / "case.yaml").exists()


def test_a_state_of_a_controller_gives_both_and_what_is_not_read_is_named(tmp_path, capsys):
    def at(positions) -> dict:
        after = {"sec": 0, "nanosec": 0}
        empty = {"velocities": [], "accelerations": [], "effort": []}
        return {"positions": list(positions), "time_from_start": after} | empty

    content = []
    for time, action, reading in zip(*(RUNS[0][key] for key in ("time", "action", "state")), strict=True):
        now, both = EPOCH + round(1e9 * time), (at(np.radians(action)), at(np.radians(reading)))
        told = {"header": header(now), "joint_names": JOINTS, "reference": both[0], "feedback": both[1]}
        content.append(
            ("/arm_controller/controller_state", "control_msgs/msg/JointTrajectoryControllerState", now, told)
        )
        content.append(("/notes", "std_msgs/msg/String", now, {"data": "hello"}))
    case, said = first(tmp_path, [mcap(tmp_path / "log.mcap", content)], capsys)
    topic = "/arm_controller/controller_state"
    assert case["commands"]["elbow_flex"]["column"] == f"{topic}:reference/positions/elbow_flex"
    assert case["measurements"]["elbow_flex position"]["column"] == f"{topic}:feedback/positions/elbow_flex"
    assert "topics that are not read: /notes (std_msgs/msg/String: no numbers)" in said
    filled(tmp_path)


def test_efforts_and_commands_of_motors(tmp_path, capsys):
    xml = mjcf().replace("<position", "<motor").replace(' kp="20" kv="0.5"', "")
    content = []
    for k, reading in enumerate(np.radians(RUNS[0]["state"])):
        now = EPOCH + k * 2 * 10**7
        content += [state(now, reading, effort=[0.1 * k] * 6), array(now, reading, "/arm/effort_controller/commands")]
    case, said = first(tmp_path, [mcap(tmp_path / "log.mcap", content)], capsys, xml)
    assert case["commands"]["gripper"] == {"column": "/arm/effort_controller/commands:data[5]", "unit": "N m"}
    felt = [message for message in content if message[0] == "/joint_states"]
    (tmp_path / "case.yaml").unlink()
    case, said = first(tmp_path, [mcap(tmp_path / "felt.mcap", felt)], capsys, xml)
    assert case["commands"]["gripper"] == {"meaning": "link", "column": "/joint_states:effort/gripper", "unit": "N m"}
    assert "was measured, so it has `meaning: link`" in said


def test_a_counter_is_no_time_and_a_clock_since_1970_is(tmp_path, capsys):
    logs = table(RUNS[:1]).drop(columns=["timestamp", "episode_index"])
    logs["time"] = np.arange(len(logs))
    logs.to_csv(tmp_path / "log.csv", index=False)
    case, said = first(tmp_path, [tmp_path / "log.csv"], capsys)
    assert case["time"]["unit"] == "?" and case["runs"][0]["stop"] == "?" and "it counts samples" in said
    (tmp_path / "case.yaml").unlink()
    logs["time"] = 1.764e9 + np.arange(len(logs)) / RATE
    logs.to_csv(tmp_path / "log.csv", index=False)
    case, said = first(tmp_path, [tmp_path / "log.csv"], capsys)
    assert case["time"]["unit"] == "s" and "it counts from 1970" in said and case["runs"][0]["stop"] == 4.186


def test_a_pose_and_an_imu_are_matched_by_their_axes(tmp_path, capsys):
    box = (
        '<body name="box" pos="1 0 0"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1"/>'
        '<site name="imu"/></body>'
    )
    xml = mjcf(after='<sensor><accelerometer name="acc" site="imu"/></sensor>').replace(
        "<worldbody>", f"<worldbody>{box}"
    )
    rng = np.random.default_rng(0)
    names = "x y z qx qy qz qw ax ay az wx wy wz".split()
    logs = table(RUNS[:1]).assign(**{name: rng.standard_normal(len(RUNS[0]["time"])) for name in names})
    logs.to_csv(tmp_path / "log.csv", index=False)
    case, said = first(tmp_path, [tmp_path / "log.csv"], capsys, xml)
    assert case["measurements"]["box position"] | {"unit": ""} == {
        "body": "box", "quantity": "position", "columns": ["x", "y", "z"], "unit": "",
    }  # fmt: skip
    assert case["measurements"]["box orientation"]["columns"] == ["qw", "qx", "qy", "qz"]
    assert case["measurements"]["acc"]["columns"] == ["ax", "ay", "az"]
    assert "wx, wy, wz" in said  # in whose axes, no name tells
