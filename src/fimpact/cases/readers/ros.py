"""Bags of ROS 2 (MCAP files, `.db3` files, folders) and of ROS 1 as columns, whatever their messages are.

Each topic is a group of its own, with the column ``time`` (s, from the headers, or from the log where messages have
none) and one for each number in its messages: ``position/JOINT`` of a JointState, ``data[0]`` of an array,
``linear_acceleration/x`` of an Imu, ``reference/positions/JOINT`` of a controller's state. A topic that is no table of
numbers has one column of text, which says why it is not read.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fimpact.cases.errors import CaseError, listed, summarise_exception
from fimpact.cases.readers.columns import SI, Column, Table, exact

STATES = ("sensor_msgs/msg/JointState", "sensor_msgs/JointState")
NO_NUMBERS = ("header", "layout", "time_from_start")
BULKY = 1 << 16  # bytes of a message that is no row of a table
WIDE = 1000  # numbers of a message that is no row of a table
APART = 10**9  # ns between a header's clock and the log's, from which on they are two clocks
UNREAD = "(not read)"


@dataclass
class Topic:
    """Messages of a topic: their type, when they were logged and stamped (ns), and the numbers in their rows."""

    kind: str
    logged: list[int] = field(default_factory=list)
    stamped: list[int] = field(default_factory=list)
    rows: list[dict[str, float]] = field(default_factory=list)


def bag(path: Path) -> Table:
    """Columns of every topic of a bag.

    Raises:
        CaseError: it was not closed, or no topic has numbers.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.highlevel.anyreader import AnyReaderError
    from rosbags.typesys import Stores, get_typestore

    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            topics, unread = _topics(reader, path)
    except AnyReaderError as error:
        hint = "; it was not closed: repair it with `mcap recover`" if "end magic" in str(error) else ""
        raise CaseError(f"data file {path} cannot be read as a bag: {summarise_exception(error)}{hint}") from None
    except KeyError as error:
        raise CaseError(
            f"data file {path} holds messages of the encoding or type {error}, which is none of ROS; export the "
            "joints' topics alone (`mcap filter`), or convert them to CSV"
        ) from None
    if not topics:
        others = ", ".join(f"{topic} ({why})" for topic, why in unread.items()) or "nothing"
        raise CaseError(f"data file {path} has no topic of numbers; it has: {others}; record the joints")
    said = [Column(UNREAD, topic, np.array([why]), np.zeros(1, bool)) for topic, why in unread.items()]
    stamps = _stamps(topics)
    return [*(one for name, topic in topics.items() for one in _columns(name, topic, stamps[name])), *said]


def _topics(reader, path: Path) -> tuple[dict[str, Topic], dict[str, str]]:
    """Topics that are tables of numbers, and why others are not."""
    topics, unread = {}, {}
    for connection in reader.connections:
        why = _unreadable(reader, connection, path)
        if why:
            unread[connection.topic] = f"{connection.msgtype}: {why}"
        else:
            topics[connection.topic] = Topic(connection.msgtype)
    wanted = [connection for connection in reader.connections if connection.topic in topics]
    for connection, logged, raw in reader.messages(wanted) if wanted else ():
        _append(topics[connection.topic], reader.deserialize(raw, connection.msgtype), logged, path)
    return topics, {topic: why for topic, why in unread.items() if topic not in topics}


def _unreadable(reader, connection, path: Path) -> str:
    """Why the messages of a connection are no rows of a table; "" where they are."""
    first = next(reader.messages([connection]), None) if connection.msgcount else None
    if first is None:
        return "no message"
    if len(first[2]) > BULKY:
        return f"{len(first[2])} bytes a message"
    try:
        message = reader.deserialize(first[2], connection.msgtype)
    except Exception as error:
        return f"its definition is not in the bag or does not fit ({summarise_exception(error)})"
    rows = list(_rows(message, path))
    count = max((len(row) for _, row in rows), default=0)
    return "no numbers" if not count else f"{count} numbers a message" if count > WIDE else ""


