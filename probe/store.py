"""The run file's writer: one SQLite file per run, safe against `kill -9`, power cuts, full disks.

Write-ahead log and ``synchronous = FULL``: what has been committed survives. A thread writes and
commits, so that a slow disk does not hold up the scan; it commits within `COMMIT_S` of the first
event that waits, and the engine tells its samples every 50 ms.
"""

import fcntl
import os
import sqlite3
import threading
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from drivers import Channel
from probe.events import Event, RunEnded, RunStarted
from probe.rows import FIRST, Row, RunFileError, from_row, link, to_row
from probe.schema import BUSY_S, VERSION, create, migrate, version_of

COMMIT_S = 0.05
OLD_S = 0.15  # when an event waits this long, whoever tells more waits up to `YIELD_S`
YIELD_S = 0.02
LATE_S = 2.0  # a disk that keeps the scan waiting longer has failed
# File systems whose shared memory other machines do not see: a write-ahead log breaks on them.
NETWORK = ("nfs", "cifs", "smb", "9p", "afs", "fuse.sshfs", "davfs", "glusterfs", "lustre", "ceph")
COLUMNS = "kind, body, times, readings, saturated"
# Rows per commit, in one statement: SQLite lets other threads run at each, and these may keep it
# waiting.
ROWS = 200


class StoreError(RuntimeError):
    """The run cannot be stored (any longer); what was committed before stays readable."""


class Store:
    """A sink of the scan's events; made by `create_store` or `reopen_store`.

    ``committed`` counts the events that are safe; ``slowest_s`` is the longest that one has waited
    for that.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: int) -> None:
        self.path = path
        self.committed = 0
        self.slowest_s = 0.0
        self._connection = connection
        self._lock = lock
        last = connection.execute("SELECT id, chain FROM event ORDER BY id DESC LIMIT 1").fetchone()
        self._id: int = last[0] if last else 0
        self._chain: bytes = last[1] if last else FIRST
        (self._last_s,) = connection.execute("SELECT max(time_s) FROM event").fetchone()
        self._channels = _channels(connection)
        self._waiting: deque[tuple[float, Event]] = deque()
        self._told = 0
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
            self._told += 1
            self._change.notify_all()
            waits_s = time.monotonic() - self._waiting[0][0]
            if waits_s > OLD_S:
                self._change.wait(YIELD_S)
        if waits_s > LATE_S:
            raise StoreError(f"{self.path}: the disk has not taken anything for {LATE_S:g} s")
        if isinstance(event, RunStarted | RunEnded):
            self.flush()

    def flush(self) -> None:
        """Return once everything told so far is committed. Raises `StoreError`."""
        with self._change:
            wanted, self._hurry = self._told, True
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

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
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
        try:
            while self._wait():
                self._commit_waiting()
        except (sqlite3.Error, OSError, ValueError) as error:
            with self._change:
                self._error = f"{self.path}: {_explain(error)}"
                self._waiting.clear()
                self._change.notify_all()
        finally:
            self._connection.close()
            os.close(self._lock)

    def _wait(self) -> bool:
        """Wait for enough events, or for the first to be `COMMIT_S` old; False at the end."""
        with self._change:
            self._change.wait_for(lambda: self._waiting or self._closing)
            self._change.wait_for(self._must_commit, timeout=COMMIT_S)
            return bool(self._waiting)

    def _commit_waiting(self) -> None:
        with self._change:
            batch = [self._waiting[n] for n in range(min(len(self._waiting), ROWS))]
        self._commit([event for _, event in batch])
        with self._change:
            for _ in batch:
                self._waiting.popleft()
            self.slowest_s = max(self.slowest_s, time.monotonic() - batch[0][0])
            self.committed += len(batch)
            self._change.notify_all()

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
            self._connection.execute("COMMIT")
        except BaseException:
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            raise
        self._id, self._chain = number, chain


def create_store(path: Path) -> Store:
    """A new run file. Raises `StoreError` if it exists or cannot be written safely."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        os.close(os.open(path, os.O_CREAT | os.O_EXCL, 0o644))
    except FileExistsError:
        raise StoreError(f"{path}: exists; a run is never overwritten") from None
    except OSError as error:
        raise StoreError(f"{path}: {_explain(error)}") from None
    try:
        return _open(path, new=True)
    except BaseException:
        path.unlink()  # an empty file would only be in the way
        raise


def reopen_store(path: Path) -> Store:
    """An existing run file, to add to. Raises `StoreError`, and `RunFileError` if it is none."""
    if not path.is_file():
        raise RunFileError(f"{path}: no such run file")
    return _open(path, new=False)


def _open(path: Path, *, new: bool) -> Store:
    kind = file_system(path)
    if any(kind.startswith(name) for name in NETWORK):
        raise StoreError(
            f"{path}: lies on a network file system ({kind}), where a run is not safe; "
            f"store it on a local disk and copy it afterwards"
        )
    lock = _lock(path)
    try:
        connection = sqlite3.connect(
            path, timeout=BUSY_S, isolation_level=None, check_same_thread=False
        )
        _make_safe(connection, path)
        if new:
            create(connection)
        elif version_of(connection) != VERSION:
            migrate(connection)
        return Store(path, connection, lock)
    except sqlite3.Error as error:
        os.close(lock)
        raise StoreError(f"{path}: {_explain(error)}") from None
    except BaseException:
        os.close(lock)
        raise


def _make_safe(connection: sqlite3.Connection, path: Path) -> None:
    """Switch the safe modes on and read them back: SQLite keeps silent about those it refuses."""
    (mode,) = connection.execute("PRAGMA journal_mode = WAL").fetchone()
    if mode != "wal":
        raise StoreError(
            f"{path}: this file system allows no write-ahead log (journal mode is {mode}); "
            f"store the run on a local disk"
        )
    connection.execute("PRAGMA synchronous = FULL")
    (level,) = connection.execute("PRAGMA synchronous").fetchone()
    if level != 2:
        raise StoreError(f"{path}: SQLite does not write synchronously (level {level}, not FULL)")


def _lock(path: Path) -> int:
    """Only one writer; the lock goes with the process, however that ends.

    The descriptor is closed after SQLite's own: closing it drops SQLite's locks on the file.
    """
    try:
        lock = os.open(path, os.O_RDWR)
    except OSError as error:
        raise StoreError(f"{path}: {_explain(error)}") from None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        raise StoreError(f"{path}: another scan is writing this run") from None
    return lock


def file_system(path: Path) -> str:
    """The type of the file system that ``path`` is on; empty where that is not known."""
    try:
        lines = Path("/proc/mounts").read_text(encoding="utf-8").splitlines()
    except OSError:
        return ""
    where = path.resolve()
    mounts = [line.split()[1:3] for line in lines]
    inside = [(len(m), kind) for m, kind in mounts if where.is_relative_to(m)]
    return max(inside, default=(0, ""))[1]


def _channels(connection: sqlite3.Connection) -> Mapping[str, tuple[Channel, ...]] | None:
    query = f"SELECT {COLUMNS} FROM event WHERE kind = 'run_started' ORDER BY id LIMIT 1"
    found = connection.execute(query).fetchone()
    if found is None:
        return None
    event = from_row(Row(*found))
    assert isinstance(event, RunStarted)
    return event.channels


def _explain(error: Exception) -> str:
    text = str(error)
    if "full" in text or "No space" in text:
        return f"the disk is full ({text}); everything committed before is kept"
    return text
