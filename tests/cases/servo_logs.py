"""Logs of an arm of six position servos, as its recorders write them: LeRobot's folders and tables, and bags of ROS 2.

`run` simulates; every writer takes runs and puts the same numbers into its own format, so that all must read alike.
"""

import json
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pyarrow as pa
from mcap_ros2.writer import Writer as McapWriter
from pyarrow import parquet
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

JOINTS = "shoulder_pan shoulder_lift elbow_flex wrist_flex wrist_roll gripper".split()
AXES = "0 0 1", "0 1 0", "0 1 0", "0 1 0", "1 0 0", "0 0 1"
RANGES = np.array([[-1.9, 1.8]] * 4 + [[-2.8, 2.7], [-1.9, 1.8]])  # rad
RATE = 50  # Hz
EPOCH = 1_764_000_000_000_000_000  # ns


def mjcf(before: str = "", after: str = "") -> str:
    """An arm of six links, each a capsule with a servo at its joint."""
    bodies = "".join(
        f'<body name="link{i}" pos="{0.06 if i else 0} 0 0"><joint name="{name}" axis="{axis}" range="{low} {high}" '
        f'damping="0.6" frictionloss="0.05" armature="0.028"/><geom type="capsule" fromto="0 0 0 0.06 0 0" size="0.01" '
        f'mass="0.08"/>'
        for i, (name, axis, (low, high)) in enumerate(zip(JOINTS, AXES, RANGES, strict=True))
    )
    servos = "".join(f'<position name="{name}" joint="{name}" kp="20" kv="0.5"/>' for name in JOINTS)
    return (
        f'<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002"/>{before}'
        f'<default><geom contype="0" conaffinity="0"/></default><worldbody>{bodies}{"</body>" * 6}</worldbody>'
        f"<actuator>{servos}</actuator>{after}</mujoco>"
    )


@cache
def run(seed: int, xml: str = mjcf(), seconds: float = 6.0) -> dict[str, np.ndarray]:
    """One run: time (T,) in s, targets and readings (T, 6) in degrees with four decimals."""
    model = mujoco.MjModel.from_xml_string(xml)
    return simulated(model, seed, seconds)


def simulated(model: mujoco.MjModel, seed: int, seconds: float) -> dict[str, np.ndarray]:
    """A run of any arm whose actuators are position servos of its joints, in their order."""
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    low, high = model.jnt_range.T
    rates, phases = rng.uniform(0.8, 3.0, (2, model.nu)), rng.uniform(0, 6, (2, model.nu))
    held = round(1 / RATE / model.opt.timestep)
    targets, readings = [], []
    for k in range(round(seconds * RATE)):
        swing = np.sin(rates * k / RATE + phases).sum(axis=0) - np.sin(phases).sum(axis=0)
        data.ctrl[:] = np.clip(0.22 * (high - low) * swing, low, high)
        targets.append(data.ctrl.copy())
        readings.append(data.qpos + 2e-4 * rng.standard_normal(model.nq))
        mujoco.mj_step(model, data, held)
    angles = {name: np.round(np.degrees(values), 4) for name, values in (("action", targets), ("state", readings))}
    return {"time": np.arange(len(targets)) / RATE} | angles


def table(runs: list[dict]) -> pd.DataFrame:
    """All runs below each other with LeRobot's names, one column for each joint."""
    parts = []
    for episode, one in enumerate(runs):
        named = {f"action.{name}.pos": one["action"][:, i] for i, name in enumerate(JOINTS)}
        named |= {f"observation.state.{name}.pos": one["state"][:, i] for i, name in enumerate(JOINTS)}
        frames = np.arange(len(one["time"]))
        parts.append(pd.DataFrame(named | {"timestamp": one["time"], "frame_index": frames, "episode_index": episode}))
    return pd.concat(parts, ignore_index=True)


def lerobot(folder: Path, runs: list[dict], version: str = "v3.0") -> Path:
    """A dataset of LeRobot: v3 has all episodes in one file, v2 a file for each."""
    names = [f"{name}.pos" for name in JOINTS]
    lists = {"dtype": "float32", "shape": [len(JOINTS)], "names": names}
    features = {
        "action": lists,
        "observation.state": lists if version == "v3.0" else lists | {"names": {"motors": names}},
    }
    features["observation.images.front"] = {"dtype": "video", "shape": [480, 640, 3], "names": ["height", "width", "c"]}
    features |= {name: {"dtype": "int64", "shape": [1], "names": None} for name in ("frame_index", "episode_index")}
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    path = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    if version != "v3.0":
        path = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
    info = {"codebase_version": version, "robot_type": "so101_follower", "fps": RATE, "data_path": path}
    for part in ("meta", "data/chunk-000"):
        (folder / part).mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(info | {"features": features}))
    episodes = [_episode(episode, one) for episode, one in enumerate(runs)]
    if version == "v3.0":
        parquet.write_table(pa.concat_tables(episodes), folder / "data/chunk-000/file-000.parquet")
    else:
        for episode, part in enumerate(episodes):
            parquet.write_table(part, folder / f"data/chunk-000/episode_{episode:06d}.parquet")
    return folder


def _episode(episode: int, one: dict) -> pa.Table:
    rows = len(one["time"])
    lists = {key: pa.array(one[name].tolist(), pa.list_(pa.float32())) for key, name in _KEYS.items()}
    index = {"frame_index": np.arange(rows), "episode_index": np.full(rows, episode)}
    return pa.table(lists | {"timestamp": one["time"].astype(np.float32)} | index)


