"""Tables that took long to solve, kept on disk under what they were solved from."""

import hashlib
import json
import os
from collections.abc import Callable, Collection
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

import numpy as np
import platformdirs

from sim_backend.arrays import Array


def table_file(folder: str, content: object) -> Path:
    """Where the table lies that depends on ``content``, as JSON writes it, and on our version."""
    text = json.dumps([content, version("palpate")], sort_keys=True)
    name = hashlib.sha256(text.encode()).hexdigest()[:24]
    return Path(platformdirs.user_cache_dir("palpate")) / folder / f"{name}.npz"


def kept_table(
    path: Path, names: Collection[str], make: Callable[[], dict[str, Array]]
) -> dict[str, Array]:
    """What ``make`` returns, arrays called ``names``: from ``path`` where a whole table lies there,
    else made now, and kept there if it can be."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as table:
            kept = dict(table)
        if kept.keys() == set(names):
            return kept
    except Exception:  # noqa: BLE001 - none yet, or garbled: zipfile and numpy raise a dozen kinds
        pass
    made = make()
    partial = path.with_suffix(f".{os.getpid()}.part.npz")  # two processes may make it at once
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("wb") as new:
            np.savez(new, **made)  # type: ignore[arg-type]
            os.fsync(new.fileno())  # else a power cut may leave the name without the content
        partial.replace(path)
    except OSError:  # a full disk, a home that takes nothing: minutes of solving are not lost to it
        with suppress(OSError):
            partial.unlink()
    return made
