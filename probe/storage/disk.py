"""Opening a run file for writing: on a local disk, with every safe mode on, by one writer only."""

import errno
import os
import re
import shutil
import sqlite3
from contextlib import ExitStack
from pathlib import Path

from probe.core.errors import RunFileError, StoreError
from probe.storage.lock import hold, release
from probe.storage.log import unreadable_frames
from probe.storage.reader import NOTHING_YET, log_of
from probe.storage.schema import (
    BUSY_S,
    VERSION,
    broken_seal,
    create,
    last_event,
    migrate,
    unseal,
    version_of,
)

# File systems whose shared memory other machines do not see: a write-ahead log breaks on them.
NETWORK = (
    "9p", "afs", "ceph", "cifs", "davfs", "glusterfs", "lustre", "nfs", "smb", "vboxsf",
    "fuse.davfs", "fuse.gvfs", "fuse.glusterfs", "fuse.rclone", "fuse.s3fs", "fuse.sshfs",
)  # fmt: skip
MOUNTS = Path("/proc/mounts")
NOT_OURS = (errno.EACCES, errno.EPERM, errno.EROFS)
# A run that another program cuts short is rescued from memory: an hour of 500 readings a second.
MEMORY_KIB = 65536
LOG_PAGES = 100  # moved into the file often: little is missing if someone copies it without its log


def open_safely(path: Path, *, new: bool) -> tuple[sqlite3.Connection, int]:
    """A connection in the safe modes, and the lock: a descriptor to close after the connection.

    An older file is brought up to date. Raises `StoreError`, and `RunFileError` for another file or
    one whose last events are lost.
    """
    kind = file_system(path)
    if kind.startswith(NETWORK):
        raise StoreError(
            f"{path}: lies on a network file system ({kind}), where a run is not safe; "
            f"store it on a local disk and copy it afterwards"
        )
    try:
        with ExitStack() as undo:
            lock = hold(path)
            undo.callback(release, lock)
            connection = sqlite3.connect(
                path, timeout=BUSY_S, isolation_level=None, check_same_thread=False
            )
            undo.callback(connection.close)
            if not new:
                _keep_damaged(log_of(path))
            make_safe(connection, path)
            if new:
                create(connection)
            else:
                if (version := version_of(connection)) == 0:
                    raise RunFileError(NOTHING_YET)
                if version < VERSION:
                    migrate(connection)
                _check_seal(connection)
            unseal(connection)
            undo.pop_all()
    except RunFileError as error:
        raise RunFileError(f"{path}: {error}") from None
    except (sqlite3.OperationalError, OSError) as error:
        raise StoreError(f"{path}: {explain(error)}") from None
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise RunFileError(f"{path}: damaged or not a run file ({error})") from None
    return connection, lock


def _check_seal(connection: sqlite3.Connection) -> None:
    """Raises `RunFileError` where the end is lost: what is added would be sealed as if it were not.

    A run that has no seal was killed, and goes on with what its log kept.
    """
    if why := broken_seal(connection, *last_event(connection)):
        raise RunFileError(
            f"{why}; nothing is added to a run whose end is lost: begin a new scan, and "
            "`palpate detect` reads what is left of this one"
        )


def make_safe(connection: sqlite3.Connection, path: Path) -> None:
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
    connection.execute(f"PRAGMA wal_autocheckpoint = {LOG_PAGES}")
    connection.execute(f"PRAGMA cache_size = {-MEMORY_KIB}")


def file_system(path: Path) -> str:
    """The type of the file system that ``path`` is on; empty where that is not known."""
    try:
        lines = MOUNTS.read_bytes().splitlines()
    except OSError:
        return ""
    where = path.resolve()
    mounts = [[_unescaped(part) for part in line.split()[1:3]] for line in lines]
    found = [(len(m), n, kind) for n, (m, kind) in enumerate(mounts) if where.is_relative_to(m)]
    return max(found, default=(0, 0, ""))[2]


def _unescaped(part: bytes) -> str:
    """The kernel writes space, tab, newline and backslash as octal numbers: proc(5), fstab(5)."""
    return os.fsdecode(re.sub(rb"\\([0-7]{3})", lambda m: bytes([int(m[1], 8)]), part))


def explain(error: Exception) -> str:
    """What an error of SQLite or the system means to whoever scans."""
    number = getattr(error, "errno", None)
    text = (number and os.strerror(number).lower()) or str(error)  # the file is named already
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if number == errno.ENOSPC or code == sqlite3.SQLITE_FULL:
        return f"the disk is full ({text}); everything committed before is kept"
    if number in NOT_OURS or code == sqlite3.SQLITE_READONLY:
        return f"{text}; name a place that you may write to"
    return text


def _keep_damaged(log: Path) -> None:
    """A damaged log, which SQLite would overwrite, is kept for whoever can read more of it."""
    if log.exists() and unreadable_frames(log):
        shutil.copyfile(log, log.with_name(f"{log.name}-damaged"))