def _append(topic: Topic, message, logged: int, path: Path) -> None:
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    stamped = _nanoseconds(stamp) if stamp is not None else 0
    for later, row in _rows(message, path):
        topic.logged.append(logged + later)
        topic.stamped.append(stamped + later if stamped else 0)
        topic.rows.append(row)


def _nanoseconds(time) -> int:
    return time.sec * 10**9 + time.nanosec


def _rows(message, path: Path) -> Iterator[tuple[int, dict[str, float]]]:
    """Numbers of a message, and how many ns after its stamp they are meant; of a trajectory, one row per point."""
    if hasattr(message, "points") and hasattr(message, "joint_names"):
        for point in message.points:
            yield _nanoseconds(point.time_from_start), dict(_numbers(point, "", list(message.joint_names), path))
    else:
        yield 0, dict(_numbers(message, "", [], path))


def _numbers(message: Any, before: str, names: list[str], path: Path) -> Iterator[tuple[str, float]]:
    """Each number in a message under the path to it; entries of an array by the names that the message has for them."""
    values = {name: getattr(message, name) for name in _fields(message.__class__)}
    own = [list(value) for key, value in values.items() if key.endswith(("name", "names")) and _texts(value)]
    names = own[0] if own else names
    for key, value in values.items():
        if key in NO_NUMBERS or key.endswith("covariance") or isinstance(value, str) or _texts(value):
            continue
        if hasattr(value, "__len__"):
            if message.__msgtype__ in STATES and len(value) not in (0, len(names)):
                raise CaseError(
                    f"data file {path}: a JointState has {len(names)} names but {len(value)} entries in {key}; "
                    f"allowed: as many or none; {listed(names, '')}"
                )
            labels = [f"/{n}" for n in names] if len(names) == len(value) else [f"[{i}]" for i in range(len(value))]
            if isinstance(value, np.ndarray):
                yield from zip((f"{before}{key}{label}" for label in labels), value.tolist(), strict=True)
                continue
            for label, entry in zip(labels, value, strict=True):
                yield from _entry(entry, f"{before}{key}{label}", names, path)
        else:
            yield from _entry(value, f"{before}{key}", names, path)


@cache
def _fields(kind: type) -> tuple[str, ...]:
    return tuple(one.name for one in fields(kind))


def _entry(value, name: str, names: list[str], path: Path) -> Iterator[tuple[str, float]]:
    if hasattr(value, "__msgtype__"):
        if not value.__msgtype__.endswith(("/Time", "/Duration")):
            yield from _numbers(value, f"{name}/", names, path)
    else:
        yield name, float(value)


def _texts(value) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(one, str) for one in value)


def _stamps(topics: dict[str, Topic]) -> dict[str, np.ndarray]:
    """Times of each topic in ns, all of one clock: that of the headers, set to the log's where a topic has none and
    they are far apart (as a simulated clock is)."""
    logged = {name: np.array(topic.logged) for name, topic in topics.items()}
    stamped = {name: np.array(topic.stamped) for name, topic in topics.items()}
    bare = [name for name, times in stamped.items() if not times.all()]
    out = {name: logged[name] if name in bare else times for name, times in stamped.items()}
    for name in set(out) - set(bare):
        apart = int(np.median(logged[name] - out[name]))
        if bare and abs(apart) > APART:
            out[name] = out[name] + apart
    return out


def _columns(name: str, topic: Topic, stamps: np.ndarray) -> Table:
    kept = np.ones(len(stamps), bool)
    if topic.kind.endswith("/JointTrajectory"):  # what a later message replaced was never asked for
        later = np.append(stamps[1:], np.iinfo(stamps.dtype).max)
        kept = stamps < np.minimum.accumulate(later[::-1])[::-1]
    order = np.flatnonzero(kept)
    rows = [topic.rows[index] for index in order]
    out = [Column("time", name, 1e-9 * exact(stamps[order]), np.zeros(len(order), bool), clock=True)]
    for key in dict.fromkeys(key for row in rows for key in row):
        absent = np.array([key not in row for row in rows])
        values = np.array([row.get(key, np.nan) for row in rows], dtype=float)
        if not np.isnan(values).all():
            out.append(Column(key, name, values, absent, unit=SI))
    return out
