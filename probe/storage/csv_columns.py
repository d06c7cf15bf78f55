"""The columns of a CSV file (or .csv.gz) from elsewhere, as numbers, in bounded memory."""

import csv
import gzip
import io
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np

from drivers.core.arrays import Array
from drivers.core.extras import needs
from drivers.core.files import FileRefused, open_file
from probe.storage.import_table import ARRAYS, UNITS, CsvError, check_size

with needs("data", "palpate import"):
    import pandas as pd

COLUMNS = tuple(name for name in UNITS if name not in ARRAYS)
NOTHING = ("", "nan", "na", "n/a", "null", "none", "-")
MAX_BYTES = 256 * 1024**2
MAX_LINE_BYTES = 4096
MAX_COLUMNS = 200
MAX_EMPTY_ROWS = 100_000
# zlib packs nothing more than 1032 times; readings with their noise, not more than ten times.
MAX_RATIO, RATIO_FROM_BYTES = 100, 4 * 1024**2
ROWS = 10_000  # parsed at a time: 40 MB of the longest lines


@contextmanager
def text_of(source: Path, max_line_bytes: int = MAX_LINE_BYTES) -> "Iterator[Bounded]":
    """The text in a file (or .gz). What is wrong with it within raises `CsvError`."""
    try:
        with open_file(source) as packed:
            plain = gzip.GzipFile(fileobj=packed) if source.suffix == ".gz" else packed
            yield Bounded(cast(BinaryIO, plain), packed, max_line_bytes)
    except FileRefused as error:
        raise CsvError(str(error)) from None
    except UnicodeDecodeError:
        raise CsvError("not UTF-8 text") from None
    except (OSError, EOFError, zlib.error, csv.Error) as error:
        raise CsvError(f"cannot be read ({error})") from None


def first_line(source: Path) -> str:
    """The beginning of the first line; empty where that is no text. Raises `CsvError`."""
    with text_of(source, MAX_BYTES) as text:
        begin = text.read(MAX_LINE_BYTES) or b""
    return begin.partition(b"\n")[0].decode("utf-8-sig", "replace")


def read_columns(source: Path) -> tuple[pd.DataFrame, list[str], str]:
    """The known columns as float64 (NaN: nothing there), the others' names, the text's SHA-256.

    Raises `CsvError` naming column and row (1 is the header's).
    """
    with text_of(source) as text:
        return *_parsed(io.BufferedReader(text, 2**16)), text.digest.hexdigest()


class Bounded(io.RawIOBase):
    """A text that is refused where it becomes too long, too wide or unpacks beyond reason."""

    def __init__(self, plain: BinaryIO, packed: BinaryIO, max_line_bytes: int) -> None:
        self.digest = sha256()
        self._max_line_bytes = max_line_bytes
        self._plain, self._packed = plain, packed
        self._bytes = self._line = 0

    def readable(self) -> bool:
        """True."""
        return True

    def readinto(self, buffer: "bytearray | memoryview[int]", /) -> int:  # type: ignore[override]
        """The next bytes. Raises `CsvError`."""
        part = self._plain.read(len(buffer))
        self.digest.update(part)
        self._bytes += len(part)
        if self._bytes > MAX_BYTES:
            raise CsvError(f"larger than {MAX_BYTES / 1024**2:g} MiB; split it")
        if self._bytes > max(RATIO_FROM_BYTES, MAX_RATIO * self._packed.tell()):
            raise CsvError(f"unpacks to more than {MAX_RATIO} times its size; no recording does")
        first, *lines = part.split(b"\n")
        longest = max(self._line + len(first), *map(len, lines), 0)
        self._line = len(lines[-1]) if lines else self._line + len(first)
        if longest > self._max_line_bytes:
            raise CsvError(f"a line of more than {self._max_line_bytes} bytes; not such a table")
        buffer[: len(part)] = part
        return len(part)


def _parsed(text: io.BufferedReader) -> tuple[pd.DataFrame, list[str]]:
    """Those of `COLUMNS` that are there, and the names of the others."""
    head = text.peek(MAX_LINE_BYTES).partition(b"\n")[0].decode("utf-8-sig")
    names = [name.strip() for name in next(csv.reader([head.rstrip("\r")]), [])]
    _check_names(names)
    known = {n: name for n, name in enumerate(names) if name in COLUMNS}
    parts: list[Array] = []
    row, empty = 1, 0
    try:
        for chunk in pd.read_csv(
            text,
            header=None,  # pandas would rename doubled columns and guess where one is missing
            dtype=str,
            keep_default_na=False,
            na_filter=False,
            encoding="utf-8-sig",
            skip_blank_lines=False,
            chunksize=ROWS,
        ):
            lines = chunk.iloc[1:] if row == 1 else chunk
            lines = lines.fillna("")
            first = max(row, 2)
            part = np.column_stack([numbers(lines[n], name, first) for n, name in known.items()])
            row += len(chunk)
            filled = np.flatnonzero(np.isfinite(part).any(axis=1))
            empty = len(part) - 1 - int(filled[-1]) if len(filled) else empty + len(part)
            if empty > MAX_EMPTY_ROWS:
                raise CsvError(f"row {row - empty}: more than {MAX_EMPTY_ROWS} rows are empty")
            parts.append(part)
    except (UnicodeDecodeError, CsvError):
        raise
    except (ValueError, OverflowError) as error:  # pandas' own errors are ValueErrors
        raise CsvError(
            f"not a table of comma-separated values ({str(error).strip()}); write '.' in numbers"
        ) from None
    table = np.concatenate(parts)
    table = table[: len(table) - empty]
    if not len(table):
        raise CsvError("no rows below the column names")
    left_out = [name for name in names if name not in COLUMNS]
    return pd.DataFrame(table, columns=list(known.values())), left_out


def _check_names(names: list[str]) -> None:
    allowed = ", ".join(COLUMNS)
    stems = {name.rpartition("_")[0] for name in COLUMNS} - {""}
    if not any(names):
        raise CsvError("not a table: no column names in the first row")
    if len(names) > MAX_COLUMNS:
        raise CsvError(f"{len(names)} columns; at most {MAX_COLUMNS} are allowed")
    for name in names:
        if names.count(name) > 1:
            raise CsvError(f"column {name!r} is there twice")
        if name not in COLUMNS and name.rpartition("_")[0] in stems:
            raise CsvError(f"column {name!r}: unknown unit; allowed columns: {allowed}")


def numbers(column: "pd.Series[str]", name: str, first_row: int = 2) -> Array:
    """A column as numbers. Raises `CsvError` naming the row (1 is the header's)."""
    stripped = column.str.strip()
    found: Array = pd.to_numeric(stripped, errors="coerce").to_numpy(np.float64, copy=True)
    # pandas 2 is the last bit off: "0.3" would not be 0.3
    known = np.isfinite(found)
    found[known] = stripped.to_numpy(dtype=np.str_)[known].astype(np.float64)
    wrong = ~np.isfinite(found) & ~stripped.str.lower().isin(NOTHING).to_numpy()
    if wrong.any():
        at = int(np.flatnonzero(wrong)[0])
        value = str(column.iloc[at])[:40]
        wanted = "; seconds are wanted" if name == "time_s" else ""
        raise CsvError(f"row {at + first_row}, column {name!r}: {value!r} is not a number{wanted}")
    check_size(found, name, UNITS.get(name.lower(), ""), first_row)
    return found
