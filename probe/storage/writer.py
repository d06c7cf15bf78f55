"""The run file's writer: one SQLite file per run, safe against `kill -9`, power cuts, full disks.

Write-ahead log and ``synchronous = FULL``: what has been committed survives. A thread writes and
commits, so that a slow disk does not hold up the scan; it commits within `COMMIT_S` of the first
event that waits, and the engine publishes its samples every 50 ms.
"""

import os
import sqlite3
import threading
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Self

from drivers import Channel
from probe.core.errors import RunFileError, StoreError
from probe.core.events import Event, RunEnded, RunStarted
from probe.storage.disk import explain, open_safely
from probe.storage.lock import release
from probe.storage.moved_away import InPlace, rescue
from probe.storage.rows import Row, from_row, link, to_row
from probe.storage.schema import last_event, seal

__all__ = ["Store", "StoreError", "create_store", "reopen_store"]

COMMIT_S = 0.05
OLD_S = 0.15  # when an event waits this long, whoever publishes more waits up to `YIELD_S`
YIELD_S = 0.02
LATE_S = 2.0  # a disk that keeps the scan waiting longer has failed
BEFORE_OTHERS = -10  # nice value: a machine that computes is not a disk that hangs
# Rows per commit, in one statement: SQLite lets other threads run at each, and these may keep it
# waiting.
ROWS = 200
COLUMNS = "kind, body, times, readings, saturated"


