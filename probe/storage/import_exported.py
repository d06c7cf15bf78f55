"""What ``palpate export`` wrote, and CSVs with our names, as tables for ``palpate import``.

Every number comes to the bit, and what clipped is known to have clipped. The channels are those
that the run was judged on, taxels too, where the file says what its channels are; a CSV does not,
and needs a column of `SIGNALS`. An infinite reading is none. What is not ours is None.
"""

import csv
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers import Channel
from drivers.core.arrays import Array
from drivers.core.extras import needs, require
from probe.storage.csv_columns import first_line, numbers
from probe.storage.csv_table import read_csv
from probe.storage.import_device import (
    LABELS,
    Device,
    face_mm2_of,
    judged,
    phase_numbers,
    placed,
)
from probe.storage.import_table import PER_STATION, PHASE, REFERENCE, SIGNALS, CsvError, Table
from probe.storage.taxel_arrays import ENDINGS, cells

with needs("data", "palpate import"):
    import pandas as pd

SIMULATED = "-simulated"  # ends the name of a table of simulated samples
INFINITE = ["inf", "-inf"]
CLIPPED = {"true": 1.0, "1": 1.0, "false": 0.0, "0": 0.0, "": 0.0}


def own_text(source: Path) -> Table | None:
    """A CSV whose columns are named with their unit, or samples that we exported."""
    names = [name.strip() for name in next(csv.reader([first_line(source)]), [])]
    if {"time_s", "station", "attempt", "phase"} <= set(names):
        return _csv(source)
    return read_csv(source) if "time_s" in names else None


def _csv(source: Path) -> Table:
    # Numbers stay text: pandas' own are the last bit off.
    kinds: defaultdict[str, type] = defaultdict(lambda: str, station=int, attempt=int)
    text = pd.read_csv(source, dtype=kinds)
    _check_places(text)
    channels, column_of = _by_name(text, source)

    def read(name: str) -> Array:
        if name == PHASE:
            return phase_numbers(text["phase"])
        if name in ("station", "attempt"):
            return text[name].to_numpy(np.float64)
        column = text[column_of.get(name, name)].replace(INFINITE, np.nan).fillna("")
        return (
            _clipped(column) if name.endswith("_saturated") else numbers(column, str(column.name))
        )

    return judged({"": Device(channels, {*text, PHASE}, read)}, None)


def _check_places(table: pd.DataFrame) -> None:
    """Raises `CsvError` for a place or a depth in another unit: without it all would be judged as
    if it were not known."""
    for name in map(str, table):
        wanted = f"{name.rpartition('_')[0].lower()}_mm"
        if wanted in PER_STATION and name != wanted:
            raise CsvError(f"column {name!r}: unknown unit; {wanted!r} is read")


def _clipped(column: "pd.Series[str]") -> Array:
    found = np.asarray(column.str.strip().str.lower().map(CLIPPED), np.float64)
    if (wrong := np.flatnonzero(np.isnan(found))).size:
        raise CsvError(
            f"row {wrong[0] + 2}, column {column.name!r}: {str(column.iloc[wrong[0]])[:40]!r}; "
            "True or False is allowed"
        )
    return found


def _by_name(table: pd.DataFrame, source: Path) -> tuple[dict[str, Channel], dict[str, str]]:
    """The signal and the reference where nothing but the columns' names says what they are, and
    the column of each."""
    lower = {str(name).lower(): str(name) for name in reversed(list(table))}
    if (found := next((name for name in SIGNALS if name in lower), None)) is None:
        raise CsvError(
            f"no column of {', '.join(SIGNALS)}; it has {', '.join(map(str, table))[:200]}; name "
            "the one that is the signal so, with its unit, or import the run's HDF5, netCDF, "
            "Parquet or MCAP export, which say what their channels are"
        )
    simulated = source.name.partition(".")[0].endswith(SIMULATED)
    channel = SIGNALS[found]
    channels = {channel.name: replace(channel, simulated=simulated)}
    if REFERENCE in table:
        channels[REFERENCE] = Channel(REFERENCE, "", REFERENCE)
    return channels, {channel.name: lower[found]}


