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
    device_of,
    face_mm2_of,
    judged,
    phase_numbers,
    placed,
)
from probe.storage.import_table import PER_STATION, PHASE, REFERENCE, SIGNALS, CsvError, Table
from probe.storage.taxel_arrays import DIMENSIONS, scattered

with needs("data", "palpate import"):
    import pandas as pd
    import xarray as xr

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

    def read(name: str) -> Array:
        if name in ("station", "attempt", "phase"):
            return text[name].to_numpy()
        column = text[name].replace(INFINITE, np.nan).fillna("")
        return _clipped(column) if name.endswith("_saturated") else numbers(column, name)

    return judged({"": device_of(_by_name(text, source), list(map(str, text)), read)}, None)


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


def _by_name(table: pd.DataFrame, source: Path) -> dict[str, Channel]:
    """The signal and the reference by their columns, where nothing but the columns' names says what
    they are."""
    lower = {str(name).lower(): str(name) for name in reversed(list(table))}
    if (found := next((name for name in SIGNALS if name in lower), None)) is None:
        raise CsvError(
            f"no column of {', '.join(SIGNALS)}; it has {', '.join(map(str, table))[:200]}; name "
            "the one that is the signal so, with its unit, or import the run's HDF5, netCDF, "
            "Parquet or MCAP export, which say what their channels are"
        )
    simulated = source.name.partition(".")[0].endswith(SIMULATED)
    channels = {lower[found]: replace(SIGNALS[found], simulated=simulated)}
    if REFERENCE in table:
        channels[REFERENCE] = Channel(REFERENCE, "", REFERENCE)
    return channels


def own_parquet(source: Path) -> Table | None:
    """Samples that we exported, or that have our names."""
    require("pyarrow", "export", "Parquet")
    from pyarrow import parquet

    with source.open("rb") as file:  # pyarrow takes no name that is not UTF-8
        held = parquet.read_table(file)
    table, schema = held.to_pandas(), held.schema
    about = {field.name: field.metadata for field in schema if b"role" in (field.metadata or {})}
    if not about and "time_s" not in table:
        return None
    channels = {
        column: Channel(
            said[b"channel"].decode(),
            said.get(b"units", b"").decode(),
            said[b"role"].decode(),
            simulated=said[b"simulated"] == b"1",
        )
        for column, said in about.items()
    }
    device = device_of(
        channels or _by_name(table, source), list(table), lambda name: table[name].to_numpy()
    )
    face_mm2 = face_mm2_of((schema.metadata or {}).get(b"palpate", b""))
    return judged({source.stem: device}, None)._replace(face_mm2=face_mm2)


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


def _device(group: Any) -> xr.Dataset:
    """Channels and what is known of their samples, each taxel on its own."""
    variables = {
        name: (DIMENSIONS[: item.ndim], item[:], {key: _said(item, key) for key in item.attrs})
        for name, item in group.items()
        if "role" in item.attrs or name.endswith("_saturated") or name in (*LABELS, *PER_STATION)
    }
    phases = np.array([_text(phase) for phase in group["phase"][:]], str)
    data = xr.Dataset(variables).assign({PHASE: ("time_s", phase_numbers(phases))})
    try:
        return scattered(data)
    except ValueError as error:
        raise CsvError(f"{error}; export the run again") from None


def _said(item: Any, key: str) -> object:
    value = item.attrs[key]
    return value.decode() if isinstance(value, bytes) else value


def _text(value: object) -> str:
    """An attribute of HDF5; what is no text is none."""
    return value.decode() if isinstance(value, bytes) else value if isinstance(value, str) else ""
