"""A run as MCAP, for Foxglove and ROS 2 tools: messages in CDR, schemas in ROS 2's own words.

For each device ``/DEVICE/sample`` holds every sample as it was stored: the scan's clock, station,
attempt, phase and each channel, to the bit; units stand in the schema's comments and in the
channel's metadata. What viewers know already is there too: ``/stage/pose`` (geometry_msgs
PoseStamped, in metres) and ``/DEVICE/wrench`` of a sensor of forces (geometry_msgs WrenchStamped).
Messages are stamped with the run's wall time, each session's own. The configuration is an
attachment, notes and how the run ended are on ``/events``.

Layout of a message: OMG CDR 1 (XCDR1), little-endian, as ROS 2 serialises; after the four bytes of
the encapsulation each number is aligned to its own size.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drivers import Channel
from drivers.core.extras import needs
from probe.core.contact_stress import tactile_or_none
from probe.core.events import Event, Note, Phase, RunEnded, RunStarted
from probe.storage.distinct_names import ENDINGS, LABELS, channel_names, distinct

if TYPE_CHECKING:
    import xarray as xr

    from probe.storage.run import Run

with needs("export", "MCAP"):
    from mcap.writer import Writer

Array = NDArray[Any]

ENCAPSULATION = b"\x00\x01\x00\x00"  # CDR, little-endian
FRAME = "scan"
HEADER = """\
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
VECTOR = """\
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
WRENCH = f"""\
std_msgs/Header header
geometry_msgs/Wrench wrench
================================================================================
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
{VECTOR}{HEADER}"""
POSE = f"""\
std_msgs/Header header
geometry_msgs/Pose pose
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
{HEADER}"""
TEXT = "string data\n"
PHASES = tuple(Phase)
AXES = (("fx", "fy", "fz"), ("mx", "my", "mz"))
NO_ROTATION = (0.0, 0.0, 0.0, 1.0)


def write(run: "Run", path: Path, about: str) -> None:
    """Write the whole run, with what is said ``about`` it as JSON; an existing file is replaced."""
    notable = [e for e in run.events() if isinstance(e, RunStarted | Note | RunEnded)]
    clock = WallClock([e for e in notable if isinstance(e, RunStarted)])
    topics = distinct({device: field(device) for device in run.channels})
    tactile = tactile_or_none(run.channels)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="palpate")
        said = {
            "started_utc": run.started.started_utc,
            "simulated": ", ".join(run.simulated),
            "tactile": f"/{topics[tactile]}/sample" if tactile else "",
            "finish": str(run.finish or ""),
            "clock_zero_unix_s": repr(float(clock.zeros_s[0])),
        }
        writer.add_metadata("palpate", said)
        at = int(clock.ns(np.array([run.started.time_s]))[0])
        writer.add_attachment(at, at, "config.json", "application/json", about.encode())
        stations = run.stations().to_csv(index=False).encode()
        writer.add_attachment(at, at, "stations.csv", "text/csv", stations)
        for device, topic in topics.items():
            _write_device(writer, device, topic, run.channels[device],
                          run.channel_samples(device), clock)  # fmt: skip
        _write_events(writer, notable, clock)
        writer.finish()  # type: ignore[no-untyped-call]


class WallClock:
    """Unix time on the scan's clock: each session of a resumed run has its own zero.

    A simulated scan's clock may be ahead of the day's; a session never begins before the last.
    """

    def __init__(self, sessions: Sequence[RunStarted]) -> None:
        self.began_s = np.array([one.time_s for one in sessions])
        wall_s = [datetime.fromisoformat(one.started_utc).timestamp() for one in sessions]
        self.zeros_s = np.maximum.accumulate(np.array(wall_s) - self.began_s)

    def ns(self, time_s: Array) -> NDArray[np.int64]:
        """Whole nanoseconds; the seconds apart, since a float holds no nanoseconds of today."""
        session = np.maximum(np.searchsorted(self.began_s, time_s, side="right") - 1, 0)
        zero_s = self.zeros_s[session]
        whole = np.floor(zero_s)
        rest = np.round(1e9 * (time_s + (zero_s - whole))).astype(np.int64)
        return np.asarray(whole.astype(np.int64) * 1_000_000_000 + rest, np.int64)


def sample_schema(device: str, channels: Sequence[Channel]) -> tuple[str, str]:
    """Name and text of the message that holds one sample of a ``device``, as topics have it."""
    names = fields(channels)
    lines = [
        "std_msgs/Header header",
        "float64 time_s  # on the scan's clock",
        "int32 station  # from 1, -1 between stations",
        "int32 attempt  # from 1, -1 between stations",
        *(f"uint8 PHASE_{phase.name}={n}" for n, phase in enumerate(PHASES)),
        "uint8 phase",
        *(f"float64 {name}  # {c.unit}" for name, c in zip(names, channels, strict=True)),
        *(f"bool {name}_saturated" for name in names),
    ]
    return f"palpate_msgs/msg/{_camel(device)}Sample", "\n".join(lines) + "\n" + HEADER


def fields(channels: Sequence[Channel]) -> list[str]:
    """What each channel is called in a message."""
    names = {name: field(name) for name in channel_names(channels)}
    return list(distinct(names, ("header", *LABELS), endings=ENDINGS).values())


def field(name: str) -> str:
    """A channel's name as ROS allows it: lower case, digits, single underscores, only ASCII."""
    plain = re.sub(r"_+", "_", re.sub(r"\W", "_", name.lower(), flags=re.ASCII)).strip("_")
    return plain if plain[:1].isalpha() else f"c_{plain}".rstrip("_")


