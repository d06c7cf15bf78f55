"""``palpate verify RUN``: is a run file whole, and does it hold what it says?"""

import sqlite3
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from probe.audit import Audit
from probe.events import Finish
from probe.reader import judged_rows, reading
from probe.rows import RunFileError, from_row

MAX_PROBLEMS = 100


@dataclass(frozen=True)
class Report:
    """What `verify` found; ``problems`` is empty for a sound file.

    ``samples`` and ``lost`` (known to be missing, as the device said) count by device;
    ``finish`` is None for a run that goes on or was broken off.
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
        return {
            "run": str(self.path),
            "ok": self.ok,
            "problems": list(self.problems),
            "events": self.events,
            "samples": self.samples,
            "lost": self.lost,
            "stations_complete": self.stations_complete,
            "stations_planned": self.stations_planned,
            "attempts": self.attempts,
            "sessions": self.sessions,
            "finish": self.finish,
        }


def verify(path: str | Path) -> Report:
    """Check everything that can be checked; nothing is written.

    The database's own integrity, every row's checksum and its place in the chain, the order of
    events, that no sample is there twice or under a station it was not taken at, and that stations
    marked complete are. Raises `RunFileError` only for a file that is no run at all.
    """
    path = Path(path)
    audit, problems = Audit(), list[str]()
    with reading(path) as connection:
        try:
            problems += [
                f"database: {text}"
                for (text,) in connection.execute(f"PRAGMA integrity_check({MAX_PROBLEMS})")
                if text != "ok"
            ]
            _audit(connection, audit, problems)
        except (sqlite3.Error, UnicodeDecodeError) as error:  # say so, and what came before
            problems.append(f"database: {error}")
    audit.end()
    problems += audit.problems
    if len(problems) > MAX_PROBLEMS:
        problems[MAX_PROBLEMS:] = [f"and {len(problems) - MAX_PROBLEMS} more"]
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


def _audit(connection: sqlite3.Connection, audit: Audit, problems: list[str]) -> None:
    for number, row, fault in judged_rows(connection):
        if fault:
            problems.append(fault)
        try:
            audit.take(from_row(row))
        except RunFileError as error:
            problems.append(f"event {number}: {error}")
