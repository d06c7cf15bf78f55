"""Arrays beyond what memory is for: kept in files without a name, which end with the process.

A run of a day holds more samples than a computer has memory. What is read from it beyond the first
megabytes is written to temporary files and mapped from there, so that the system may drop it from
memory whenever it likes and read it again.
"""

import mmap
import os
from tempfile import TemporaryFile
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Kind = TypeVar("Kind", bound=np.generic)

IN_MEMORY = 16 * 1024**2  # bytes; a scan of fifteen stations has one or two
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
        """The same values, read-only where they are in a file."""
        if self._held + array.nbytes <= IN_MEMORY or not array.nbytes:
            self._held += array.nbytes
            return array
        if self._map is None or self._next + array.nbytes > len(self._map):
            if self._map is not None and hasattr(mmap, "MADV_DONTNEED"):
                self._map.madvise(mmap.MADV_DONTNEED)  # it is in the file; not in memory as well
            with TemporaryFile(prefix="palpate-") as file:  # the map keeps it
                _reserve(file.fileno(), max(FILE, array.nbytes))
                self._map, self._next = mmap.mmap(file.fileno(), 0), 0
        kept = np.frombuffer(self._map, array.dtype, array.size, self._next).reshape(array.shape)
        kept[...] = array
        kept.flags.writeable = False
        self._next += -(-array.nbytes // ALIGNED) * ALIGNED
        return kept


def _reserve(file: int, size: int) -> None:
    """Make it that large; a disk that is full must say so now, not when a page is written back."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)
    else:
        os.ftruncate(file, size)