def _write_device(
    writer: Writer, device: str, name: str, channels: Sequence[Channel], data: "xr.Dataset",
    clock: WallClock,
) -> None:  # fmt: skip
    time_s = data["time_s"].to_numpy()
    topic = "/" + name
    stamps = clock.ns(time_s)
    variables, names = channel_names(channels), fields(channels)
    number = {str(phase): n for n, phase in enumerate(PHASES)}
    columns: list[tuple[str, Array]] = [
        ("<f8", time_s),
        ("<i4", data["station"].to_numpy()),
        ("<i4", data["attempt"].to_numpy()),
        ("<u1", np.array([number[p] for p in data["phase"].to_numpy()], int)),
        *(("<f8", data[variable].to_numpy()) for variable in variables),
        *(("<u1", data[f"{variable}_saturated"].to_numpy()) for variable in variables),
    ]
    schema = sample_schema(name, channels)
    metadata = {f"unit of {one}": c.unit for one, c in zip(names, channels, strict=True)}
    metadata |= {f"role of {one}": c.role for one, c in zip(names, channels, strict=True)}
    metadata["simulated"] = ", ".join(c.name for c in channels if c.simulated)
    _write(writer, f"{topic}/sample", schema, stamps, columns, metadata)
    if device == "stage":
        values = [data[axis].to_numpy() for axis in "xyz"]
        values += [np.full(len(time_s), part) for part in NO_ROTATION]
        schema = ("geometry_msgs/msg/PoseStamped", POSE)
        _write(writer, f"{topic}/pose", schema, stamps, [("<f8", v) for v in values],
               {"unit": "m"})  # fmt: skip
        return
    parts = wrench_of(channels, data)
    if parts is not None:
        schema = ("geometry_msgs/msg/WrenchStamped", WRENCH)
        _write(writer, f"{topic}/wrench", schema, stamps, [("<f8", v) for v in parts],
               {"unit of force": "N", "unit of torque": "Nm"})  # fmt: skip


def wrench_of(channels: Sequence[Channel], data: "xr.Dataset") -> list[Array] | None:
    """Force x, y, z [N] and torque x, y, z [Nm]; a single force is the push along z."""
    known = dict(zip(channel_names(channels), channels, strict=True))
    names = {name for name, c in known.items() if c.unit in ("N", "Nm")}
    zero = np.zeros(data.sizes["time_s"])
    if set(AXES[0]) <= names:
        return [data[n].to_numpy() if n in names else zero for three in AXES for n in three]
    pushes = [name for name, c in known.items() if c.role == "force" and c.unit == "N"]
    return [zero, zero, data[pushes[0]].to_numpy(), zero, zero, zero] if pushes else None


def _write_events(writer: Writer, events: Sequence[Event], clock: WallClock) -> None:
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", TEXT.encode())
    channel = writer.register_channel("/events", "cdr", schema)
    for event in events:
        match event:
            case Note():
                text = f"{event.level}: {event.words}"
            case RunEnded():
                text = f"run {event.finish.value}: {event.reason}"
            case _:
                continue
        encoded = text.encode() + b"\0"
        body = ENCAPSULATION + len(encoded).to_bytes(4, "little") + encoded
        at = int(clock.ns(np.array([event.time_s]))[0])
        writer.add_message(channel, at, body, at)


def _write(
    writer: Writer, topic: str, schema: tuple[str, str], stamps: Array,
    columns: Sequence[tuple[str, Array]], metadata: dict[str, str],
) -> None:  # fmt: skip
    number = writer.register_schema(schema[0], "ros2msg", schema[1].encode())
    channel = writer.register_channel(topic, "cdr", number, metadata)
    for sequence, (at, body) in enumerate(zip(stamps.tolist(), _messages(stamps, columns),
                                              strict=True)):  # fmt: skip
        writer.add_message(channel, at, body, at, sequence)


def _messages(stamps: Array, columns: Sequence[tuple[str, Array]]) -> Iterator[bytes]:
    """The header (stamp, frame) and one value of each column, each aligned to its size."""
    layout = layout_of({str(n): kind for n, (kind, _) in enumerate(columns)})
    rows = np.zeros(len(stamps), layout)
    rows[".sec"], rows[".nanosec"] = np.divmod(stamps, 1_000_000_000)
    rows[".length"], rows[".frame"] = len(FRAME) + 1, FRAME
    for n, (_, values) in enumerate(columns):
        rows[str(n)] = values
    whole = rows.tobytes()
    for at in range(0, len(whole), layout.itemsize):
        yield ENCAPSULATION + whole[at : at + layout.itemsize]


def layout_of(fields: Mapping[str, str]) -> np.dtype[np.void]:
    """A message behind its encapsulation: header and ``fields``, numbers by their kinds, each
    aligned to its own size. No field's own name has a dot."""
    header = {".sec": "<i4", ".nanosec": "<u4", ".length": "<u4", ".frame": f"S{len(FRAME) + 1}"}
    kinds = {**header, **fields}
    offsets, at = [], 0
    for kind in kinds.values():
        size = np.dtype(kind).itemsize
        at += 0 if kind.startswith("S") else -at % size
        offsets.append(at)
        at += size
    return np.dtype(
        {"names": [*kinds], "formats": [*kinds.values()], "offsets": offsets, "itemsize": at}
    )


def _camel(device: str) -> str:
    return "".join(part.capitalize() for part in field(device).split("_"))
