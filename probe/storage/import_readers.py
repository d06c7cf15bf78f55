"""The formats that `palpate import` reads: each is one entry of `READERS`.

A reader gives named columns with their times and units, and what was lost. What ``palpate export``
wrote is known by its ``own`` reader, which needs no mapping.
"""

from collections.abc import Callable
from hashlib import file_digest
from pathlib import Path
from typing import NamedTuple

from drivers.core.errors import MissingExtra
from drivers.core.files import FileRefused, open_file
from probe.storage.import_arrays import read_hdf5, read_mat, read_numpy, read_parquet
from probe.storage.import_columns import Asked, Recording, mapped
from probe.storage.import_exported import own_hdf5, own_parquet, own_text
from probe.storage.import_mcap import own_mcap
from probe.storage.import_ros import read_bag, read_db3, read_mcap_messages
from probe.storage.import_table import CsvError, Table
from probe.storage.import_text import read_text
from probe.storage.import_xdf import read_xdf

HEAD_BYTES = 1024


class Reader(NamedTuple):
    """A format: its name, endings, how its files begin, and how they are read."""

    name: str
    endings: tuple[str, ...]
    magic: tuple[bytes, ...]
    read: Callable[[Path], Recording]
    own: Callable[[Path], Table | None] | None = None


READERS = (
    Reader("MATLAB", (".mat",), (b"MATLAB 5.0", b"MATLAB 7.3"), read_mat),
    Reader("numpy", (".npy", ".npz"), (b"\x93NUMPY",), read_numpy),
    Reader("HDF5", (".h5", ".hdf5", ".nc"), (b"\x89HDF",), read_hdf5, own_hdf5),
    Reader("Parquet", (".parquet",), (b"PAR1",), read_parquet, own_parquet),
    Reader("XDF of the Lab Streaming Layer", (".xdf",), (b"XDF:",), read_xdf),
    Reader("ROS 1", (".bag",), (b"#ROSBAG",), read_bag),
    Reader("ROS 2", (".db3",), (b"SQLite format 3\0",), read_db3),
    Reader("MCAP", (".mcap",), (b"\x89MCAP0",), read_mcap_messages, own_mcap),
    Reader("text", (".csv", ".txt", ".tsv", ".lvm", ".dat", ".tab", ".asc", ".gz"), (), read_text,
           own_text),
)  # fmt: skip
NOT_READ = (
    ("LabVIEW's TDMS", ".tdms", b"TDSm"),
    ("an Excel workbook", ".xlsx", b""),
    ("an Excel workbook", ".xls", b"\xd0\xcf\x11\xe0"),
    ("a Zwick testXpert file", ".zs2", b""),
    ("European Data Format", ".edf", b"0       "),
    ("a BIOPAC AcqKnowledge file", ".acq", b""),
    ("a compressed XDF file; unpack it first", ".xdfz", b""),
    ("a run of palpate, which needs no import", ".run", b""),
)


def read_recording(source: Path, asked: Asked) -> Table:
    """The samples of a recording of any format. Raises `CsvError`, `MissingExtra`."""
    reader = _reader(source)
    try:
        table = reader.own(source) if reader.own is not None and asked == Asked() else None
        if table is None:
            recording = reader.read(source)
            try:
                table = mapped(recording, asked)
            except CsvError as error:  # it may be for what of the file was lost
                raise CsvError("; ".join([str(error), *recording.notes])) from None
        if not table.sha256:
            with source.open("rb") as file:
                table = table._replace(sha256=file_digest(file, "sha256").hexdigest())
        return table
    except (CsvError, MissingExtra):
        raise
    except FileRefused as error:
        raise CsvError(str(error)) from None
    except Exception as error:  # noqa: BLE001 -- theirs, at a damaged file
        raise CsvError(f"not a whole file of {reader.name} ({error})") from None


def _reader(source: Path) -> Reader:
    """The format that the file's beginning shows, or else its ending."""
    try:
        with open_file(source) as file:
            head = file.read(HEAD_BYTES)
    except FileRefused as error:
        raise CsvError(str(error)) from None
    ending = source.suffix.lower()
    for name, its, magic in NOT_READ:
        if ending == its or (magic and head.startswith(magic)):
            raise CsvError(f"is {name}, which is not read; save it as text or CSV")
    begun = (r for r in READERS if any(head.startswith(magic) for magic in r.magic))
    reader = next(begun, None) or next((r for r in READERS if ending in r.endings), None)
    if reader is None:
        if head and b"\0" not in head:
            return READERS[-1]
        known = ", ".join(ending for r in READERS for ending in r.endings)
        raise CsvError(f"{ending or 'no ending'} is not known; read are {known}")
    return reader
