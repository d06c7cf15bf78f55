"""The tables of a run file, how to know one, and how to bring an older one up to date.

Any SQLite tool can read it: ``event`` holds everything in the order in which it was published,
``station`` lists the presses. ``seal`` says how many events there are once nobody writes any more.
"""

import sqlite3

from probe.core.errors import RunFileError
from probe.storage.rows import FIRST, link

APPLICATION_ID = 0x50414C50  # "PALP"
VERSION = 4
BUSY_S = 1.5

_EVENT = """CREATE TABLE event (
    id INTEGER PRIMARY KEY,
    kind TEXT NOT NULL,
    body TEXT NOT NULL,
    times BLOB,
    readings BLOB,
    saturated BLOB,
    sha256 BLOB NOT NULL,
    chain BLOB NOT NULL,
    time_s REAL AS (json_extract(body, '$.time_s')),
    device TEXT AS (json_extract(body, '$.device')),
    station INTEGER AS (json_extract(body, '$.station')),
    attempt INTEGER AS (json_extract(body, '$.attempt'))
) STRICT"""
_STATION = """CREATE VIEW station AS
SELECT began.station, began.attempt,
    1e3 * json_extract(began.body, '$.x_m') AS x_mm,
    1e3 * json_extract(began.body, '$.y_m') AS y_mm,
    began.time_s AS started_s, ended.time_s AS ended_s,
    coalesce(json_extract(ended.body, '$.complete'), 0) AS complete
FROM event AS began LEFT JOIN event AS ended
    ON ended.kind = 'station_ended'
    AND ended.station = began.station AND ended.attempt = began.attempt
WHERE began.kind = 'station_started'"""
# The file itself refuses a press that is numbered twice or ended twice.
_RULES = (
    "CREATE UNIQUE INDEX started_once ON event (station, attempt) WHERE kind = 'station_started'",
    "CREATE UNIQUE INDEX ended_once ON event (station, attempt) WHERE kind = 'station_ended'",
    "CREATE INDEX samples_of ON event (station, attempt) WHERE kind = 'samples'",
)
_COMPLETE_ONCE = (
    "CREATE UNIQUE INDEX complete_once ON event (station) "
    "WHERE kind = 'station_ended' AND json_extract(body, '$.complete')"
)
# One row. While a scan writes, and after it was killed, both are NULL: then ``RUN-wal`` belongs to
# the run. A writer that closes the file puts in the number and the chain of the last event.
_SEAL = """CREATE TABLE seal (
    only INTEGER PRIMARY KEY CHECK (only = 1),
    events INTEGER,
    chain BLOB
) STRICT"""
# Version 1 had no chain: a lost row showed only as a gap in the numbers. Version 2 had no seal: a
# lost log did not show. Up to version 3 no complete station could be pressed again.
_EVENT_1 = _EVENT.replace("    chain BLOB NOT NULL,\n", "")
SHAPES = {
    1: (_EVENT_1, *_RULES, _COMPLETE_ONCE, _STATION),
    2: (_EVENT, *_RULES, _COMPLETE_ONCE, _STATION),
    3: (_EVENT, *_RULES, _COMPLETE_ONCE, _STATION, _SEAL),
    4: (_EVENT, *_RULES, _STATION, _SEAL),
}
# What ANALYZE and PRAGMA optimize of other programs leave behind: numbers for the query planner.
_STATISTICS = (
    "CREATE TABLE sqlite_stat1(tbl,idx,stat)",
    "CREATE TABLE sqlite_stat4(tbl,idx,neq,nlt,ndlt,sample)",
)
MAX_OBJECTS = 20  # tables, views and indexes: more than any version has


def create(connection: sqlite3.Connection, version: int = VERSION) -> None:
    """Make an empty run file; one transaction."""
    connection.execute("BEGIN IMMEDIATE")
    for statement in SHAPES[version]:
        connection.execute(statement)
    if version == VERSION:
        connection.execute("INSERT INTO seal VALUES (1, NULL, NULL)")
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute(f"PRAGMA user_version = {version}")
    connection.execute("COMMIT")