_KEYS = {"action": "action", "observation.state": "state"}
_RULE = "\n" + 80 * "=" + "\nMSG: "
_HEADER = f"{_RULE}std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id{_RULE}builtin_interfaces/Time\n"
_HEADER += "int32 sec\nuint32 nanosec"
_VECTOR = f"{_RULE}geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z"
MESSAGES = {
    "sensor_msgs/msg/JointState": (
        f"std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort{_HEADER}"
    ),
    "std_msgs/msg/Float64MultiArray": (
        f"std_msgs/MultiArrayLayout layout\nfloat64[] data{_RULE}std_msgs/MultiArrayLayout\n"
        f"std_msgs/MultiArrayDimension[] dim\nuint32 data_offset{_RULE}std_msgs/MultiArrayDimension\nstring label\n"
        "uint32 size\nuint32 stride"
    ),
    "geometry_msgs/msg/WrenchStamped": (
        f"std_msgs/Header header\ngeometry_msgs/Wrench wrench{_HEADER}{_RULE}geometry_msgs/Wrench\nVector3 force\n"
        f"Vector3 torque{_VECTOR}"
    ),
    "sensor_msgs/msg/Imu": (
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        f"geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance{_HEADER}{_VECTOR}"
        f"{_RULE}geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w"
    ),
    "trajectory_msgs/msg/JointTrajectory": (
        f"std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint[] points{_HEADER}{_RULE}"
        "trajectory_msgs/JointTrajectoryPoint\nfloat64[] positions\nfloat64[] velocities\nfloat64[] accelerations\n"
        f"float64[] effort\nbuiltin_interfaces/Duration time_from_start{_RULE}builtin_interfaces/Duration\nint32 sec\n"
        "uint32 nanosec"
    ),
    "control_msgs/msg/JointTrajectoryControllerState": (
        f"std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint reference\n"
        f"trajectory_msgs/JointTrajectoryPoint feedback{_HEADER}{_RULE}trajectory_msgs/JointTrajectoryPoint\n"
        "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\n"
        f"builtin_interfaces/Duration time_from_start{_RULE}builtin_interfaces/Duration\nint32 sec\nuint32 nanosec"
    ),
    "sensor_msgs/msg/Image": (
        f"std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n"
        f"uint8[] data{_HEADER}"
    ),
    "std_msgs/msg/String": "string data",
}


def header(now: int) -> dict:
    """A header stamped at `now` ns."""
    return {"stamp": {"sec": now // 10**9, "nanosec": now % 10**9}, "frame_id": ""}


def state(now: int, positions, names=JOINTS, **others) -> tuple[str, str, int, dict]:
    """A message with the joints' readings."""
    message = {"header": header(now), "name": list(names), "position": list(positions), "velocity": [], "effort": []}
    return "/joint_states", "sensor_msgs/msg/JointState", now, message | others


def array(now: int, values, topic: str = "/position_controller/commands") -> tuple[str, str, int, dict]:
    """A message with the commands of a controller of ros2_control."""
    return topic, "std_msgs/msg/Float64MultiArray", now, {"layout": {"dim": [], "data_offset": 0}, "data": list(values)}


def messages(one: dict) -> list[tuple[str, str, int, dict]]:
    """Messages of a run, in rad: topic, type, time in ns, and content."""
    out = []
    for time, action, reading in zip(one["time"], np.radians(one["action"]), np.radians(one["state"]), strict=True):
        now = EPOCH + round(1e9 * time)
        out += [array(now, action), state(now, reading)]
    return out


def mcap(path: Path, content: list[tuple[str, str, int, dict]]) -> Path:
    """An MCAP of messages, written by Foxglove's library."""
    with open(path, "wb") as stream, McapWriter(stream) as writer:
        schemas = {kind: writer.register_msgdef(kind, MESSAGES[kind]) for kind in {kind for _, kind, _, _ in content}}
        for topic, kind, now, message in content:
            writer.write_message(topic, schemas[kind], message, log_time=now, publish_time=now)
    return path


def bag(folder: Path, content: list[tuple[str, str, int, dict]]) -> Path:
    """A folder with a `.db3`, written by rosbags; returns the folder."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with BagWriter(folder, version=8) as writer:
        kinds = {topic: kind for topic, kind, _, _ in content}
        for kind in set(kinds.values()) - set(store.fielddefs):
            new = {
                name: one
                for name, one in get_types_from_msg(MESSAGES[kind], kind).items()
                if name not in store.fielddefs
            }
            store.register(new)
        connections = {t: writer.add_connection(t, kind, typestore=store) for t, kind in kinds.items()}
        for topic, kind, now, message in content:
            writer.write(connections[topic], now, store.serialize_cdr(_typed(store, kind, message), kind))
    return folder


def _typed(store, kind: str, content: dict):
    """A message of rosbags from plain lists and tables."""
    made = {}
    for name, (_, of) in store.fielddefs[kind][1]:
        value = content[name]
        if isinstance(value, dict):
            value = _typed(store, of, value)
        elif isinstance(value, list) and of[0][1][0] == "float64":
            value = np.array(value, np.float64)
        made[name] = value
    return store.types[kind](**made)
