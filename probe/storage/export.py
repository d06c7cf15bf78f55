"""``palpate export RUN --to csv,hdf5,…``: a run for other programs, with units.

CSV and Parquet: one file per device (``-simulated`` if it is), one of stations, the configuration
as JSON. HDF5 and netCDF: one file with a group per device; units are attributes, as the CF
conventions have them. An array of taxels is one variable over time, row and column there, and a
column for each taxel in CSV and Parquet. MCAP, MATLAB and lerobot: see `probe.storage.export_mcap`,
`export_mat` and `export_lerobot`.
"""

import errno
import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from os import PathLike
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from drivers.core.extras import needs, require
from probe.core.contact_stress import tactile_or_none
from probe.storage.distinct_names import distinct
from probe.storage.import_table import PLACES
from probe.storage.run import Judged, Run, open_run

with needs("data", "an export"):
    import pandas as pd
    import xarray as xr

if TYPE_CHECKING:
    import h5py

CONVENTIONS = "CF-1.11"
OURS = ("stations", "config")
SAID = ("units", "role", "simulated")
UNITS = ("mm", "m", "s", "N", "Nm", "Pa", "mbar")


def export(
    run_path: str | PathLike[str],
    formats: str | Sequence[str],
    out_dir: str | Path,
    finding: Judged | None = None,
) -> tuple[Path, ...]:
    """Write a run in other formats.

    Parameters
    ----------
    run_path
        The run file.
    formats
        csv, hdf5, netcdf, parquet, mcap, mat, lerobot: a list, or text as in the shell,
        ``"csv,mcap"``.
    out_dir
        Where to. Files of an earlier export are replaced once all new ones are whole.
    finding
        What `detect` gave: the table of stations then has level and pulse of each, with their
        intervals and notes.

    Returns
    -------
    tuple[Path, ...]
        The files written.

    Raises
    ------
    ValueError
        Another format, or none.
    RunFileError
        The run cannot be read.
    OSError
        ``out_dir`` takes no files.

    Examples
    --------
    >>> import palpate
    >>> files = palpate.export("TIHA.run", ["csv"], "tables")
    >>> sorted(file.name for file in files)[0]
    'TIHA-config.json'
    """
    if isinstance(formats, str) or not isinstance(formats, Iterable):
        formats = [name.strip() for name in str(formats).split(",")]
    if not (formats := list(dict.fromkeys(formats))):
        raise ValueError(f"formats is empty: name one or several of {', '.join(WRITERS)}")
    if unknown := [str(name) for name in formats if name not in WRITERS]:
        raise ValueError(f"format {', '.join(unknown)!r}: known are {', '.join(WRITERS)}")
    run, out_dir = open_run(run_path), Path(out_dir)
    run.finding = finding
    out_dir.mkdir(parents=True, exist_ok=True)
    try:
        with TemporaryDirectory(dir=out_dir, prefix=".export-") as drafts:  # half a file is none
            made = [path for name in formats for path in WRITERS[name](run, Path(drafts))]
            return tuple(_moved(path, out_dir) for path in made)
    except (OSError, RuntimeError) as error:  # HDF5 tells a full disk in words of its own
        full = "No space left" in str(error)
        number = errno.ENOSPC if full else getattr(error, "errno", None)
        if number is None:
            raise
        raise OSError(number, os.strerror(number), str(out_dir)) from None


def _moved(made: Path, out_dir: Path) -> Path:
    """Where it now is, in place of what an earlier export left."""
    path = out_dir / made.name
    if made.is_dir() and path.is_dir():
        rmtree(path)
    return made.replace(path)


def _csv(run: Run, out_dir: Path) -> list[Path]:
    stem = out_dir / run.path.stem
    written = [Path(f"{stem}-stations.csv"), Path(f"{stem}-config.json")]
    stations = run.stations()
    stations.to_csv(written[0], index=False)
    written[1].write_text(_about(run) + "\n", encoding="utf-8")
    for device, part in _file_parts(run).items():
        written.append(Path(f"{stem}-{part}.csv"))
        frame, _ = _frame(run, device, stations)
        frame.to_csv(written[-1], index=False)
    return written


def _parquet(run: Run, out_dir: Path) -> list[Path]:
    """Tables with what each column is in their schema's metadata, which Arrow readers show."""
    require("pyarrow", "export", "Parquet")
    import pyarrow
    from pyarrow import parquet

    stem = out_dir / run.path.stem
    written = [Path(f"{stem}-stations.parquet")]
    stations = run.stations()
    tables = [(stations, {str(n): {"units": unit} for n in stations if (unit := unit_of(str(n)))})]
    for device, part in _file_parts(run).items():
        written.append(Path(f"{stem}-{part}.parquet"))
        tables.append(_frame(run, device, stations))
    for path, (frame, said) in zip(written, tables, strict=True):
        table = pyarrow.Table.from_pandas(frame, preserve_index=False)
        fields = [f.with_metadata(said.get(f.name)) for f in table.schema]
        about = {**(table.schema.metadata or {}), b"palpate": _about(run).encode()}
        with path.open("wb") as file:  # pyarrow takes no name that is not UTF-8
            parquet.write_table(table.cast(pyarrow.schema(fields, about)), file)
    return written


