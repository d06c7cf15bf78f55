"""The lock on a run file: only one scan writes it."""

import fcntl
import os
from pathlib import Path

from probe.core.errors import StoreError
from probe.storage.moved_away import identity

_writing: set[tuple[int, int]] = set()


def hold(path: Path) -> int:
    """Lock a run file: a descriptor to `release`. The lock ends with the process, in any case.

    Closing any descriptor of a file drops SQLite's locks on it. So the descriptor is closed after
    SQLite's own, and a file that this process writes already is not opened again. Raises
    `StoreError` if another scan writes it, and `OSError`.
    """
    found = path.stat()
    if identity(found) in _writing:
        raise StoreError(f"{path}: another scan is writing this run")
    if found.st_nlink > 1:
        raise StoreError(
            f"{path}: has another name (hard link), and its log may lie beside that; copy it "
            "and go on with the copy"
        )
    lock = os.open(path, os.O_RDWR)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        raise StoreError(f"{path}: another scan is writing this run") from None
    _writing.add(identity(os.fstat(lock)))
    return lock


def release(lock: int) -> None:
    """Give a run file back to other writers; after SQLite's connection to it was closed."""
    _writing.discard(identity(os.fstat(lock)))
    os.close(lock)
