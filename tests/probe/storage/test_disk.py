"""Which file system a run lies on, and which of its modes SQLite obeys there."""

import errno
import os
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import probe.storage.disk
from probe.storage.writer import StoreError, create_store


@pytest.mark.parametrize("kind", ["nfs4", "cifs", "9p", "fuse.sshfs"])
def test_network_file_systems_are_refused(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(probe.storage.disk, "file_system", lambda _path: kind)
    with pytest.raises(StoreError, match=rf"network file system \({kind}\).*local disk"):
        create_store(tmp_path / "a.run")
    assert not (tmp_path / "a.run").exists()


def test_the_file_system_of_a_path_is_known() -> None:
    assert probe.storage.disk.file_system(Path("/proc/self")) == "proc"


def test_a_network_folder_with_a_space_in_its_name_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mounts = tmp_path / "mounts"
    mounts.write_bytes(b"/dev/sda / ext4 rw 0 0\nnas:/x /mnt/Our\\040\xc3\xa4ther nfs4 rw 0 0\n")
    monkeypatch.setattr(probe.storage.disk, "MOUNTS", mounts)
    assert probe.storage.disk.file_system(Path("/mnt/Our äther/a.run")) == "nfs4"
    assert probe.storage.disk.file_system(Path("/mnt/Our/a.run")) == "ext4"


@pytest.mark.parametrize("number, words", [
    (errno.EROFS, "read-only file system; name a place that you may write to"),
    (errno.EACCES, "permission denied; name a place that you may write to"),
    (errno.ENAMETOOLONG, "file name too long"),
    (errno.ENOSPC, "the disk is full (no space left on device); everything committed before"),
])  # fmt: skip
def test_why_a_run_cannot_be_written_is_said_whatever_its_folder_is_called(
    number: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "full" / "a.run"

    def refused(file: Path) -> int:
        raise OSError(number, os.strerror(number), str(file))

    monkeypatch.setattr(probe.storage.disk, "hold", refused)
    with pytest.raises(StoreError) as said:
        create_store(path)
    assert str(said.value).startswith(f"{path}: {words}")
    assert "Errno" not in str(said.value)


class Disobedient:
    """A connection that answers one question as an SQLite would that refused a mode."""

    def __init__(self, path: Path, question: str, answer: object) -> None:
        self._connection = sqlite3.connect(path)
        self.close = self._connection.close
        self._question, self._answer = question, answer

    def execute(self, statement: str) -> Any:
        if statement == self._question:
            return self._connection.execute("SELECT ?", (self._answer,))
        return self._connection.execute(statement)


@pytest.mark.parametrize("question, answer, said", [
    ("PRAGMA synchronous", 1, "does not write synchronously"),
    ("PRAGMA synchronous", 0, "does not write synchronously"),
    ("PRAGMA journal_mode = WAL", "delete", "no write-ahead log"),
])  # fmt: skip
def test_a_mode_that_sqlite_refuses_is_said(
    question: str, answer: object, said: str, tmp_path: Path
) -> None:
    connection: Any = Disobedient(tmp_path / "a.run", question, answer)
    with closing(connection), pytest.raises(StoreError, match=said):
        probe.storage.disk.make_safe(connection, tmp_path / "a.run")
