"""Samples in MCAP files: those that ``palpate export`` wrote, and WrenchStamped messages of others.

Ours come to the bit, with the plan's places; geometry_msgs WrenchStamped in CDR or JSON.
"""

import json
import struct
from collections.abc import Iterator, Mapping
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from drivers import Channel
from drivers.core.arrays import Array
from drivers.core.extras import needs
from probe.core.contact_stress import tactile_or_none
from probe.core.places import planned
from probe.storage.import_device import Device, face_mm2_of, judged, placed
from probe.storage.import_foreign import timed
from probe.storage.import_table import (
    DEPTH,
    PHASE,
    PLACES,
    SIGNALS,
    CsvError,
    Table,
    check_size,
    saturated,
    signal,
)

with needs("data", "palpate import"):
    import pandas as pd

SAMPLE, WRENCH = "palpate_msgs/msg/", "WrenchStamped"
ROLE = "role of "
AXES = ("force.x", "force.y", "force.z")


def read_mcap(source: Path, topic: str | None, mapping: Mapping[str, str]) -> Table:
    """The samples of the device that the run was judged on, or the wrenches of ``topic``, whose
    ``mapping`` may say another axis or sign than ``{"force_n": "force.z"}``."""
    wanted = mapping.get("force_n", AXES[2])
    axis, sign = wanted.removeprefix("-"), -1.0 if wanted.startswith("-") else 1.0
    if axis not in AXES or mapping.keys() - {"force_n"}:
        raise CsvError(f"--map: of a wrench force_n is {', '.join(AXES)}, or one of them with a -")
    with needs("export", "MCAP"):
        from mcap.exceptions import McapError
        from mcap.reader import NonSeekingReader, make_reader

    notes: list[str] = []
    try:
        with source.open("rb") as file:
            reader = make_reader(file)
            summary = reader.get_summary()
            names = _names(summary) if summary is not None else {}
            ours = [t for t, name in names.items() if name.startswith(SAMPLE)]
            if ours and topic is None and not mapping:
                return _own_samples(reader, summary, ours)
    except (McapError, OSError):  # a recorder that died wrote no end
        names = {}
    samples: dict[str, list[tuple[float, ...]]] = {t: [] for t in names if _is_wrench(names[t])}
    with source.open("rb") as file:
        try:
            for schema, channel, message in NonSeekingReader(file).iter_messages(
                log_time_order=False
            ):
                if (
                    schema is not None
                    and _is_wrench(schema.name)
                    and topic in (None, channel.topic)
                ):
                    row = _wrench(channel.message_encoding, message)
                    samples.setdefault(channel.topic, []).append(row)
        except (McapError, OSError, ValueError, struct.error) as error:
            if not any(samples.values()):
                why = f" ({error})" if str(error) else ""
                raise CsvError(
                    f"not a whole MCAP file{why}: not finished, and no whole wrench is in it; "
                    "`mcap recover` may repair it"
                ) from None
            notes.append("the file was not finished; what is whole is read (`mcap recover`)")
    chosen = [t for t in samples if topic in (None, t)]
    if len(chosen) != 1:
        listed = ", ".join(sorted(samples)) or "none"
        raise CsvError(f"--topic must name one topic of WrenchStamped; found: {listed}")
    read = pd.DataFrame(samples[chosen[0]], columns=["time_s", *AXES], dtype=float)
    table = pd.DataFrame({"time_s": read["time_s"], signal(0): sign * read[axis]})
    check_size(table["time_s"].to_numpy(), f"time of {chosen[0]}", "s")
    check_size(table[signal(0)].to_numpy(), f"{axis} of {chosen[0]}", "N")
    table = timed(table, notes).assign(**{saturated(0): 0.0})
    return Table(table, (SIGNALS["force_n"],), ("force_n",), notes=tuple(notes))


def _names(summary: Any) -> dict[str, str]:
    """The kind of message of each topic."""
    return {
        c.topic: summary.schemas[c.schema_id].name
        for _, c in sorted(summary.channels.items())
        if c.schema_id in summary.schemas
    }


