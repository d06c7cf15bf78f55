"""Recordings that are no plain CSV, as the table that ``palpate import`` reads.

What ``palpate export`` wrote (CSV, Parquet, netCDF, HDF5, MCAP), and MCAP files of others with
geometry_msgs WrenchStamped messages in CDR or JSON. The columns are those of
`probe.storage.csv_columns`, with every number to the bit.
"""

import json
import struct
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from drivers.core.extras import needs, require
from probe.core.places import planned
from probe.storage.csv_columns import SIGNALS, CsvError

with needs("data", "palpate import"):
    import pandas as pd

ENDINGS = (".parquet", ".nc", ".h5", ".mcap")
SAMPLE, WRENCH = "palpate_msgs/msg/", "WrenchStamped"
PLACE_COLUMNS = ("x_mm", "y_mm")
BAD_FILE = (OSError, ValueError, KeyError, struct.error)


def is_exported(header: str) -> bool:
    """Whether the first line of a CSV is that of samples that ``palpate export`` wrote."""
    return {"time_s", "station", "attempt", "phase"} <= set(header.strip().split(","))


def as_csv(source: Path, topic: str | None = None) -> bytes:
    """The file as CSV text. ``topic`` chooses among the wrenches of an MCAP file.

    Raises `CsvError` for what cannot be read, and `drivers.MissingExtra`.
    """
    try:
        match source.suffix:
            case ".mcap":
                table = _mcap(source, topic)
            case ".parquet":
                require("pyarrow", "export", "Parquet")
                table = pd.read_parquet(source)
            case ".nc" | ".h5":
                table = _groups(source)
            case _:
                # Numbers stay text: they are read once, by the import itself.
                kinds: defaultdict[str, type] = defaultdict(lambda: str, station=int, attempt=int)
                table = pd.read_csv(source, dtype=kinds)
    except BAD_FILE as error:
        raise CsvError(f"{source}: cannot be read ({error})") from None
    return _presses(table, source).to_csv(index=False).encode()


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
    kept = ["time_s", signals[0], *beside]
    return table[kept]


def _groups(source: Path) -> pd.DataFrame:
    """The group of the device that feels, of a netCDF or HDF5 export, with its stations' places."""
    require("h5py", "export", "HDF5 and netCDF")
    import h5py

    with h5py.File(source) as file:
        feels = file.attrs.get("tactile", "")  # the run's own choice, where there are two
        feels = feels if isinstance(feels, str) else ""
        for group in (*filter(None, [file.get(feels)] if feels else []), *file.values()):
            if not isinstance(group, h5py.Group) or "time_s" not in group:
                continue
            if signal := next((n for n in ("force", "pressure") if n in group), None):
                unit = group[signal].attrs["units"]
                unit = unit.decode() if isinstance(unit, bytes) else unit
                columns = {n: group[n][:] for n in ("time_s", "station", "attempt")}
                table = pd.DataFrame({**columns, f"{signal}_{unit}": group[signal][:]})
                return _placed(table, file.get("stations", file))
    raise CsvError(f"{source}: no group of samples as `palpate export` writes them")


def _placed(table: pd.DataFrame, stations: Any) -> pd.DataFrame:
    station, first = np.unique(stations["station"][:], return_index=True)
    for name in PLACE_COLUMNS:
        places = pd.Series(stations[name][:][first], station)
        table[name] = places.reindex(table["station"]).to_numpy()
    return table


def _mcap(source: Path, topic: str | None) -> pd.DataFrame:
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
    return pd.DataFrame(rows, columns=["time_s", "force_n"])


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


def _own_samples(reader: Any, summary: Any, topics: list[str], source: Path) -> pd.DataFrame:
    """Samples that `probe.storage.export_mcap` wrote: to the bit, with the plan's places."""
    tables = {topic: _own_table(reader, summary, topic) for topic in topics}
    for table in tables.values():
        if signal := next((n for n in SIGNALS if n in table), None):
            chosen = table[["time_s", "station", "attempt", signal]].copy()
            break
    else:
        raise CsvError(f"{source}: no device that measures force or pressure")
    attached = {a.name: a.data for a in reader.iter_attachments()}
    places = planned(json.loads(attached.get("config.json", b"{}")))
    for n, name in enumerate(PLACE_COLUMNS):
        at_mm = {index + 1: round(1e3 * place[n], 9) for index, place in places.items()}
        chosen[name] = chosen["station"].map(at_mm)
    return chosen


def _own_table(reader: Any, summary: Any, topic: str) -> pd.DataFrame:
    channel = next(c for c in summary.channels.values() if c.topic == topic)
    text = summary.schemas[channel.schema_id].data.decode()
    layout = _layout(text, channel.metadata)
    bodies = b"".join(m.data[4:][: layout.itemsize] for _, _, m in reader.iter_messages([topic]))
    return pd.DataFrame(np.frombuffer(bodies, layout))


def _layout(text: str, metadata: dict[str, str]) -> np.dtype[np.void]:
    """Fields of the message behind its header."""
    kinds = {"float64": "<f8", "int32": "<i4", "uint8": "<u1", "bool": "<u1"}
    at, names, formats, offsets = 12 + len("scan") + 1, [], [], []
    for kind, name in _fields(text):
        if "=" in name or kind not in kinds:
            continue
        unit = metadata.get(f"unit of {name}", "")
        size = np.dtype(kinds[kind]).itemsize
        at += -at % size
        names.append(f"{name}_{unit.lower()}" if unit else name)
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