def _by(module: str, ending: str) -> Callable[[Run, Path], list[Path]]:
    """A format that has a module of its own, imported when it is asked for: one path."""

    def write(run: Run, out_dir: Path) -> list[Path]:
        path = out_dir / f"{run.path.stem}{ending}"
        import_module(f"probe.storage.{module}").write(run, path, _about(run))
        return [path]

    return write


def _hdf5(run: Run, out_dir: Path) -> list[Path]:
    require("h5py", "export", "HDF5")
    import h5py

    path = out_dir / f"{run.path.stem}.h5"
    with h5py.File(path, "w", track_order=True) as file:
        file["config"] = _about(run)  # a dataset: attributes hold only 64 KiB
        groups = _groups(run)
        file.attrs.update(_attributes(run, groups))
        _columns(file.create_group("stations"), run.stations())
        for device, name in groups.items():
            data = run.samples(device)
            group = file.create_group(name, track_order=True)
            for column, variable in data.variables.items():
                group[str(column)] = _storable(variable.values)
                group[str(column)].attrs.update(variable.attrs)
    return [path]


def _netcdf(run: Run, out_dir: Path) -> list[Path]:
    require("h5netcdf", "export", "netCDF")
    path = out_dir / f"{run.path.stem}.nc"
    table = run.stations()
    stations = xr.Dataset({name: ("press", table[name].to_numpy()) for name in table})
    groups = _groups(run)
    own = {"title": f"palpate run {run.path.stem}", "config": _about(run)}
    stations.attrs = {**_attributes(run, groups), **own}
    for name in stations:
        if unit := unit_of(str(name)):
            stations[name].attrs["units"] = unit
    stations.to_netcdf(path, mode="w", engine="h5netcdf")
    for device, name in groups.items():
        run.samples(device).to_netcdf(path, mode="a", group=name, engine="h5netcdf")
    return [path]


WRITERS: dict[str, Callable[[Run, Path], list[Path]]] = {
    "csv": _csv,
    "hdf5": _hdf5,
    "netcdf": _netcdf,
    "parquet": _parquet,
    "mcap": _by("export_mcap", ".mcap"),
    "mat": _by("export_mat", ".mat"),
    "lerobot": _by("export_lerobot", "-lerobot"),
}


def _file_parts(run: Run) -> dict[str, str]:
    """What stands for each device in the names of its files: ``-simulated`` if it is."""
    marks = {d: "-simulated" for d in run.channels if any(c.simulated for c in run.channels[d])}
    names = {device: _plain(device) + marks.get(device, "") for device in run.channels}
    return distinct(names, OURS)


def _groups(run: Run) -> dict[str, str]:
    """What each device's group is called."""
    return distinct({device: _plain(device) for device in run.channels}, OURS)


def _attributes(run: Run, groups: Mapping[str, str]) -> dict[str, str]:
    """What HDF5 and netCDF say of the whole file."""
    return {
        "Conventions": CONVENTIONS,
        "started_utc": run.started.started_utc,
        "simulated": ", ".join(run.simulated),
        "tactile": groups.get(tactile_or_none(run.channels) or "", ""),
    }


def unit_of(column: str) -> str:
    """The unit in a column's name, or nothing."""
    unit = column.rpartition("_")[2]
    return unit if unit in UNITS else ""


def _frame(
    run: Run, device: str, stations: pd.DataFrame
) -> tuple[pd.DataFrame, dict[str, dict[str, str]]]:
    """Samples as a table, each column's name ending in its unit; by column what is said of it: its
    units, and of a channel its name, its role and whether it is simulated.

    The last are where the station is, NaN between stations.
    """
    data = run.channel_samples(device)
    variables = [(str(name), variable) for name, variable in data.variables.items()]
    names = distinct(
        {
            name: f"{name}_{variable.attrs['units']}".removesuffix("_")
            if "role" in variable.attrs
            else name
            for name, variable in variables
        },
        PLACES,
    )
    columns = {names[name]: variable.values for name, variable in variables}
    said = {
        names[name]: {
            key: str(variable.attrs[key]) for key in SAID if variable.attrs.get(key, "") != ""
        }
        | ({"channel": name} if "role" in variable.attrs else {})
        for name, variable in variables
    }
    last = stations.drop_duplicates("station", keep="last").set_index("station")
    for name in PLACES:
        columns[name] = last[name].reindex(data["station"].to_numpy()).to_numpy()
        said[name] = {"units": "mm"}
    return pd.DataFrame(columns), said


def _columns(group: "h5py.Group", table: pd.DataFrame) -> None:
    for name in table:
        group[name] = _storable(table[name].to_numpy())
        if unit := unit_of(str(name)):
            group[name].attrs["units"] = unit


def _storable(values: "np.ndarray[tuple[int, ...], np.dtype[np.generic]]") -> object:
    """HDF5 knows no fixed-width Unicode, and of no text at all not that it is text."""
    from h5py import string_dtype

    return values.astype(string_dtype()) if values.dtype.kind in "UO" else values


def _about(run: Run) -> str:
    about = {
        "started_utc": run.started.started_utc,
        "finish": run.finish,
        "simulated": run.simulated,
        **run.config,
    }
    return json.dumps(about, indent=1, default=str)


def _plain(device: str) -> str:
    """A device's name as part of a file name or group."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in device).strip(".") or "device"
