"""Messages of ROS bags (.bag, .db3, .mcap): every number by topic and place, decoded by rosbags.

The files themselves are walked from their beginning, for a recorder that died wrote no index.
"""

import bz2
import json
import sqlite3
import struct
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import fields, is_dataclass
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from drivers.core.errors import MissingExtra
from drivers.core.extras import needs
from probe.storage.import_columns import Column, Recording
from probe.storage.import_table import CsvError

UNITS = {".force": "N", ".torque": "Nm", ".position": "m", ".translation": "m"}
"""Of vectors in messages: ROS measures in SI (REP 103)."""
CONNECTION, MESSAGE, CHUNK = 7, 2, 5  # of the format of ROS 1 bags, version 2.0


class Topic(NamedTuple):
    """How the messages of a topic are written: ``encoding`` is cdr, ros1 or json."""

    name: str
    kind: str
    definition: str = ""
    encoding: str = "cdr"


Messages = Iterator[tuple[Topic, int, bytes]]
"""Topic, the time of the log [ns] and the message."""


def read_bag(source: Path) -> Recording:
    """A bag of ROS 1; of an unfinished one what is whole."""
    notes: list[str] = []
    with source.open("rb") as file:
        return _columns(_of_bag(file, notes), notes)


def read_db3(source: Path) -> Recording:
    """The database of a ROS 2 bag; it needs no metadata.yaml."""
    notes: list[str] = []
    with closing(sqlite3.connect(f"{source.resolve().as_uri()}?mode=ro", uri=True)) as database:
        return _columns(_of_db3(database, notes), notes)


def read_mcap_messages(source: Path) -> Recording:
    """An MCAP file; of an unfinished one what is whole."""
    notes: list[str] = []
    with source.open("rb") as file:
        return _columns(_of_mcap(file, notes), notes)


def _of_bag(file: BinaryIO, notes: list[str]) -> Messages:
    if not file.readline().startswith(b"#ROSBAG V2.0"):
        raise CsvError("is no ROS 1 bag of version 2.0")
    topics: dict[bytes, Topic] = {}
    try:
        for op, header, data in _records(file):
            if op == CHUNK:
                plain = _unpacked(header[b"compression"], data)
                for inner, own, content in _records(BytesIO(plain)):
                    if inner == CONNECTION:
                        said = dict(_fields(content))
                        kind = said[b"type"].decode().replace("/", "/msg/")
                        text = said[b"message_definition"].decode("utf-8", "replace")
                        topics[own[b"conn"]] = Topic(own[b"topic"].decode(), kind, text, "ros1")
                    elif inner == MESSAGE:
                        seconds, nanoseconds = struct.unpack("<II", own[b"time"])
                        yield topics[own[b"conn"]], seconds * 10**9 + nanoseconds, content
            elif header.get(b"index_pos") == bytes(8):
                notes.append("the bag was not finished; what is whole is read (`rosbag reindex`)")
    except (EOFError, OSError, ValueError, KeyError, struct.error, RuntimeError) as error:
        notes.append(f"the bag is damaged or cut off; what is whole before it is read ({error})")


def _records(file: BinaryIO) -> Iterator[tuple[int, dict[bytes, bytes], bytes]]:
    """Kind, header and data of each. An uncompressed chunk that is cut off is given as far as it
    is there. Raises `EOFError` at an end within a record."""
    while start := file.read(4):
        (length,) = struct.unpack("<I", start)
        header = dict(_fields(file.read(length)))
        op = header[b"op"][0]
        (size,) = struct.unpack("<I", file.read(4))
        data = file.read(size)
        if len(data) == size or (op == CHUNK and header[b"compression"] == b"none"):
            yield op, header, data
        if len(data) < size:
            raise EOFError(f"{size - len(data)} bytes are missing")


