"""Recordings of other programs: a format is one entry in `READERS`, and what is common stands once.

A reader gives named columns with their times, a mapping says which of them is what
(``{"force_n": "Fz [N]"}``; ``"-Fz [N]"`` turns the sign), and `read_foreign` makes the table.
"""

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from hashlib import file_digest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drivers.core.arrays import Array
from drivers.core.errors import MissingExtra
from drivers.core.extras import needs
from drivers.core.units import SI
from probe.storage.import_table import (
    PER_STATION,
    SIGNALS,
    CsvError,
    Table,
    check_size,
    saturated,
    signal,
)

with needs("data", "palpate import"):
    import pandas as pd

TARGETS = ("time_s", *SIGNALS, *PER_STATION, "station", "reference")
UNITS = {name: c.unit for name, c in SIGNALS.items()} | {
    "time_s": "s",
    **dict.fromkeys(PER_STATION, "mm"),
}
SHOWN = 30  # column names in an error


class Group(NamedTuple):
    """Columns (n,) by their names, with the times (n,) at which they were taken, if known."""

    columns: dict[str, Array]
    time_s: Array | None = None


class Recording(NamedTuple):
    """Groups of columns with times of their own, and what was lost, in sentences."""

    groups: list[Group]
    notes: tuple[str, ...] = ()


def read_foreign(
    source: Path, mapping: Mapping[str, str] | None = None, rate_hz: float | None = None
) -> Table:
    """The samples of a file of another program.

    ``mapping``: the file's column of each of `TARGETS`; those of the same name need none.
    ``rate_hz``: samples a second where the file has no times. Raises `CsvError`, `MissingExtra`.
    """
    suffix = source.suffix.lower()
    if suffix in NOT_READ:
        raise CsvError(f"is {NOT_READ[suffix]}, which is not read; save it as text or CSV")
    if suffix not in READERS:
        raise CsvError(
            f"{suffix or 'no ending'} is not known; read are {', '.join(sorted(READERS))}"
        )
    try:
        recording = READERS[suffix][1](source)
        with source.open("rb") as file:
            digest = file_digest(file, "sha256").hexdigest()
    except (CsvError, MissingExtra):
        raise
    except Exception as error:  # noqa: BLE001 -- theirs, at a damaged file
        raise CsvError(f"not a whole file of {READERS[suffix][0]} ({error})") from None
    notes = list(recording.notes)
    rows = _mapped(recording.groups, dict(mapping or {}), rate_hz)
    given = [name for name in SIGNALS if name in rows]
    if len(given) != 1:
        raise CsvError(_unmapped(recording.groups))
    for name in rows:
        check_size(rows[name].to_numpy(), str(name), UNITS.get(str(name), ""))
    names = tuple(map(str, rows))
    rows = timed(rows, notes)
    rows = rows.rename(columns={given[0]: signal(0)}).assign(**{saturated(0): 0.0})
    return Table(rows, (SIGNALS[given[0]],), names, sha256=digest, notes=tuple(notes))