def version_of(connection: sqlite3.Connection) -> int:
    """The version of the run file, 0 for a file that nothing has been written to.

    Raises `RunFileError` unless every table, view and index is exactly this program's: an SQLite
    file from elsewhere may hold views and triggers that run when it is read.
    """
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    query = f"SELECT sql FROM sqlite_schema LIMIT {MAX_OBJECTS + 1}"
    objects = [str(sql) for (sql,) in connection.execute(query)]
    found = [sql for sql in objects if sql not in _STATISTICS]
    if (application, version, found) == (0, 0, []):
        return 0
    if application != APPLICATION_ID:
        raise RunFileError("an SQLite file, but not a run of palpate")
    if version > VERSION:
        raise RunFileError(
            f"written by a newer palpate (file version {version}; this one reads up to "
            f"{VERSION}); update palpate"
        )
    known = version in SHAPES and sorted(found) == sorted(SHAPES[version])
    if not known or len(objects) > MAX_OBJECTS:
        raise RunFileError(f"its tables are not those of a run file of version {version}")
    return int(version)


def migrate(connection: sqlite3.Connection) -> None:
    """Bring a file of any older version to `VERSION`, in one transaction."""
    version = version_of(connection)
    connection.execute("BEGIN IMMEDIATE")
    try:
        if version == 1:
            _add_chain(connection)
        if version < 3:
            connection.execute(_SEAL)
            connection.execute("INSERT INTO seal VALUES (1, NULL, NULL)")
        connection.execute("DROP INDEX IF EXISTS complete_once")
        connection.execute(f"PRAGMA user_version = {VERSION}")
    except BaseException:
        connection.execute("ROLLBACK")
        raise
    connection.execute("COMMIT")


def unseal(connection: sqlite3.Connection) -> None:
    """Say in the file itself, not only in its log, that its log belongs to it from now on."""
    connection.execute("UPDATE seal SET events = NULL, chain = NULL")
    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()


def seal(connection: sqlite3.Connection) -> None:
    """Say how many events there are, and the last one's chain; the log is needed no more."""
    connection.execute(
        "UPDATE seal SET (events, chain) = (SELECT id, chain FROM event ORDER BY id DESC LIMIT 1)"
    )


def last_event(connection: sqlite3.Connection) -> tuple[int, bytes]:
    """Number and chain of the last event; 0 and `FIRST` without any."""
    query = "SELECT id, chain FROM event ORDER BY id DESC LIMIT 1"
    return connection.execute(query).fetchone() or (0, FIRST)


def broken_seal(connection: sqlite3.Connection, events: int, chain: bytes) -> str | None:
    """What is wrong if the last event is not that of when the writer closed the file, or "".

    None where a scan writes the file, or was killed while it did: it has no seal then.
    """
    sealed = connection.execute("SELECT events, chain FROM seal").fetchone()
    if sealed is None:
        return "seal: removed"
    if sealed == (None, None):
        return None
    if sealed[0] != events:
        return f"seal: {events} events, but there were {sealed[0]} when the scan closed the file"
    if sealed[1] != chain:
        return "seal: the events are not those of when the scan closed the file; some were replaced"
    return ""


def _add_chain(connection: sqlite3.Connection) -> None:
    connection.execute("DROP VIEW station")
    for name in ("started_once", "ended_once", "complete_once", "samples_of"):
        connection.execute(f"DROP INDEX {name}")
    connection.execute("ALTER TABLE event RENAME TO event_1")
    connection.execute(_EVENT)
    chain = FIRST
    # With the checksums as they were stored: of a damaged row a new one would be right.
    kept = "id, kind, body, times, readings, saturated, sha256"
    for *row, digest in connection.execute(f"SELECT {kept} FROM event_1 ORDER BY id"):
        chain = link(chain, digest)
        connection.execute(
            f"INSERT INTO event ({kept}, chain) VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            (*row, digest, chain),
        )
    connection.execute("DROP TABLE event_1")
    for statement in (*_RULES, _STATION):
        connection.execute(statement)
