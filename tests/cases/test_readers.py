"""Readers of files as their owners have them: tables of text, arrays, LeRobot's folders and bags of ROS."""

import json

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from servo_logs import EPOCH, JOINTS, array, bag, header, lerobot, mcap, messages, run, state

from fimpact.cases.errors import CaseError
from fimpact.cases.readers.files import files_of, read_table

ROWS = "0,0.5,1\n0.1,0.25,2\n0.2,,3\n"
TEXTS = {  # of a CSV with the columns t, q1 and u -> units that the file tells
    "plain": ("t,q1,u\n" + ROWS, {}),
    "a mark of the byte order and two line ends": ("\ufefft,q1,u\r\n" + ROWS.replace("\n", "\r\n"), {}),
    "comments above the names": ("# bench 3\n// drive 2\n\nt,q1,u\n" + ROWS, {}),
    "names in a comment": ("# bench 3\n# t,q1,u\n" + ROWS, {}),
    "comments between the numbers": ("t,q1,u\n" + ROWS.replace("0.1", "% paused\n0.1"), {}),
    "semicolons": ("t;q1;u\n" + ROWS.replace(",", ";"), {}),
    "tabs": ("t\tq1\tu\n" + ROWS.replace(",", "\t"), {}),
    "blanks": ("  t   q1 u\n" + ROWS.replace(",,", ",nan,").replace(",", "   "), {}),
    "a row of units": ("t,q1,u\ns,rad,N m\n" + ROWS, {"t": "s", "q1": "rad", "u": "N m"}),
    "units in brackets below a comment": (
        "# x\nt;q1;u\n[s];[deg];(A)\n" + ROWS.replace(",", ";"),
        {"q1": "deg", "u": "A"},
    ),
}


def columns(path) -> dict:
    """Columns of a file by name; those of topics with the topic."""
    return {f"{one.group}:{one.name}" if one.group.startswith("/") else one.name: one for one in read_table(path)}


@pytest.mark.parametrize("name", TEXTS)
def test_text_is_read_however_it_is_laid_out(name, tmp_path):
    text, units = TEXTS[name]
    (tmp_path / "log.csv").write_bytes(text.encode())
    got = columns(tmp_path / "log.csv")
    assert list(got) == ["t", "q1", "u"]
    np.testing.assert_array_equal(got["t"].values, [0, 0.1, 0.2])
    np.testing.assert_array_equal(got["q1"].values, [0.5, 0.25, np.nan])
    np.testing.assert_array_equal(got["u"].values, [1, 2, 3])
    assert {key: got[key].unit for key in units} == units


