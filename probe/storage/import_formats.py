"""Recordings that are no plain CSV, as the table that ``palpate import`` reads.

What ``palpate export`` wrote (CSV, Parquet, netCDF, HDF5, MCAP), and MCAP files of others with
geometry_msgs WrenchStamped messages in CDR or JSON. The columns are those of
`probe.storage.csv_columns`, with every number to the bit; the reference comes along where the file
says which channel it is. An infinite reading is none.
"""

import json
import struct
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drivers.core.extras import needs, require
from probe.core.events import Phase
from probe.core.places import planned
from probe.storage.csv_columns import PHASE, SIGNALS, CsvError

with needs("data", "palpate import"):
    import pandas as pd

ENDINGS = (".parquet", ".nc", ".h5", ".mcap")
SAMPLE, WRENCH = "palpate_msgs/msg/", "WrenchStamped"
PLACE_COLUMNS = ("x_mm", "y_mm")
LABELS = ["time_s", "station", "attempt"]
SIMULATED = "-simulated"  # ends the name of a table of simulated samples
REFERENCE, ROLE = "reference", "role of "
INFINITE = [np.inf, -np.inf, "inf", "-inf"]
BAD_FILE = (OSError, ValueError, KeyError, struct.error)


@dataclass(frozen=True)
class Foreign:
    """CSV text in the columns of an import, whether its readings are ``simulated``, and the probe's
    face [mm2] where the file has it."""

    csv: bytes
    simulated: bool
    face_mm2: float | None


class Table(NamedTuple):
    """The samples of a file, with what else it says of them: see `Foreign`."""

    samples: pd.DataFrame
    simulated: bool = False
    face_mm2: float | None = None


def is_exported(header: str) -> bool:
    """Whether the first line of a CSV is that of samples that ``palpate export`` wrote."""
    return {"time_s", "station", "attempt", "phase"} <= set(header.strip().split(","))


def as_csv(source: Path, topic: str | None = None) -> Foreign:
    """The file as CSV text. ``topic`` chooses among the wrenches of an MCAP file.

    Raises `CsvError` for what cannot be read, and `drivers.MissingExtra`.
    """
    simulated = source.name.partition(".")[0].endswith(SIMULATED)
    try:
        match source.suffix:
            case ".mcap":
                table = _mcap(source, topic)
            case ".parquet":
                require("pyarrow", "export", "Parquet")
                table = Table(pd.read_parquet(source), simulated)
            case ".nc" | ".h5":
                table = _groups(source)
            case _:
                # Numbers stay text: they are read once, by the import itself.
                kinds: defaultdict[str, type] = defaultdict(lambda: str, station=int, attempt=int)
                table = Table(pd.read_csv(source, dtype=kinds), simulated)
    except BAD_FILE as error:
        raise CsvError(f"{source}: cannot be read ({error})") from None
    csv = _presses(table.samples, source).to_csv(index=False).encode()
    return Foreign(csv, table.simulated, table.face_mm2)


def _presses(table: pd.DataFrame, source: Path) -> pd.DataFrame:
    """The samples of each station's last attempt, in the columns that an import knows."""
    lower = {name: str(name).lower() for name in table if str(name).lower() in SIGNALS}
    table = table.rename(columns=lower)
    signals = [name for name in SIGNALS if name in table]
    if not signals:
        raise CsvError(f"{source}: no column of {', '.join(SIGNALS)}")
    if "station" in table:
        table = table[table["station"] >= 0]
        if "attempt" in table:
            last = table.groupby("station")["attempt"].transform("max")
            table = table[table["attempt"] == last]
    # a run without positions has columns of them with nothing in it
    beside = [n for n in (*PLACE_COLUMNS, "station") if n in table and table[n].notna().any()]
    known = [signals[0], *({REFERENCE} & set(table))]
    table = table.assign(**{name: table[name].replace(INFINITE, np.nan) for name in known})
    if "phase" in table:
        numbers = {str(phase): n for n, phase in enumerate(Phase)}
        table = table.assign(**{PHASE: table["phase"].astype(str).map(numbers)})
        beside.append(PHASE)
    return table[["time_s", *known, *beside]]


