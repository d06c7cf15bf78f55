"""A run file opened for reading only: growing, finished, left by `kill -9`, or on read-only media.

Whatever is wrong with it comes out as `RunFileError`. Nothing in a file is ever executed: its
tables must be exactly this program's, and everything in it is data of bounded size.

Only SQLite itself opens the file. Closing a file drops the POSIX locks that its process holds on
it, SQLite's among them: a notebook that looked at the run that it scans would otherwise let other
programs believe that nobody writes, and delete its log.
"""

import shutil
import sqlite3
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from probe.core.errors import RunFileError
from probe.storage.rows import FIRST, MAX_ROW_BYTES, Row, link
from probe.storage.schema import BUSY_S, version_of

MAX_FILE_BYTES = 64 * 1024**3
MAX_COPY_BYTES = 2 * 1024**3
COLUMNS = "id, kind, body, times, readings, saturated, sha256"
RETRY_S = 0.02
# No descriptor or memory is left, or the disk does not answer: nothing is said of the file.
NOT_OPENED = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_NOMEM)
# Where SQLite may not make its shared memory beside the file, and as read-only media answer.
NO_SHARED_MEMORY = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY)

NOTHING_YET = (
    "nothing has been stored in it yet, not one press; where no scan is writing it there is "
    "nothing to resume: begin a new scan, and the file may be deleted"
)
TO_RECOVER = (
    "; `palpate verify` counts what can be read of it, and docs/how-to/runs.md says how to take "
    "that out"
)


class NotBegun(RunFileError):
    """The file is there, but the scan has not written to it yet."""


@contextmanager
def reading(path: Path) -> Iterator[sqlite3.Connection]:
    """A connection to one consistent state of the run. Raises `RunFileError`."""
    if "\0" in str(path):
        raise RunFileError(f"{str(path)!r}: no such run file; no file's name has a zero byte")
    try:
        with ExitStack() as stack:
            yield _opened(path.resolve(), stack)  # a log lies beside the file, not beside a link
    except RunFileError as error:
        raise type(error)(f"{path}: {error}") from None
    except (sqlite3.Error, UnicodeDecodeError) as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        what = "cannot be read" if code in NOT_OPENED else "damaged or not a run file"
        hint = "" if path.suffix == ".run" else "; `palpate import` reads other recordings"
        hint = TO_RECOVER if code == sqlite3.SQLITE_CORRUPT else hint
        raise RunFileError(f"{path}: {what} ({error}){hint}") from None
    except OSError as error:
        raise RunFileError(f"{path}: cannot be read ({error.strerror})") from None


def rows(
    connection: sqlite3.Connection, after: int = 0, limit: int = -1
) -> Iterator[tuple[int, Row]]:
    """Numbers and rows behind number ``after``. Raises `RunFileError` at the first bad one."""
    for number, row, fault in judged_rows(connection, after, limit):
        if fault:
            raise RunFileError(f"{fault}{TO_RECOVER}")
        yield number, row


def judged_rows(
    connection: sqlite3.Connection, after: int = 0, limit: int = -1
) -> Iterator[tuple[int, Row, str]]:
    """As `rows`, with what is wrong with each: its checksum, its place, or nothing (empty)."""
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    stored_chain = "chain" if version > 1 else "NULL"
    chain = FIRST
    if after and version > 1:
        found = connection.execute("SELECT chain FROM event WHERE id = ?", (after,)).fetchone()
        chain = found[0] if found else b""
    query = f"SELECT {COLUMNS}, {stored_chain} FROM event WHERE id > ? ORDER BY id LIMIT ?"
    expected = after + 1
    for number, *parts, digest, stored in connection.execute(query, (after, limit)):
        row, fault = Row(*parts), ""
        typed = all(isinstance(part, str) for part in row[:2]) and all(
            part is None or isinstance(part, bytes) for part in row[2:]
        )
        if not typed or digest != row.sha256:
            fault = f"event {number} is damaged: its checksum is wrong"
        elif number != expected:
            fault = f"event {expected} is missing"
        elif version > 1 and stored != link(chain, digest):
            fault = f"event {number} does not follow from the one before: something was replaced"
        yield number, row, fault
        expected, chain = number + 1, stored if isinstance(stored, bytes) else b""


def log_of(path: Path) -> Path:
    """The write-ahead log of a run: it lies beside the file itself, not beside a link to it."""
    path = path.resolve()
    return path.parent / f"{path.name}-wal"


def _opened(path: Path, stack: ExitStack) -> sqlite3.Connection:
    """A connection within a transaction.

    If a scan begins or ends at this very moment, its log comes or goes between two looks: tried
    again then.
    """
    until_s = time.monotonic() + BUSY_S
    while True:
        before = _state(path)
        try:
            with ExitStack() as attempt:
                connection = _connect(path, attempt)
                connection.execute("BEGIN")
                if version_of(connection) == 0:
                    raise NotBegun(NOTHING_YET)
                if _state(path)[1] == before[1]:
                    stack.enter_context(attempt.pop_all())
                    return connection
        except (sqlite3.Error, OSError, RunFileError):
            if _state(path) == before or time.monotonic() > until_s:
                raise
        time.sleep(RETRY_S)


def _state(path: Path) -> tuple[tuple[int, int] | None, bool]:
    """When the file changed last and how large it is; whether there is a log."""
    try:
        found = path.stat()
    except OSError:
        return None, log_of(path).exists()
    return (found.st_mtime_ns, found.st_size), log_of(path).exists()


def _check(path: Path) -> None:
    if path.is_dir():
        raise RunFileError("a folder; give the run file in it")
    if not path.exists():
        raise RunFileError("no such run file")
    if not path.is_file():
        raise RunFileError("a pipe or device, not a run file")
    size = path.stat().st_size
    if size == 0:
        raise NotBegun(NOTHING_YET)
    if size > MAX_FILE_BYTES:
        raise RunFileError(f"larger than {MAX_FILE_BYTES / 1024**3:g} GiB; not a run file")


def _connect(path: Path, stack: ExitStack) -> sqlite3.Connection:
    """Without a log beside it, the file is complete and can be read with nothing written there.

    With one, SQLite needs its shared memory beside the file; where it may not make that, a copy
    of both is read.
    """
    _check(path)
    log = log_of(path)
    if not log.exists():
        return _open(path, "mode=ro&immutable=1", stack)
    try:
        connection = _open(path, "mode=ro", stack)
        connection.execute("SELECT count(*) FROM sqlite_schema").fetchone()
        return connection
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & 0xFF not in NO_SHARED_MEMORY or not log.exists():
            raise
    if path.stat().st_size + log.stat().st_size > MAX_COPY_BYTES:
        raise RunFileError("its folder is read-only and it is too large to copy; copy it yourself")
    folder = Path(stack.enter_context(TemporaryDirectory(prefix="palpate-")))
    for file in (path, log):
        shutil.copyfile(file, folder / file.name)
    return _open(folder / path.name, "mode=ro", stack)


def _open(path: Path, how: str, stack: ExitStack) -> sqlite3.Connection:
    uri = f"{path.as_uri()}?{how}"
    connection = stack.enter_context(
        closing(sqlite3.connect(uri, uri=True, timeout=BUSY_S, isolation_level=None))
    )
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_ROW_BYTES)
    for pragma in ("query_only = 1", "cell_size_check = 1"):
        connection.execute(f"PRAGMA {pragma}")
    return connection