def _fields(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 0
    while at < len(content):
        (length,) = struct.unpack_from("<I", content, at)
        name, _, value = content[at + 4 : at + 4 + length].partition(b"=")
        yield name, value
        at += 4 + length


def _unpacked(compression: bytes, data: bytes) -> bytes:
    if compression == b"bz2":
        return bz2.decompress(data)
    if compression == b"lz4":
        with needs("formats", "ROS bags"):
            from lz4.frame import decompress
        return bytes(decompress(data))
    return data


def _of_db3(database: sqlite3.Connection, notes: list[str]) -> Messages:
    definitions: dict[str, str] = {}
    try:
        # else SQLite reads nothing of a file with fewer pages than its head says
        database.execute("PRAGMA writable_schema = ON")
        tables = {name for (name,) in database.execute("SELECT name FROM sqlite_schema")}
        if not {"topics", "messages"} <= tables:
            raise CsvError("is an SQLite file, but no ROS 2 bag: no tables topics and messages")
        if "message_definitions" in tables:
            listed = database.execute(
                "SELECT topic_type, encoded_message_definition FROM message_definitions"
            )
            definitions = dict(listed.fetchall())
        topics = {
            number: Topic(name, kind, definitions.get(kind, ""))
            for number, name, kind in database.execute("SELECT id, name, type FROM topics")
        }
        for number, logged_ns, data in database.execute(
            "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
        ):
            yield topics[number], logged_ns, data
    except (sqlite3.Error, KeyError) as error:
        notes.append(f"the database is damaged; what is whole before it is read ({error})")


def _of_mcap(file: BinaryIO, notes: list[str]) -> Messages:
    with needs("export", "MCAP"):
        from mcap.exceptions import McapError
        from mcap.reader import NonSeekingReader

    try:
        for schema, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            if schema is not None:
                text = schema.data.decode("utf-8", "replace")
                topic = Topic(channel.topic, schema.name, text, channel.message_encoding)
                yield topic, message.log_time, message.data
    except (McapError, OSError, ValueError, struct.error):
        notes.append("the file was not finished; what is whole is read (`mcap recover`)")


def _columns(messages: Messages, notes: list[str]) -> Recording:
    """The numbers of each topic over its times: of the headers, or of the log without."""
    times: dict[str, list[float]] = {}
    rows: dict[str, list[dict[str, Any]]] = {}
    wrenches: set[str] = set()
    bad: dict[str, int] = {}
    for topic, logged_ns, data in messages:
        try:
            message = _decoded(topic, data)
        except Unread as error:
            key = f"topic {topic.name}: {error}"
            bad[key] = bad.get(key, 0) + 1
            continue
        if numbers := dict(_numbers(topic.name, message)):
            times.setdefault(topic.name, []).append(1e-9 * (_stamp_ns(message) or logged_ns))
            rows.setdefault(topic.name, []).append(numbers)
        if topic.kind.rpartition("/")[2] == "WrenchStamped":
            wrenches.add(topic.name)
    notes += [f"{what}; {count} messages are left out" for what, count in bad.items()]
    columns: dict[str, Column] = {}
    for name, own in rows.items():
        time_s = np.array(times[name])
        for path in own[0]:
            try:
                values = np.array([row.get(path, np.nan) for row in own], np.float64)
            except ValueError:
                notes.append(f"{path} changes its length and is left out")
                continue
            unit = UNITS.get(path[:-2][path[:-2].rfind(".") :], "") if path[-2:-1] == "." else ""
            columns[path] = Column(values, time_s, unit)
    if not columns:
        raise CsvError("no whole message of numbers is in it" + "".join(f"; {n}" for n in notes))
    forces = [f"{name}.wrench.force.z" for name in sorted(wrenches)]
    return Recording(columns, tuple(notes), {"force_n": forces})


class Unread(ValueError):
    """A message that is in another encoding, or not whole."""


def _decoded(topic: Topic, data: bytes) -> Any:
    """The message. Raises `Unread`."""
    if topic.encoding not in ("cdr", "ros1", "json"):
        raise Unread(f"in {topic.encoding!r}; cdr, ros1 and json are read")
    try:
        if topic.encoding == "json":
            return json.loads(data)
        store = _store(topic.kind, topic.definition)
        if topic.encoding == "ros1":
            return store.deserialize_ros1(data, topic.kind)
        return store.deserialize_cdr(data, topic.kind)
    except (Unread, MissingExtra):
        raise
    except Exception as error:  # noqa: BLE001 -- rosbags' own, at a damaged message
        raise Unread(f"not whole ({error})") from None


@cache
def _store(kind: str, definition: str) -> Any:
    """What decodes messages of that kind, by the file's definition or ROS 2's own."""
    with needs("formats", "a ROS bag"):
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    store = get_typestore(Stores.EMPTY if definition else Stores.ROS2_HUMBLE)
    if definition:
        store.register(get_types_from_msg(definition, kind))
    elif kind not in store.types:
        raise Unread(f"{kind}: the file does not say what is in it")
    return store


def _stamp_ns(message: Any) -> int:
    """The time of a message's header [ns]; 0 without one."""
    stamp = _inner(_inner(message, "header"), "stamp")
    seconds = _inner(stamp, "sec", "secs") or 0  # secs and nsecs: rosbridge of ROS 1
    return int(seconds) * 10**9 + int(_inner(stamp, "nanosec", "nsec", "nsecs") or 0)


def _inner(message: Any, *names: str) -> Any:
    if isinstance(message, Mapping):
        return next((message[name] for name in names if name in message), None)
    return next((getattr(message, name) for name in names if hasattr(message, name)), None)


def _numbers(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """The numbers of a message and its lists of numbers by their place in it; its header is none
    of them."""
    if is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if key not in ("header", "layout"):
                yield from _numbers(f"{name}.{key}", inner)
    elif isinstance(value, np.ndarray | list) and len(value):
        array = np.asarray(value)
        if array.dtype.kind in "iuf":
            yield name, array
    elif isinstance(value, int | float | np.number):
        yield name, float(value)
