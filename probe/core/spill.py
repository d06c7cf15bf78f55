"""Arrays too large for memory, in unnamed files that are deleted with the process.

A run of a day holds more samples than a computer has memory. What is read from it beyond the first
megabytes is written to temporary files and mapped from there, so that the system may drop it from
memory whenever it likes and read it again.
"""

import mmap
import os
from tempfile import TemporaryFile
from typing import IO, Generic, TypeVar
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

Kind = TypeVar("Kind", bound=np.generic)

IN_MEMORY = 16 * 1024**2  # bytes; a scan of fifteen stations has one or two
ONE = 8 * 1024**2  # bytes of one array while it grows; a run of 64 GiB has few files even then
FILE = 64 * 1024**2  # bytes of each file, so that a process has few of them
ALIGNED = 64  # bytes: what vector instructions like


class Spill:
    """`keep` returns an equal array that is in memory while there is room, then in a file.

    Raises `OSError` where the folder for temporary files has no room left.
    """

    def __init__(self) -> None:
        self._held = 0
        self._map: mmap.mmap | None = None
        self._next = 0

    def keep(self, array: NDArray[Kind]) -> NDArray[Kind]:
        """The same values, read-only where they are in a file (what is so already stays there)."""
        if not (array.flags.writeable and array.nbytes):
            return array
        if self._held + array.nbytes <= IN_MEMORY:
            self._held += array.nbytes
            return array
        if self._map is None or self._next + array.nbytes > len(self._map):
            with TemporaryFile(prefix="palpate-") as file:  # the map keeps it
                _reserve(file.fileno(), max(FILE, array.nbytes))
                self._map, self._next = mmap.mmap(file.fileno(), 0), 0
        kept = np.frombuffer(self._map, array.dtype, array.size, self._next).reshape(array.shape)
        kept[...] = array
        kept.flags.writeable = False
        self._next += -(-array.nbytes // ALIGNED) * ALIGNED
        _only_in_file(self._map)
        return kept


class Growing(Generic[Kind]):
    """An array whose rows come bit by bit: in memory up to `ONE` bytes, then in a file.

    ``columns`` is None for an array of one axis. `OSError` as `Spill` raises it.
    """

    def __init__(self, kind: type[Kind], columns: int | None = None) -> None:
        self._kind, self._columns = np.dtype(kind), columns
        self._held = bytearray()
        self._file: IO[bytes] | None = None
        self._map: mmap.mmap | None = None

    def add(self, rows: NDArray[Kind]) -> None:
        """Append ``rows``; not after `whole`."""
        data = np.ascontiguousarray(rows, self._kind).data
        if self._file is None and len(self._held) + data.nbytes > ONE:
            self._file = TemporaryFile(prefix="palpate-")  # noqa: SIM115 - it stays open
            finalize(self, self._file.close)  # of a press that was broken off
            self._file.write(self._held)
            self._held = bytearray()
        if data.nbytes:
            (self._held.extend if self._file is None else self._file.write)(data.cast("B"))

    def whole(self) -> NDArray[Kind]:
        """All rows; read-only where they are in a file."""
        held: bytearray | mmap.mmap = self._held
        if self._file is not None:
            with self._file as file:  # the map keeps it
                file.flush()
                held = self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        rows = np.frombuffer(held, self._kind)
        return rows if self._columns is None else rows.reshape(-1, self._columns)

    def rest(self) -> None:
        """Take out of memory what is in the file too."""
        if self._map is not None:
            _only_in_file(self._map)


def _only_in_file(held: mmap.mmap) -> None:
    if hasattr(mmap, "MADV_DONTNEED"):
        held.madvise(mmap.MADV_DONTNEED)


def _reserve(file: int, size: int) -> None:
    """Make it that large; a disk that is full must say so now, not when a page is written back."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)
    else:
        os.ftruncate(file, size)
