"""Tables that took long to solve, kept on disk under what they were solved from."""

import hashlib
import json
import os
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import platformdirs

from sim_backend.arrays import Array


def table_file(folder: str, content: object) -> Path:
    """Where the table lies that depends on ``content``, as JSON writes it, and on our version."""
    text = json.dumps([content, version("palpate")], sort_keys=True)
    name = hashlib.sha256(text.encode()).hexdigest()[:24]
    return Path(platformdirs.user_cache_dir("palpate")) / folder / f"{name}.npz"


def kept_table(path: Path, make: Callable[[], dict[str, Array]]) -> dict[str, Array]:
    """What ``make`` returns, from ``path`` where it was made before; kept there if it can be."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as table:
            return dict(table)
    except (OSError, ValueError, KeyError, BadZipFile):
        pass  # not made yet, or cut short while it was written
    made = make()
    partial = path.with_suffix(f".{os.getpid()}.part.npz")  # two processes may make it at once
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(partial, **made)  # type: ignore[arg-type]
        partial.replace(path)
    except OSError:  # a full disk, a home that takes nothing: minutes of solving are not lost to it
        with suppress(OSError):
            partial.unlink()
    return made
