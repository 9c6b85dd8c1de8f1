"""ROS 2 `sensor_msgs/JointState` messages of an MCAP file as columns.

Each topic is a group of its own, with the columns ``time`` (s, from the header, or the log where the header has none)
and ``position/JOINT``, ``velocity/JOINT``, ``effort/JOINT``.
"""

from pathlib import Path

import numpy as np

from fimpact.cases.errors import CaseError, listed
from fimpact.cases.readers import Column, Table, exact

MESSAGE = "sensor_msgs/msg/JointState"
FIELDS = ("position", "velocity", "effort")


def mcap(path: Path) -> Table:
    """Columns of every JointState topic of an MCAP file."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    topics, seen = {}, set()
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        seen = _schemas(reader)
        wanted = [topic for topic, schema in seen.items() if schema in (MESSAGE, "sensor_msgs/JointState")]
        if not wanted:
            raise CaseError(
                f"data file {path} has no {MESSAGE}; it has: {', '.join(sorted(set(seen.values()))) or 'nothing'}; "
                "record the joint states, or convert it to CSV"
            )
        for _, channel, message, state in reader.iter_decoded_messages(topics=wanted, log_time_order=False):
            topics.setdefault(channel.topic, []).append((message.log_time, state))
    return [column for topic, states in topics.items() for column in _columns(topic, states, path)]


def _schemas(reader) -> dict[str, str]:
    summary = reader.get_summary()
    if summary is None:
        raise CaseError("data file has no summary: it was not closed; repair it with `mcap recover`")
    named = {channel.topic: summary.schemas.get(channel.schema_id) for channel in summary.channels.values()}
    return {topic: schema.name if schema else "messages without a schema" for topic, schema in named.items()}


def _columns(topic: str, states: list, path: Path) -> Table:
    columns = {"time": 1e-9 * exact(_stamps(states))}
    joints = sorted({joint for _, state in states for joint in state.name})
    for field in FIELDS:
        for joint in joints:
            columns[f"{field}/{joint}"] = np.array([_entry(state, field, joint, path) for _, state in states])
    kept = {name: values for name, values in columns.items() if name == "time" or not np.isnan(values).all()}
    absent = {
        name: np.isnan(values) & np.array([_lacks(state, name) for _, state in states]) for name, values in kept.items()
    }
    return [Column(name, topic, values, absent[name], clock=name == "time") for name, values in kept.items()]


def _stamps(states: list) -> np.ndarray:
    """Times (n,) in ns from the headers; from the log where no header has one (a simulated clock begins at 0)."""
    headers = np.array([state.header.stamp.sec * 10**9 + state.header.stamp.nanosec for _, state in states])
    return headers if headers.any() else np.array([log_time for log_time, _ in states])


def _entry(state, field: str, joint: str, path: Path) -> float:
    values = getattr(state, field)
    if joint not in state.name or not len(values):
        return np.nan
    if len(values) != len(state.name):
        raise CaseError(
            f"data file {path}: a JointState has {len(state.name)} names but {len(values)} entries in {field}; "
            f"allowed: as many or none; {listed(state.name, joint)}"
        )
    return float(values[list(state.name).index(joint)])


def _lacks(state, name: str) -> bool:
    field, _, joint = name.partition("/")
    return name != "time" and (joint not in state.name or not len(getattr(state, field)))
