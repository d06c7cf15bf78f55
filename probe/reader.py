"""A run file opened for reading only: growing, finished, left by `kill -9`, or on read-only media.

Whatever is wrong with it comes out as `RunFileError`. Nothing in a file is ever executed: its
tables must be exactly this program's, and everything in it is data of bounded size.
"""

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from probe.rows import FIRST, MAX_BLOCK_BYTES, Row, RunFileError, link
from probe.schema import BUSY_S, VERSION, migrate, version_of

MAGIC = b"SQLite format 3\0"
MAX_FILE_BYTES = 64 * 1024**3
MAX_COPY_BYTES = 2 * 1024**3
COLUMNS = "id, kind, body, times, readings, saturated, sha256, chain"


class NotBegun(RunFileError):
    """The file is there, but the scan has not written to it yet."""


@contextmanager
def reading(path: Path) -> Iterator[sqlite3.Connection]:
    """A connection to one consistent state of the run. Raises `RunFileError`."""
    try:
        with ExitStack() as stack:
            _check(path)
            connection = _connect(path, stack)
            connection.execute("BEGIN")
            version = version_of(connection)
            if version == 0:
                raise NotBegun("nothing has been stored in it yet")
            if version < VERSION:
                connection = _migrated(connection, path, stack)
            yield connection
    except RunFileError as error:
        raise type(error)(f"{path}: {error}") from None
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise RunFileError(f"{path}: damaged or not a run file ({error})") from None
    except OSError as error:
        raise RunFileError(f"{path}: cannot be read ({error.strerror})") from None


def rows(
    connection: sqlite3.Connection, after: int = 0, limit: int = -1
) -> Iterator[tuple[int, Row]]:
    """Numbers and rows behind number ``after``. Raises `RunFileError` at the first bad one."""
    for number, row, fault in judged_rows(connection, after, limit):
        if fault:
            raise RunFileError(fault)
        yield number, row


def judged_rows(
    connection: sqlite3.Connection, after: int = 0, limit: int = -1
) -> Iterator[tuple[int, Row, str]]:
    """As `rows`, with what is wrong with each: its checksum, its place, or nothing (empty)."""
    chain = FIRST
    if after:
        found = connection.execute("SELECT chain FROM event WHERE id = ?", (after,)).fetchone()
        chain = found[0] if found else b""
    query = f"SELECT {COLUMNS} FROM event WHERE id > ? ORDER BY id LIMIT ?"
    expected = after + 1
    for number, *parts, digest, stored in connection.execute(query, (after, limit)):
        row, fault = Row(*parts), ""
        if not all(isinstance(part, str) for part in row[:2]) or digest != row.sha256:
            fault = f"event {number} is damaged: its checksum is wrong"
        elif number != expected:
            fault = f"event {expected} is missing"
        elif stored != link(chain, digest):
            fault = f"event {number} does not follow from the one before: something was replaced"
        yield number, row, fault
        expected, chain = number + 1, stored if isinstance(stored, bytes) else b""


def _check(path: Path) -> None:
    if path.is_dir():
        raise RunFileError("a folder; give the run file in it")
    if not path.is_file():
        raise RunFileError("no such run file")
    size = path.stat().st_size
    if size == 0:
        raise NotBegun("nothing has been stored in it yet")
    if size > MAX_FILE_BYTES:
        raise RunFileError(f"larger than {MAX_FILE_BYTES / 1024**3:g} GiB; not a run file")
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise RunFileError("not a run file")


def _connect(path: Path, stack: ExitStack) -> sqlite3.Connection:
    """Without a log beside it, the file is complete and can be read with nothing written there.

    With one, SQLite needs its shared memory beside the file; where it may not make that, a copy
    of both is read.
    """
    log = path.with_name(path.name + "-wal")
    if not log.exists() or log.stat().st_size == 0:
        return _open(path, "mode=ro&immutable=1", stack)
    try:
        connection = _open(path, "mode=ro", stack)
        connection.execute("SELECT count(*) FROM sqlite_schema").fetchone()
        return connection
    except sqlite3.OperationalError:
        if path.stat().st_size + log.stat().st_size > MAX_COPY_BYTES:
            raise
    folder = Path(stack.enter_context(TemporaryDirectory(prefix="palpate-")))
    for file in (path, log):
        shutil.copyfile(file, folder / file.name)
    return _open(folder / path.name, "mode=ro", stack)


def _open(path: Path, how: str, stack: ExitStack) -> sqlite3.Connection:
    uri = f"{path.resolve().as_uri()}?{how}"
    connection = stack.enter_context(
        closing(sqlite3.connect(uri, uri=True, timeout=BUSY_S, isolation_level=None))
    )
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, 2 * MAX_BLOCK_BYTES)
    for pragma in ("query_only = 1", "cell_size_check = 1"):
        connection.execute(f"PRAGMA {pragma}")
    return connection


def _migrated(connection: sqlite3.Connection, path: Path, stack: ExitStack) -> sqlite3.Connection:
    """An older file as it would be today, in memory; the file stays as it is."""
    if path.stat().st_size > MAX_COPY_BYTES:
        raise RunFileError("an older version, too large to convert in memory; resume it once")
    connection.execute("COMMIT")
    copy = stack.enter_context(closing(sqlite3.connect(":memory:", isolation_level=None)))
    connection.backup(copy)
    migrate(copy)
    return copy
