"""Databases that are closed: ``with connection`` alone commits and leaves them open."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def opened(path: str | Path, **options: Any) -> Iterator[sqlite3.Connection]:
    """A connection within, committed and closed at the end."""
    with closing(sqlite3.connect(path, **options)) as connection, connection:
        yield connection
