"""``palpate verify RUN``: is a run file whole, and does it hold what it says?"""

import sqlite3
import time
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from drivers.core.files import path_of
from probe.core.errors import RunFileError
from probe.core.events import Finish
from probe.storage.audit import MAX_PROBLEMS, Audit
from probe.storage.log import unreadable_frames
from probe.storage.reader import NOTHING_YET, NotBegun, judged_rows, log_of, reading
from probe.storage.rows import from_row
from probe.storage.schema import broken_seal, last_event

WRITING_S = 0.3  # a scan writes its log every 0.05 s: one that rests this long is not being written


@dataclass(frozen=True)
class Report:
    """What `verify` found; ``problems`` is empty for a sound file.

    ``samples`` and ``lost`` (known to be missing, as the device said) count by device;
    ``finish`` is None for a run that goes on or was broken off.

    Examples
    --------
    >>> import palpate
    >>> report = palpate.verify("TIHA.run")
    >>> report.ok, report.stations_complete, report.problems, report.lost
    (True, 15, (), {})
    """

    path: Path
    problems: tuple[str, ...]
    events: int
    samples: dict[str, int]
    lost: dict[str, int]
    stations_complete: int
    stations_planned: int
    attempts: int
    sessions: int
    finish: Finish | None

    @property
    def ok(self) -> bool:
        """True if nothing is wrong."""
        return not self.problems

    def as_json(self) -> dict[str, Any]:
        """For ``--json``."""
        found = asdict(self)
        run = str(found.pop("path"))
        return {"run": run, "ok": self.ok, **found, "problems": list(self.problems)}


def verify(path: str | PathLike[str]) -> Report:
    """Check everything that can be checked in a run file; nothing is written.

    Parameters
    ----------
    path
        The run file.

    Returns
    -------
    Report
        Its ``ok``, and what was found: the database's own integrity, its log, every row's
        check sum and place in the chain, that the last events are there, the order of
        events, that no sample is there twice or under a station it was not taken at, and
        that stations marked complete are.

    Raises
    ------
    RunFileError
        Only if the file is no run at all, or nothing has been stored in it yet.

    Examples
    --------
    >>> import palpate
    >>> palpate.verify("TIHA.run").ok
    True
    """
    path = path_of(path, "a run or the name of its file")
    audit = Audit()
    log = log_of(path)
    with reading(path) as connection:
        lost_log = _judge_log(log)
        try:
            for (text,) in connection.execute(f"PRAGMA integrity_check({MAX_PROBLEMS})"):
                if text != "ok":
                    audit.add(f"database: {text}")
        except sqlite3.Error as error:  # what the run holds may be whole nevertheless
            audit.add(f"database: {error}")
        try:
            for number, row, fault in judged_rows(connection):
                if fault:
                    audit.add(fault)
                try:
                    audit.take(from_row(row))
                except RunFileError as error:
                    audit.add(f"event {number}: {error}")
            sealed = _judge_seal(connection, audit.events, has_log=log.exists())
        except (sqlite3.Error, UnicodeDecodeError) as error:  # say so, and what came before
            audit.add(f"database: {error}")
            sealed = ""
    if not (audit.events or audit.problems or lost_log or sealed):
        raise NotBegun(f"{path}: {NOTHING_YET}")
    audit.end()
    problems = [text for text in (lost_log, sealed, *audit.problems) if text]
    if audit.more:
        problems.append(f"and {audit.more} more")
    return Report(
        path,
        tuple(problems),
        audit.events,
        dict(audit.samples),
        {device: lost for device, lost in audit.lost.items() if lost},
        len(audit.complete),
        len(audit.planned),
        sum(audit.attempts.values()),
        audit.sessions,
        audit.finish,
    )


def _judge_log(log: Path) -> str:
    """What a log beside the file has lost; empty if nothing, or while a scan writes it."""
    while log.exists():
        before = log.stat()
        if not (lost := unreadable_frames(log)):
            return ""
        time.sleep(WRITING_S)
        if log.exists() and (log.stat().st_mtime_ns, log.stat().st_size) == (
            before.st_mtime_ns,
            before.st_size,
        ):
            return (
                f"log: {lost} pages of {log.name} cannot be read; the events in them, committed "
                "last, are lost (it was damaged, or power was cut while it was written)"
            )
    return ""


def _judge_seal(connection: sqlite3.Connection, events: int, *, has_log: bool) -> str:
    """Whether the last events are there, and the log of a file that nobody closed."""
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if version < 3:
        return ""
    broken = broken_seal(connection, events, last_event(connection)[1])
    if broken is not None or has_log:
        return broken or ""
    return (
        "log: the scan did not close this file, and RUN-wal is not beside it: the events that were "
        "committed last are missing if it was lost (copied without it?)"
    )
