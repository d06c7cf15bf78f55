"""A run that is deleted, replaced or cut short while a scan writes it is noticed, and kept."""

import os
import sqlite3
from pathlib import Path

from probe.storage.log import FRAME_HEADER, HEADER

Identity = tuple[int, int]  # of a file, whatever its name


class InPlace:
    """Whether a run, its log and its shared memory are still the files that were opened, whole.

    ``handle`` is an open descriptor of the run, ``connection`` what writes it.
    """

    def __init__(self, path: Path, handle: int, connection: sqlite3.Connection) -> None:
        self._connection = connection
        self._page = int(connection.execute("PRAGMA page_size").fetchone()[0])
        self._log = path.with_name(f"{path.name}-wal")
        memory = path.with_name(f"{path.name}-shm")
        self._seen: dict[Path, os.stat_result | None] = {
            path: os.fstat(handle), self._log: None, memory: None
        }  # fmt: skip

    def lost(self) -> str | None:
        """What became of the first of them that is not; None while all are.

        A log that appears later is adopted as it is. To be asked before SQLite writes too: it makes
        a log that was cut short as long as before, with a hole in it, of which less can be kept.
        """
        for path, seen in self._seen.items():
            try:
                found = path.stat()
            except OSError:
                found = None
            if seen is not None:
                if found is None or identity(found) != identity(seen):
                    return f"{path}: was deleted, moved or replaced while the scan wrote it"
                short = found.st_size < seen.st_size and not self._was_emptied(path)
                if short or (path == self._log and self._has_hole(seen, found)):
                    return f"{path}: was cut short while the scan wrote it"
            self._seen[path] = found
        return None

    def _has_hole(self, seen: os.stat_result, found: os.stat_result) -> bool:
        """Whether a log that grew was cut before: what was its last frame names no page then."""
        if not HEADER < seen.st_size < found.st_size:
            return False
        with self._log.open("rb") as log:
            log.seek(seen.st_size - FRAME_HEADER - self._page)
            return log.read(4) == bytes(4)

    def _was_emptied(self, path: Path) -> bool:
        """A log by another program's checkpoint: as long as all that is still needed of it."""
        if path != self._log:
            return False
        try:  # does nothing after such a checkpoint, and reads what it needs otherwise
            frames = int(self._connection.execute("PRAGMA wal_checkpoint").fetchone()[1])
        except sqlite3.Error:
            return False
        return frames <= 0 or path.stat().st_size >= HEADER + frames * (FRAME_HEADER + self._page)


def rescue(connection: sqlite3.Connection, path: Path) -> tuple[Path, sqlite3.Connection]:
    """Copy a run to a new file beside it, from what is still open or in memory.

    The connection to that file, too, whole and without a seal. Raises `sqlite3.Error` or `OSError`.
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
    target = sqlite3.connect(copy, isolation_level=None, check_same_thread=False)
    try:
        connection.backup(target)
        (found,) = target.execute("PRAGMA quick_check(1)").fetchone()
        if found != "ok":
            raise sqlite3.DatabaseError(f"{copy} holds only a part of it")
    except BaseException:
        target.close()
        raise
    return copy, target


def identity(found: os.stat_result) -> Identity:
    """Device and inode."""
    return found.st_dev, found.st_ino
