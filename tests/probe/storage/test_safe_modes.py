"""The safe modes of a run file are demanded of SQLite and read back; only one process writes it."""

import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from probe.core.errors import StoreError
from probe.storage.disk import make_safe
from probe.storage.writer import create_store

OTHER = """
import sys
from pathlib import Path
from probe.storage.writer import StoreError, reopen_store
try:
    reopen_store(Path(sys.argv[1]))
except StoreError as error:
    print(error)
"""


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


@pytest.mark.parametrize(
    ("question", "answer", "said"),
    [
        ("PRAGMA synchronous", 1, "does not write synchronously"),
        ("PRAGMA synchronous", 0, "does not write synchronously"),
        ("PRAGMA journal_mode = WAL", "delete", "no write-ahead log"),
    ],
)
def test_a_mode_that_sqlite_refuses_is_said(
    question: str, answer: object, said: str, tmp_path: Path
) -> None:
    connection: Any = Disobedient(tmp_path / "a.run", question, answer)
    with closing(connection), pytest.raises(StoreError, match=said):
        make_safe(connection, tmp_path / "a.run")


def test_the_log_is_moved_into_the_file_often(tmp_path: Path) -> None:
    with create_store(tmp_path / "a.run") as store:
        pages = store._connection.execute("PRAGMA wal_autocheckpoint").fetchone()[0]
    assert 0 < pages <= 1000  # 4 MB; SQLite's own default


def test_another_process_may_not_write_the_same_run(tmp_path: Path) -> None:
    path = tmp_path / "a.run"
    with create_store(path):
        command = [sys.executable, "-c", OTHER, str(path)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "another scan is writing this run" in done.stdout