class Store:
    """A sink of the scan's events; made by `create_store` or `reopen_store`.

    ``committed`` counts the events that are safe; ``slowest_s`` is the longest that one has waited
    for that. ``path`` is where they are: a run that is deleted, replaced or cut short while it is
    written is kept under another name.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: int) -> None:
        self.path = path
        self.committed = 0
        self.slowest_s = 0.0
        self._connection = connection
        self._lock = lock
        self._in_place = InPlace(path, lock, connection)
        self._whole = True
        self._id, self._chain = last_event(connection)
        (self._last_s,) = connection.execute("SELECT max(time_s) FROM event").fetchone()
        self._channels = _channels(connection)
        self._waiting: deque[tuple[float, Event]] = deque()
        self._published = 0
        self._closing = self._hurry = False
        self._error: str | None = None
        self._change = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="palpate store", daemon=True)
        self._thread.start()

    def __call__(self, event: Event) -> None:
        """Take one event. Raises `StoreError` if this or an earlier one cannot be stored."""
        if isinstance(event, RunStarted):
            self._check_same_run(event)
        with self._change:
            self._fail()
            if self._closing:
                raise StoreError(f"{self.path}: closed")
            self._waiting.append((time.monotonic(), event))
            self._published += 1
            if len(self._waiting) == 1 or self._must_commit():  # else the writer sleeps on
                self._change.notify_all()
            waits_s = time.monotonic() - self._waiting[0][0]
            if waits_s > OLD_S:
                self._change.wait(YIELD_S)
        if waits_s > LATE_S:
            raise StoreError(f"{self.path}: the disk has not taken anything for {LATE_S:g} s")
        if isinstance(event, RunStarted | RunEnded):
            self.flush()

    def flush(self) -> None:
        """Return once everything published so far is committed. Raises `StoreError`."""
        with self._change:
            wanted, self._hurry = self._published, True
            self._change.notify_all()
            in_time = self._change.wait_for(
                lambda: self._error is not None or self.committed >= wanted, timeout=LATE_S
            )
            self._hurry = False
            self._fail()
        if not in_time:
            raise StoreError(f"{self.path}: the disk has not taken anything for {LATE_S:g} s")

    def close(self) -> None:
        """Commit what waits and release the file. Idempotent, never raises.

        A disk that hangs is left to hang: the file is released when it comes back.
        """
        with self._change:
            self._closing = True
            self._change.notify_all()
        self._thread.join(timeout=LATE_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def _fail(self) -> None:
        if self._error is not None:
            raise StoreError(self._error)

    def _check_same_run(self, event: RunStarted) -> None:
        if self._channels is not None and dict(event.channels) != dict(self._channels):
            raise StoreError(f"{self.path}: a run goes on only with the channels it began with")
        if self._last_s is not None and event.time_s < self._last_s:
            raise StoreError(
                f"{self.path}: already holds samples up to {self._last_s:g} s; "
                f"a resumed scan's clock must start after that"
            )

    def _run(self) -> None:
        """The writing thread; it alone uses the connection, and closes it."""
        with suppress(AttributeError, OSError):  # Linux only; root, or a limit on `nice`
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), BEFORE_OTHERS)
        try:
            while self._wait():
                self._commit_waiting()
            self._look(committed=0)
        except (sqlite3.Error, OSError, ValueError, StoreError) as error:
            with self._change:
                known = isinstance(error, StoreError)
                self._error = str(error) if known else f"{self.path}: {explain(error)}"
                self._waiting.clear()
                self._change.notify_all()
        finally:
            if self._whole:
                _seal(self._connection)
            self._connection.close()
            release(self._lock)

    def _wait(self) -> bool:
        """Wait for enough events, or for the first to be `COMMIT_S` old; False at the end."""
        with self._change:
            self._change.wait_for(lambda: self._waiting or self._closing)
            self._change.wait_for(self._must_commit, timeout=COMMIT_S)
            return bool(self._waiting)

    def _commit_waiting(self) -> None:
        with self._change:
            batch = [self._waiting[n] for n in range(min(len(self._waiting), ROWS))]
        self._look(committed=0)
        self._commit([event for _, event in batch])
        self._look(committed=len(batch))
        with self._change:
            for _ in batch:
                self._waiting.popleft()
            self.slowest_s = max(self.slowest_s, time.monotonic() - batch[0][0])
            self.committed += len(batch)
            self._change.notify_all()

    def _look(self, committed: int) -> None:
        """Raises `StoreError` where the run is lost, once all that waits is kept elsewhere too, but
        for the first ``committed``, which are in it."""
        if (lost := self._in_place.lost()) is None:
            return
        self._whole = False  # nothing more is written to it
        if self._connection.in_transaction:
            self._connection.execute("ROLLBACK")
        try:
            path, copy = rescue(self._connection, self.path)
        except (sqlite3.Error, OSError) as error:
            why = f"it could not be kept elsewhere ({explain(error)})"
            raise StoreError(f"{lost}; {why}; `palpate verify` says what is left of it") from None
        self._connection.close()
        self.path, self._connection = path, copy
        with self._change:
            came_since = [event for _, event in self._waiting][committed:]
        for n in range(0, len(came_since), ROWS):
            self._commit(came_since[n : n + ROWS])
        seal(copy)
        raise StoreError(f"{lost}; everything read until then is kept in {path}")

    def _must_commit(self) -> bool:
        return self._hurry or self._closing or len(self._waiting) >= ROWS

    def _commit(self, events: list[Event]) -> None:
        number, chain = self._id, self._chain
        rows: list[tuple[object, ...]] = []
        for event in events:
            made = to_row(event)
            digest = made.sha256
            number, chain = number + 1, link(chain, digest)
            rows.append((number, *made, digest, chain))
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            places = ", ".join(["(?, ?, ?, ?, ?, ?, ?, ?)"] * len(rows))
            self._connection.execute(
                f"INSERT INTO event (id, {COLUMNS}, sha256, chain) VALUES {places}",
                [value for row in rows for value in row],
            )
            if self._whole:  # only the next line writes to the log
                self._look(committed=0)
            self._connection.execute("COMMIT")
        except BaseException:
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            raise
        self._id, self._chain = number, chain


def create_store(path: Path) -> Store:
    """A new run file. Raises `StoreError` if it exists or cannot be written safely."""
    path = path.resolve()  # SQLite puts the log beside the file itself, not beside a link to it
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        os.close(os.open(path, os.O_CREAT | os.O_EXCL, 0o644))
    except FileExistsError:
        raise StoreError(f"{path}: exists; a run is never overwritten") from None
    except OSError as error:
        raise StoreError(f"{path}: {explain(error)}") from None
    try:
        return Store(path, *open_safely(path, new=True))
    except BaseException:
        path.unlink(missing_ok=True)  # an empty file would only be in the way
        raise


def reopen_store(path: Path) -> Store:
    """An existing run file, to add to. Raises `StoreError`, and `RunFileError` if it is none."""
    if not path.is_file():
        raise RunFileError(f"{path}: no such run file")
    path = path.resolve()
    connection, lock = open_safely(path, new=False)
    try:
        return Store(path, connection, lock)
    except (sqlite3.Error, UnicodeDecodeError, RunFileError) as error:
        connection.close()
        release(lock)
        raise RunFileError(f"{path}: damaged ({error}); `palpate verify` says where") from None


def _seal(connection: sqlite3.Connection) -> None:
    """Seal the run, also on a full disk: what the log holds goes into the file first, and the seal
    where the log began."""
    try:
        seal(connection)
    except sqlite3.Error:
        with suppress(sqlite3.Error):  # no room in the file either: the next `palpate resume` seals
            connection.execute("PRAGMA wal_checkpoint(RESTART)")
            seal(connection)


def _channels(connection: sqlite3.Connection) -> Mapping[str, tuple[Channel, ...]] | None:
    query = f"SELECT {COLUMNS} FROM event WHERE kind = 'run_started' ORDER BY id LIMIT 1"
    found = connection.execute(query).fetchone()
    if found is None:
        return None
    event = from_row(Row(*found))
    assert isinstance(event, RunStarted)
    return event.channels