def timed(rows: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    """Those that have a time."""
    known = np.isfinite(rows["time_s"].to_numpy(np.float64))
    if not known.all():
        notes.append(f"{int((~known).sum())} rows without a time are left out")
    kept: pd.DataFrame = rows[known]
    return kept


def _mapped(groups: list[Group], mapping: dict[str, str], rate_hz: float | None) -> pd.DataFrame:
    """The columns that a mapping names, of the group that has the signal."""
    if unknown := [name for name in mapping if name not in TARGETS]:
        raise CsvError(f"--map {unknown[0]}: not known; allowed are {', '.join(TARGETS)}")
    for group in groups:
        wanted = {t: mapping.get(t, t) for t in TARGETS}
        columns = {t: c for t, n in wanted.items() if (c := _column(group, n)) is not None}
        if not columns.keys() & SIGNALS.keys():
            continue
        if missing := [f"{t}={n}" for t, n in mapping.items() if t not in columns]:
            raise CsvError(f"--map {missing[0]}: no such column; {_unmapped([group])}")
        if "time_s" not in columns:
            time_s = group.time_s
            if rate_hz is not None:
                time_s = np.arange(len(next(iter(columns.values())))) / rate_hz
            if time_s is None:
                raise CsvError("has no times: say --rate-hz, or --map time_s=COLUMN")
            columns = {"time_s": time_s, **columns}
        if len({len(column) for column in columns.values()}) > 1:
            lengths = ", ".join(f"{name}: {len(column)}" for name, column in columns.items())
            raise CsvError(f"columns of different length ({lengths})")
        return pd.DataFrame(columns, dtype=np.float64)
    raise CsvError(_unmapped(groups))


def _column(group: Group, name: str) -> Array | None:
    if name in group.columns:
        return group.columns[name]
    if name.startswith("-") and name[1:] in group.columns:
        return -group.columns[name[1:]]
    return None


def _unmapped(groups: list[Group]) -> str:
    names = [name for group in groups for name in group.columns]
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return (
        f"say which column is the signal, as --map force_n=COLUMN (one of {', '.join(SIGNALS)}); "
        f"it has {', '.join(map(repr, names[:SHOWN])) or 'no columns of numbers'}{more}"
    )


def _flat(name: str, value: Any) -> Iterator[tuple[str, Array]]:
    """Arrays of numbers in nested dictionaries, each column of a table on its own."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if not str(key).startswith("__"):
                yield from _flat(f"{name}.{key}" if name else str(key), inner)
        return
    array = np.squeeze(np.asarray(value))
    if array.dtype.names:
        for field in array.dtype.names:
            yield from _flat(f"{name}.{field}" if name else field, array[field])
    elif array.dtype.kind in "iufb" and array.ndim == 1:
        yield name, array.astype(np.float64)
    elif array.dtype.kind in "iufb" and array.ndim > 1:  # of taxels: time, row, column
        for at in np.ndindex(array.shape[1:]):
            yield f"{name}[{','.join(map(str, at))}]", array[(slice(None), *at)].astype(np.float64)


def _mat(source: Path) -> Recording:
    from scipy.io import loadmat

    return Recording([Group(dict(_flat("", loadmat(source, simplify_cells=True))))])


def _npy(source: Path) -> Recording:
    held = np.load(source, allow_pickle=False)
    return Recording([Group(dict(_flat("", dict(held) if source.suffix == ".npz" else held)))])


def _hdf5(source: Path) -> Recording:
    with needs("export", "HDF5"):
        import h5py
    columns: dict[str, Array] = {}

    def take(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.ndim:
            columns.update(_flat(name, item[:]))

    with h5py.File(source) as file:
        file.visititems(take)
    return Recording([Group(columns)])


def _xdf(source: Path) -> Recording:
    with needs("import", "XDF"):
        import pyxdf

    streams, _ = pyxdf.load_xdf(source)
    groups, notes = [], []
    for stream in streams:
        info, values = stream["info"], stream["time_series"]
        name = info["name"][0]
        if not isinstance(values, np.ndarray) or not len(values):
            notes.append(f"stream {name!r} has no numbers and is left out")
            continue
        if stream.get("footer") is None:
            notes.append(f"stream {name!r} was not finished; what is whole is read")
        labels = ((info.get("desc") or [None])[0] or {}).get("channels", [{}])[0] or {}
        given = [c["label"][0] for c in labels.get("channel", []) if c.get("label")]
        if len(given) != values.shape[1]:
            given = [str(n) for n in range(values.shape[1])]
        columns = {f"{name}/{n}": values[:, k].astype(float) for k, n in enumerate(given)}
        groups.append(Group(columns, stream["time_stamps"]))
    return Recording(groups, tuple(notes))


def _ros(source: Path) -> Recording:
    with needs("import", "ROS bags"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

    groups = []
    store = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader(
        [source if source.suffix == ".bag" else source.parent], default_typestore=store
    ) as bag:
        for connection in bag.connections:
            times, rows = [], []
            for _, logged_ns, raw in bag.messages([connection]):
                message = bag.deserialize(raw, connection.msgtype)
                stamp = getattr(getattr(message, "header", None), "stamp", None)
                stamp_s = stamp.sec + 1e-9 * stamp.nanosec if stamp is not None else 0.0
                times.append(stamp_s or 1e-9 * logged_ns)
                rows.append(dict(_numbers(connection.topic, message)))
            table = pd.DataFrame(rows, dtype=np.float64)
            groups.append(Group({str(n): table[n].to_numpy() for n in table}, np.array(times)))
    return Recording(groups)


def _numbers(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """The numbers of a message by their place in it; its header is none of them."""
    if is_dataclass(value):
        for field in fields(value):
            if field.name != "header":
                yield from _numbers(f"{name}.{field.name}", getattr(value, field.name))
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
        yield from ((f"{name}[{n}]", float(v)) for n, v in enumerate(value.ravel()))
    elif isinstance(value, int | float):
        yield name, float(value)


def _text(source: Path) -> Recording:
    """A header, then a table: names, perhaps units, numbers; a comma may be the decimal mark."""
    lines = source.read_bytes().decode("utf-8-sig", "replace").splitlines()
    for mark in ("\t", ";", ",", None):
        cells = [_cells(line, mark) for line in lines]
        comma = mark != ","
        width = [len(c) if c and _number(c[0], comma) is not None else 0 for c in cells]
        first = next((n for n in range(len(width) - 1) if width[n] > 0 and width[n + 1] == width[n]
                      and (mark is None or width[n] > 1)), None)  # fmt: skip
        if first is not None:
            break
    else:
        raise CsvError("no table of numbers is in it")
    count = width[first]
    whole = [cells[n] for n in (first - 1, first - 2) if n >= 0 and len(cells[n]) >= count]
    units = len(whole) == 2 and all(_is_unit(cell) for cell in whole[0][:count] if cell)
    above = whole[1] if units else whole[0] if whole else []
    names = [n or str(k) for k, n in enumerate(above[:count])] or [str(k) for k in range(count)]
    values = [
        [_number(c, comma) for c in row[:count]] for row in cells[first:] if len(row) >= count
    ]
    notes = []
    broken = sum(0 < len(row) < count for row in cells[first:])
    words = sum(v is None for row in values for v in row)
    if broken:
        notes.append(f"{broken} lines are not whole and are left out")
    if words:
        notes.append(f"{words} cells are no numbers, and count as nothing")
    table = np.array([[np.nan if v is None else v for v in row] for row in values])
    return Recording([Group({n: table[:, k] for k, n in enumerate(names)})], tuple(notes))


def _cells(line: str, mark: str | None) -> list[str]:
    if not line.strip():
        return []
    found = line.split() if mark is None else next(csv.reader([line], delimiter=mark), [])
    return [cell.strip() for cell in found]


def _is_unit(cell: str) -> bool:
    return cell.strip("[]()") in {"s", "ms", "m", "cm", "um", "%", "V", "-", "1", *SI}


def _number(cell: str, comma: bool) -> float | None:
    try:
        return float(cell.replace(",", ".") if comma else cell)
    except ValueError:
        return None


READERS: dict[str, tuple[str, Callable[[Path], Recording]]] = {
    ".mat": ("MATLAB", _mat),
    ".npy": ("numpy", _npy),
    ".npz": ("numpy", _npy),
    ".h5": ("HDF5", _hdf5),
    ".hdf5": ("HDF5", _hdf5),
    ".xdf": ("Lab Streaming Layer", _xdf),
    ".bag": ("ROS 1", _ros),
    ".db3": ("ROS 2", _ros),
    ".lvm": ("LabVIEW", _text),
    ".txt": ("instruments", _text),
    ".tsv": ("text", _text),
    ".csv": ("text", _text),
}
NOT_READ = {
    ".tdms": "LabVIEW's TDMS",
    ".xlsx": "an Excel workbook",
    ".xls": "an Excel workbook",
    ".zs2": "a Zwick testXpert file",
    ".edf": "European Data Format",
    ".acq": "a BIOPAC AcqKnowledge file",
}