def _groups(source: Path) -> Table:
    """The samples of the tactile sensor in a netCDF or HDF5 export, with the reference and its
    stations' places."""
    require("h5py", "export", "HDF5 and netCDF")
    import h5py

    with h5py.File(source) as file:
        chosen = _text(file.attrs.get("tactile", ""))  # the run's own choice, where there are two
        first = [file.get(chosen)] if chosen else []
        groups = [
            g for g in (*first, *file.values()) if isinstance(g, h5py.Group) and LABELS[0] in g
        ]
        signals = ((g, n) for g in groups for n in ("force", "pressure") if n in g)
        if (found := next(signals, None)) is None:
            raise CsvError(f"{source}: no group of samples as `palpate export` writes them")
        group, name = found
        table = _labelled(group, name, f"{name}_{_text(group[name].attrs['units'])}")
        table["phase"] = [_text(phase) for phase in group["phase"][:]]
        beside = ((g, n) for g in groups for n in g if _text(g[n].attrs.get("role")) == REFERENCE)
        if reference := next(beside, None):
            table = _with_reference(table, _labelled(*reference, REFERENCE))
        simulated = bool(group[name].attrs.get("simulated", 0))
        config = file.attrs.get("config") or file["config"][()]
        return Table(
            _placed(table, file.get("stations", file)), simulated, _face_mm2(_text(config))
        )


def _face_mm2(config: str | bytes) -> float | None:
    face_mm2 = json.loads(config or "{}").get("face_mm2")
    return float(face_mm2) if face_mm2 else None


def _text(value: object) -> str:
    """An attribute of HDF5; what is no text is none."""
    return value.decode() if isinstance(value, bytes) else value if isinstance(value, str) else ""


def _labelled(columns: Mapping[str, Any], name: str, called: str) -> pd.DataFrame:
    """One channel with the labels of its samples."""
    return pd.DataFrame({**{n: columns[n][:] for n in LABELS}, called: columns[name][:]})


def _with_reference(table: pd.DataFrame, reference: pd.DataFrame) -> pd.DataFrame:
    """Both in one table, in time: the reference may be of another device with times of its own."""
    return table.merge(reference, on=LABELS, how="outer").sort_values("time_s", kind="stable")


def _placed(table: pd.DataFrame, stations: Any) -> pd.DataFrame:
    station, first = np.unique(stations["station"][:], return_index=True)
    for name in PLACE_COLUMNS:
        places = pd.Series(stations[name][:][first], station)
        table[name] = places.reindex(table["station"]).to_numpy()
    return table


def _mcap(source: Path, topic: str | None) -> Table:
    with needs("export", "MCAP"):
        from mcap.exceptions import McapError
        from mcap.reader import make_reader

    try:
        with source.open("rb") as file:
            reader = make_reader(file)
            summary = reader.get_summary()
            if summary is None:
                raise CsvError(f"{source}: has no summary; `mcap recover` repairs it")
            names = {
                c.topic: summary.schemas[c.schema_id].name
                for c in summary.channels.values()
                if c.schema_id in summary.schemas
            }
            ours = [t for t, name in names.items() if name.startswith(SAMPLE)]
            if ours and topic is None:
                return _own_samples(reader, summary, ours, source)
            wrenches = [t for t, name in names.items() if name.rpartition("/")[2] == WRENCH]
            chosen = [t for t in wrenches if topic in (None, t)]
            if len(chosen) != 1:
                found = ", ".join(sorted(wrenches)) or "none"
                raise CsvError(
                    f"{source}: --topic must name one topic of WrenchStamped; found: {found}"
                )
            rows = [_wrench(c.message_encoding, m) for _, c, m in reader.iter_messages(chosen)]
    except McapError as error:
        raise CsvError(f"{source}: not a whole MCAP file ({error})") from None
    return Table(pd.DataFrame(rows, columns=["time_s", "force_n"]))


