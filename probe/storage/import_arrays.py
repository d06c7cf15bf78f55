"""Named arrays of MATLAB, numpy, HDF5 and Parquet files as columns, time along the longest axis."""

import math
import struct
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from drivers.core.extras import needs
from probe.storage.import_columns import Column, Recording

MAT_HEADER, MAT_COMPRESSED = 128, 15  # of MATLAB's format 5: bytes, and the type of an element


def read_mat(source: Path) -> Recording:
    """MATLAB up to version 7, of a file that is cut off its whole variables; 7.3 is HDF5."""
    from scipy.io import loadmat

    content = source.read_bytes()
    if content.startswith(b"MATLAB 7.3"):
        return read_hdf5(source)
    end, order = MAT_HEADER, "<" if content[126:128] == b"IM" else ">"
    while (at := end + 8) <= len(content):
        kind, size = struct.unpack(f"{order}II", content[end:at])
        if (at := at + size + (-size % 8 if kind != MAT_COMPRESSED else 0)) > len(content):
            break
        end = at
    lost = len(content) - end
    notes = (f"the file ends within a variable: {lost} bytes are lost",) if lost else ()
    whole: Any = BytesIO(content[:end] if content.startswith(b"MATLAB 5.0") else content)
    held = loadmat(whole, simplify_cells=True)
    return Recording(dict(_columns("", held)), notes)


def read_numpy(source: Path) -> Recording:
    """An array, a table with named fields, or an archive of them; of an array that is cut off the
    whole rows."""
    notes: tuple[str, ...] = ()
    with source.open("rb") as file:
        try:
            held = np.load(file, allow_pickle=False)
            if not isinstance(held, np.ndarray):
                return Recording(dict(_columns("", dict(held))))
        except ValueError:
            file.seek(0)
            if np.lib.format.read_magic(file) != (1, 0):
                raise
            shape, by_column, kind = np.lib.format.read_array_header_1_0(file)
            row = kind.itemsize * math.prod(shape[1:])
            content = file.read()
            if by_column or kind.hasobject or not row:
                raise
            rows = len(content) // row
            held = np.frombuffer(content[: rows * row], kind).reshape(rows, *shape[1:])
            notes = (f"the file is cut off: {shape[0] - rows} of {shape[0]} rows are lost",)
    return Recording(dict(_columns("" if held.dtype.names else source.stem, held)), notes)


def read_hdf5(source: Path) -> Recording:
    """Every array of numbers by its path; one that is damaged is left out."""
    with needs("export", "HDF5"):
        import h5py
    columns: dict[str, Column] = {}
    notes: list[str] = []

    def take(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or not item.ndim or name.startswith("#refs#"):
            return
        try:
            own = dict(_columns(name, item[:]))
        except (OSError, ValueError) as error:
            notes.append(f"{name} is damaged and is left out ({error})")
            return
        said = item.attrs.get("units", item.attrs.get("unit", ""))
        unit = said.decode("utf-8", "replace") if isinstance(said, bytes) else str(said)
        columns.update({n: column._replace(unit=unit) for n, column in own.items()})

    with h5py.File(source) as file:
        file.visititems(take)
    return Recording(columns, tuple(notes))


def read_parquet(source: Path) -> Recording:
    """Every column of numbers."""
    with needs("export", "Parquet"):
        from pyarrow import parquet
    with source.open("rb") as file:
        table = parquet.read_table(file).to_pandas()
    return Recording(dict(_columns("", {str(name): table[name].to_numpy() for name in table})))


def _columns(name: str, value: Any) -> Iterator[tuple[str, Column]]:
    """Arrays of numbers in nested dictionaries, each field of a table on its own."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if not str(key).startswith("__"):
                yield from _columns(f"{name}.{key}" if name else str(key), inner)
        return
    array = np.squeeze(np.asarray(value))
    if array.dtype.names:
        for field in array.dtype.names:
            yield from _columns(f"{name}.{field}" if name else field, array[field])
    elif array.dtype.kind in "iufb" and array.ndim:
        along = int(np.argmax(array.shape))
        yield name, Column(np.moveaxis(array, along, 0).astype(np.float64))
