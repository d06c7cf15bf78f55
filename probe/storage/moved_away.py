"""A run that is deleted, moved or replaced while a scan writes it is noticed, and kept."""

import os
import sqlite3
from pathlib import Path

from probe.storage.schema import seal

Identity = tuple[int, int]  # of a file, whatever its name


class InPlace:
    """Whether a run, its log and its shared memory are still the files that were opened.

    ``handle`` is an open descriptor of the run.
    """

    def __init__(self, path: Path, handle: int) -> None:
        self._ids: dict[Path, Identity | None] = {path: identity(os.fstat(handle))}
        for end in ("-wal", "-shm"):
            self._ids[path.with_name(path.name + end)] = None

    def lost(self) -> Path | None:
        """The first of them that was deleted, moved or replaced; None while all are there.

        A log that appears later is adopted as it is.
        """
        for path, known in self._ids.items():
            try:
                found = path.stat()
            except OSError:
                if known is not None:
                    return path
                continue
            if known is None:
                self._ids[path] = identity(found)
            elif identity(found) != known:
                return path
        return None


def rescue(connection: sqlite3.Connection, path: Path) -> Path:
    """Copy a run whose name is gone, from the files that are still open, to a new file beside it.

    Raises `sqlite3.Error` or `OSError`.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    number = 1
    while True:
        end = "" if number == 1 else f"-{number}"
        copy = path.with_name(f"{path.stem}-rescued{end}{path.suffix}")
        try:
            os.close(os.open(copy, os.O_CREAT | os.O_EXCL, 0o644))
            break
        except FileExistsError:
            number += 1
    target = sqlite3.connect(copy, isolation_level=None)
    try:
        connection.backup(target)
        seal(target)
    finally:
        target.close()
    return copy


def identity(found: os.stat_result) -> Identity:
    """Device and inode."""
    return found.st_dev, found.st_ino