def _wrench(encoding: str, message: Any) -> tuple[float, float]:
    """Time [s] of the header, or of the log where it has none, and the force along z [N]."""
    if encoding == "json":
        decoded = json.loads(message.data)
        stamp = decoded["header"]["stamp"]
        nanosec = stamp.get("nanosec", stamp.get("nsec", 0))
        return _time_s(stamp["sec"], nanosec, message), float(decoded["wrench"]["force"]["z"])
    if encoding != "cdr":
        raise CsvError(f"messages in {encoding!r}: cdr and json are read")
    order = "<" if message.data[1] & 1 else ">"
    seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", message.data, 4)
    at = 12 + length
    (force_z,) = struct.unpack_from(f"{order}d", message.data, 4 + at + -at % 8 + 16)
    return _time_s(seconds, nanoseconds, message), force_z


def _time_s(seconds: int, nanoseconds: int, message: Any) -> float:
    total = int(seconds) * 1_000_000_000 + int(nanoseconds) or int(message.log_time)
    return total * 1e-9


def _own_samples(reader: Any, summary: Any, topics: list[str], source: Path) -> Table:
    """Samples that `probe.storage.export_mcap` wrote: to the bit, with the plan's places."""
    channels = {c.topic: c for c in summary.channels.values()}
    tables = {topic: _own_table(reader, summary, channels[topic]) for topic in topics}
    signals = ((t, n) for t, table in tables.items() for n in SIGNALS if n in table)
    if (found := next(signals, None)) is None:
        raise CsvError(f"{source}: no device that measures force or pressure")
    topic, signal = found
    chosen = tables[topic][[*LABELS, "phase", signal]].copy()
    chosen["phase"] = chosen["phase"].map(dict(enumerate(Phase)))
    beside = (
        (table, _column(key.removeprefix(ROLE), channels[other].metadata))
        for other, table in tables.items()
        for key, role in channels[other].metadata.items()
        if key.startswith(ROLE) and role == REFERENCE
    )
    if reference := next(beside, None):
        table, name = reference
        chosen = _with_reference(chosen, table[[*LABELS, name]].rename(columns={name: REFERENCE}))
    attached = {a.name: a.data for a in reader.iter_attachments()}
    config = attached.get("config.json", b"{}")
    places = planned(json.loads(config))
    for n, name in enumerate(PLACE_COLUMNS):
        at_mm = {index + 1: round(1e3 * place[n], 9) for index, place in places.items()}
        chosen[name] = chosen["station"].map(at_mm)
    return Table(chosen, bool(channels[topic].metadata.get("simulated")), _face_mm2(config))


def _own_table(reader: Any, summary: Any, channel: Any) -> pd.DataFrame:
    text = summary.schemas[channel.schema_id].data.decode()
    layout = _layout(text, channel.metadata)
    topics = [channel.topic]
    bodies = b"".join(m.data[4:][: layout.itemsize] for _, _, m in reader.iter_messages(topics))
    return pd.DataFrame(np.frombuffer(bodies, layout))


def _layout(text: str, metadata: dict[str, str]) -> np.dtype[np.void]:
    """Fields of the message behind its header."""
    kinds = {"float64": "<f8", "int32": "<i4", "uint8": "<u1", "bool": "<u1"}
    at, names, formats, offsets = 12 + len("scan") + 1, [], [], []
    for kind, name in _fields(text):
        if "=" in name or kind not in kinds:
            continue
        size = np.dtype(kinds[kind]).itemsize
        at += -at % size
        names.append(_column(name, metadata))
        formats.append(kinds[kind])
        offsets.append(at)
        at += size
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": at})


def _column(name: str, metadata: dict[str, str]) -> str:
    """A channel's column, with its unit."""
    unit = metadata.get(f"unit of {name}", "")
    return f"{name}_{unit.lower()}" if unit else name


def _fields(text: str) -> Iterator[tuple[str, str]]:
    """Type and name of each field of the first message of a ROS 2 definition."""
    for line in text.split("=" * 80)[0].splitlines():
        words = line.partition("#")[0].split()
        if len(words) == 2:
            yield words[0], words[1]