def own_parquet(source: Path) -> Table | None:
    """Samples that we exported, or that have our names."""
    require("pyarrow", "export", "Parquet")
    from pyarrow import parquet

    with source.open("rb") as file:  # pyarrow takes no name that is not UTF-8
        held = parquet.read_table(file)
    table, schema = held.to_pandas(), held.schema
    about = [(field.name, field.metadata or {}) for field in schema]
    if any(b"role" in said for _, said in about):
        column_of = {said[b"channel"].decode(): n for n, said in about if b"role" in said}
        channels = {
            said[b"channel"].decode(): Channel(
                said[b"channel"].decode(),
                said.get(b"units", b"").decode(),
                said[b"role"].decode(),
                simulated=said[b"simulated"] == b"1",
            )
            for _, said in about
            if b"role" in said
        }
    elif "time_s" in table:
        channels, column_of = _by_name(table, source)
    else:
        return None

    def read(name: str) -> Array:
        if name == PHASE:
            return phase_numbers(table["phase"])
        return np.asarray(table[column_of.get(name, name)], np.float64)

    phase = {PHASE} if "phase" in table else set()
    found = judged({source.stem: Device(channels, {*table, *phase}, read)}, None)
    return found._replace(face_mm2=face_mm2_of((schema.metadata or {}).get(b"palpate", b"")))


def own_hdf5(source: Path) -> Table | None:
    """The samples in a netCDF or HDF5 export, with their stations' places."""
    require("h5py", "export", "HDF5 and netCDF")
    import h5py

    with h5py.File(source) as file:
        devices = {
            name: _device(group)
            for name, group in file.items()
            if isinstance(group, h5py.Group) and LABELS[0] in group
        }
        if not devices:
            return None
        table = judged(devices, _text(file.attrs.get("tactile", "")) or None)
        stations = file.get("stations", file)
        numbers = stations["station"][:].tolist()  # of several attempts the last counts
        places = {
            name: dict(zip(numbers, stations[name][:].tolist(), strict=True))
            for name in PER_STATION
            if name in stations and name not in table.rows
        }
        config = file.attrs.get("config") or file["config"][()]
        return placed(table, places)._replace(face_mm2=face_mm2_of(_text(config)))


def _device(group: Any) -> Device:
    channels: dict[str, Channel] = {}
    cell_of: dict[str, tuple[str, int, int]] = {}
    for name, data in group.items():
        if "role" not in data.attrs:
            continue
        own = Channel(
            name,
            _text(data.attrs.get("units", "")),
            _text(data.attrs["role"]),
            simulated=bool(data.attrs.get("simulated", 0)),
        )
        if data.ndim == 1:
            channels[name] = own
            continue
        try:
            listed = cells(_text(data.attrs.get("channels", "")), data.shape)
        except ValueError as error:
            raise CsvError(f"{name}: {error}; export the run again") from None
        for taxel, place in listed.items():
            channels[taxel] = replace(own, name=taxel)
            for ending in ENDINGS:
                cell_of[taxel + ending] = (name + ending, *place)

    def read(name: str) -> Array:
        if name == PHASE:
            return phase_numbers(
                pd.Series([_text(phase) for phase in group["phase"][:]], dtype=str)
            )
        if name in cell_of:
            array, row, column = cell_of[name]
            return np.asarray(group[array][:, row, column], np.float64)
        return np.asarray(group[name][:], np.float64)

    return Device(channels, {*group, *cell_of, PHASE}, read)


def _text(value: object) -> str:
    """An attribute of HDF5; what is no text is none."""
    return value.decode() if isinstance(value, bytes) else value if isinstance(value, str) else ""