REFUSED = {
    "no names": ("log.csv", "0,1.5\n0.1,2\n", "its first line must name the columns"),
    "a line of too many cells": ("log.csv", "t,q\n0,1\n0.1,2,3\n", "as many cells"),
    "only comments": ("log.csv", "# t,q\n", "is empty"),
    "JSON in one list": ("log.json", '[{"t": 0}]', "cannot be read as json"),
    "JSON that is cut": ("log.jsonl", '{"t": 0}\n{"t":', "cannot be read as jsonl"),
    "a folder of nothing": ("folder/x.txt", "", "neither meta/info.json"),
    "a dataset without data": ("folder/meta/info.json", '{"codebase_version": "v3.0", "features": {}}', "0 files"),
    "a bag without its file": ("folder/metadata.yaml", "rosbag2_bagfile_information: {version: 5}", "cannot be read"),
    "a database that is none": ("log.db3", "SQLite", "cannot be read"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_is_told_in_one_line(name, tmp_path):
    file, text, words = REFUSED[name]
    (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / file).write_text(text)
    with pytest.raises(CaseError, match=words) as told:
        read_table(tmp_path / file.partition("/")[0])
    assert len(str(told.value)) < 400


def test_json_lines_have_a_column_for_each_number(tmp_path):
    lines = [{"t": 0.1 * k, "state": {"q": [k, 2 * k]}, "note": "a"} | ({"u": 1.0} if k else {}) for k in range(3)]
    (tmp_path / "log.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    got = columns(tmp_path / "log.jsonl")
    np.testing.assert_array_equal(got["state.q[1]"].values, [0, 2, 4])
    np.testing.assert_array_equal(got["u"].absent, [True, False, False])


def test_arrays_of_numpy_are_columns_with_and_without_names(tmp_path):
    np.save(tmp_path / "plain.npy", np.arange(6.0).reshape(3, 2))
    np.save(tmp_path / "named.npy", np.array([(0.0, 1.5), (1.0, 2.5)], dtype=[("t", float), ("q1", np.float32)]))
    np.save(tmp_path / "evil.npy", np.array([None]), allow_pickle=True)
    np.testing.assert_array_equal(columns(tmp_path / "plain.npy")["[1]"].values, [1, 3, 5])
    np.testing.assert_array_equal(columns(tmp_path / "named.npy")["q1"].values, [1.5, 2.5])
    with pytest.raises(CaseError, match=r"evil\.npy cannot be read"):
        read_table(tmp_path / "evil.npy")


def test_lists_in_parquet_are_columns_and_floats_are_the_decimals_they_were(tmp_path):
    lists = pa.array([[0.1, 0.2, 0.3], None, [1.1, 1.2, 1.3]], pa.list_(pa.float32(), 3))
    ragged = pa.array([[1.0], [1.0, 2.0], []], pa.list_(pa.float64()))
    parquet.write_table(pa.table({"acc": lists, "many": ragged}), tmp_path / "log.parquet")
    got = columns(tmp_path / "log.parquet")
    np.testing.assert_array_equal(got["acc[2]"].values, [0.3, np.nan, 1.3])
    np.testing.assert_array_equal(got["acc[2]"].absent, [False, True, False])
    assert "several lengths" in got["many"].values[0]


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_a_dataset_of_lerobot_has_its_episodes_below_each_other(version, tmp_path):
    runs = [run(1), run(2)]
    got = columns(lerobot(tmp_path / "set", runs, version))
    for key, name in (("action", "action"), ("observation.state", "state")):
        both = np.concatenate([one[name][:, 2] for one in runs])
        np.testing.assert_array_equal(got[f"{key}.elbow_flex.pos"].values, both)
    assert set(np.unique(got["episode_index"].values)) == {0, 1} and got["timestamp"].values[1] == 0.02
    assert files_of(tmp_path / "set")[0].name == "info.json"
    assert len(files_of(tmp_path / "set")) == {"v2.1": 3, "v3.0": 2}[version]


def test_names_of_a_dataset_that_do_not_fit_are_not_used(tmp_path):
    folder = lerobot(tmp_path / "set", [run(1)])
    info = json.loads((folder / "meta" / "info.json").read_text())
    info["features"]["action"]["names"] = ["actions"]
    info["features"]["observation.state"]["names"] = [JOINTS]  # a list in a list
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    got = columns(folder)
    assert "action[5]" in got and "observation.state.gripper" in got


def test_a_bag_is_the_same_as_an_mcap_as_a_folder_and_as_a_database(tmp_path):
    content = messages(run(1))
    one, folder = columns(mcap(tmp_path / "log.mcap", content)), bag(tmp_path / "log", content)
    for other in (columns(folder), columns(next(folder.glob("*.db3")))):
        assert list(one) == list(other)
        for name, column in one.items():
            np.testing.assert_array_equal(column.values, other[name].values)
    np.testing.assert_array_equal(one["/joint_states:position/wrist_roll"].values, np.radians(run(1)["state"][:, 4]))
    np.testing.assert_array_equal(
        one["/position_controller/commands:data[1]"].values, np.radians(run(1)["action"][:, 1])
    )
    np.testing.assert_allclose(np.diff(one["/position_controller/commands:time"].values), 0.02, atol=1e-8)
    assert [file.suffix for file in files_of(folder)] == [".yaml", ".db3"]


def point(now: int, positions) -> dict:
    """A point of a trajectory, `now` ns after its start."""
    after = {"sec": now // 10**9, "nanosec": now % 10**9}
    return {"positions": list(positions), "velocities": [], "accelerations": [], "effort": [], "time_from_start": after}


def vector(*values: float) -> dict:
    """A vector of three numbers, or a quaternion of four."""
    return dict(zip("xyzw", values, strict=False))


def test_messages_of_any_kind_are_columns_and_others_are_named(tmp_path):
    content = []
    for k in range(9):
        now = EPOCH + k * 10**7
        imu = {
            "header": header(now),
            "orientation": vector(0.0, 0.0, 0.0, 1.0),
            "angular_velocity": vector(0, 1.0 * k, 2),
        }
        imu |= {"linear_acceleration": vector(0, 0, 9.81)}
        imu |= {f"{name}_covariance": [0.0] * 9 for name in ("orientation", "angular_velocity", "linear_acceleration")}
        wrench = {"header": header(now), "wrench": {"force": vector(1, 2, 3.0 * k), "torque": vector(4, 5, 6)}}
        told = {"header": header(now), "joint_names": JOINTS, "reference": point(0, range(6)), "feedback": point(0, [])}
        picture = {"header": header(now), "height": 1, "width": 10**5, "encoding": "mono8", "is_bigendian": 0}
        content += [
            ("/imu", "sensor_msgs/msg/Imu", now, imu),
            ("/wrench", "geometry_msgs/msg/WrenchStamped", now, wrench),
            ("/arm_controller/state", "control_msgs/msg/JointTrajectoryControllerState", now, told),
            ("/camera", "sensor_msgs/msg/Image", now, picture | {"step": 10**5, "data": bytes(10**5)}),
            ("/notes", "std_msgs/msg/String", now, {"data": "hello"}),
        ]
    got = columns(mcap(tmp_path / "log.mcap", content))
    np.testing.assert_array_equal(got["/imu:angular_velocity/y"].values, np.arange(9))
    np.testing.assert_array_equal(got["/wrench:wrench/force/z"].values, 3 * np.arange(9))
    np.testing.assert_array_equal(got["/arm_controller/state:reference/positions/wrist_flex"].values, [3] * 9)
    assert not any("covariance" in name or "feedback" in name for name in got)
    assert got["/camera:(not read)"].values[0] == "sensor_msgs/msg/Image: 100048 bytes a message"
    assert got["/notes:(not read)"].values[0] == "std_msgs/msg/String: no numbers"


def test_a_trajectory_is_asked_for_until_the_next_replaces_it(tmp_path):
    plan = {"header": header(0), "joint_names": ["elbow"]}
    content = [
        ("/plan", "trajectory_msgs/msg/JointTrajectory", EPOCH + k * 10**9, plan | {"points": points})
        for k, points in (
            (0, [point(0, [0.0]), point(6 * 10**8, [1.0]), point(12 * 10**8, [9.0])]),
            (1, [point(0, [2.0])]),
        )
    ]
    got = columns(mcap(tmp_path / "log.mcap", content))
    np.testing.assert_array_equal(got["/plan:positions/elbow"].values, [0, 1, 2])
    np.testing.assert_allclose(np.diff(got["/plan:time"].values), [0.6, 0.4], atol=1e-8)


def test_a_simulated_clock_beside_messages_without_a_stamp_is_set_to_the_logs(tmp_path):
    content = []
    for k in range(9):
        now = EPOCH + k * 10**7
        topic, kind, _, message = state(k * 10**7 + 5 * 10**6, [0.0] * 6)
        content += [(topic, kind, now, message), array(now, [0.0] * 6)]
    got = columns(mcap(tmp_path / "log.mcap", content))
    np.testing.assert_allclose(
        got["/joint_states:time"].values, got["/position_controller/commands:time"].values, atol=1e-8
    )


def test_a_joint_that_some_messages_lack_has_no_sample_there(tmp_path):
    content = [state(EPOCH + k * 10**7, [float(k)], ["ab"[k % 2]]) for k in range(6)]
    got = columns(mcap(tmp_path / "log.mcap", content))
    np.testing.assert_array_equal(got["/joint_states:position/a"].absent, [False, True] * 3)
    uneven = [state(EPOCH, [0.0, 1.0], ["a"])]
    with pytest.raises(CaseError, match="1 names but 2 entries in position"):
        read_table(mcap(tmp_path / "uneven.mcap", uneven))
    with pytest.raises(CaseError, match="no topic of numbers"):
        read_table(mcap(tmp_path / "empty.mcap", [("/notes", "std_msgs/msg/String", EPOCH, {"data": "hello"})]))


def test_messages_of_no_ros_are_told(tmp_path):
    from mcap.writer import Writer

    with open(tmp_path / "log.mcap", "wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema("Joints", "jsonschema", b"{}")
        channel = writer.register_channel("/joints", "json", schema)
        writer.add_message(channel, EPOCH, b"{}", EPOCH)
        writer.finish()
    with pytest.raises(CaseError, match="encoding or type 'jsonschema'"):
        read_table(tmp_path / "log.mcap")
    mcap(tmp_path / "cut.mcap", messages(run(1)))
    (tmp_path / "cut.mcap").write_bytes((tmp_path / "cut.mcap").read_bytes()[:-100])
    with pytest.raises(CaseError, match="it was not closed"):
        read_table(tmp_path / "cut.mcap")