def _is_wrench(name: str) -> bool:
    return name.rpartition("/")[2] == WRENCH


def _wrench(encoding: str, message: Any) -> tuple[float, ...]:
    """Time [s] of the header, or of the log where it has none, and the force along `AXES` [N]."""
    if encoding == "json":
        decoded = json.loads(message.data)
        stamp = decoded["header"]["stamp"]
        seconds = stamp.get("sec", stamp.get("secs", 0))  # secs and nsecs: rosbridge of ROS 1
        nanosec = next((stamp[k] for k in ("nanosec", "nsec", "nsecs") if k in stamp), 0)
        force = decoded["wrench"]["force"]
        return _time_s(seconds, nanosec, message), *(float(force[along]) for along in "xyz")
    if encoding != "cdr":
        raise CsvError(f"messages in {encoding!r}: cdr and json are read")
    order = "<" if message.data[1] & 1 else ">"
    seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", message.data, 4)
    at = 12 + length
    force_n = struct.unpack_from(f"{order}3d", message.data, 4 + at + -at % 8)
    return _time_s(seconds, nanoseconds, message), *force_n


def _time_s(seconds: int, nanoseconds: int, message: Any) -> float:
    total = int(seconds) * 1_000_000_000 + int(nanoseconds) or int(message.log_time)
    return total * 1e-9


def _own_samples(reader: Any, summary: Any, topics: list[str]) -> Table:
    channels = {c.topic: c for c in summary.channels.values()}
    devices = {topic: _device(reader, summary, channels[topic]) for topic in topics}
    said = {one.name: one.metadata for one in reader.iter_metadata()}.get("palpate", {})
    first = tactile_or_none({t: tuple(own.channels.values()) for t, own in devices.items()})
    table = judged(devices, said.get("tactile") or first)
    attached = {a.name: a.data for a in reader.iter_attachments()}
    config = attached.get("config.json", b"{}")
    places = planned(json.loads(config))
    at_mm = {
        name: {index + 1: round(1e3 * place[n], 9) for index, place in places.items()}
        for n, name in enumerate(PLACES)
    }
    if "stations.csv" in attached:  # exports of older versions have none
        stations = pd.read_csv(BytesIO(attached["stations.csv"]))
        at_mm[DEPTH] = dict(zip(stations["station"], stations[DEPTH], strict=True))
    return placed(table, at_mm)._replace(face_mm2=face_mm2_of(config))


def _device(reader: Any, summary: Any, channel: Any) -> Device:
    layout = _layout(summary.schemas[channel.schema_id].data.decode())
    said = channel.metadata

    @cache
    def samples() -> Any:
        topics = [channel.topic]
        bodies = (m.data[4:][: layout.itemsize] for _, _, m in reader.iter_messages(topics))
        return np.frombuffer(b"".join(bodies), layout)

    def read(name: str) -> Array:
        return np.asarray(samples()["phase" if name == PHASE else name], np.float64)

    channels = {
        name: Channel(
            name, said.get(f"unit of {name}", ""), role, simulated=bool(said.get("simulated"))
        )
        for name in layout.names or ()
        if (role := said.get(ROLE + name)) is not None
    }
    return Device(channels, {*(layout.names or ()), PHASE}, read)


def _layout(text: str) -> np.dtype[np.void]:
    """Fields of the message behind its header."""
    kinds = {"float64": "<f8", "int32": "<i4", "uint8": "<u1", "bool": "<u1"}
    at, names, formats, offsets = 12 + len("scan") + 1, [], [], []
    for kind, name in _fields(text):
        if "=" in name or kind not in kinds:
            continue
        size = np.dtype(kinds[kind]).itemsize
        at += -at % size
        names.append(name)
        formats.append(kinds[kind])
        offsets.append(at)
        at += size
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": at})


def _fields(text: str) -> Iterator[tuple[str, str]]:
    """Type and name of each field of the first message of a ROS 2 definition."""
    for line in text.split("=" * 80)[0].splitlines():
        words = line.partition("#")[0].split()
        if len(words) == 2:
            yield words[0], words[1]
