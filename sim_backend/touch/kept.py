"""Where touch tables lie: those that come with palpate, and those that were made here."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import platformdirs

from sim_backend.scene.scene_file import Scene
from sim_backend.touch.table import TouchTable, about_finger

SHIPPED = Path(__file__).with_name("tables")
KEPT = Path(platformdirs.user_cache_dir("palpate")) / "touch"
SAME = 1e-3
"""Of a ratio of lengths: tables that differ by less are one."""


def tables() -> Iterator[tuple[Path, TouchTable]]:
    """All that there are, with their files."""
    for path in (*SHIPPED.glob("*.npz"), *KEPT.glob("*.npz")):
        with suppress(OSError, ValueError, KeyError):  # garbled, or another version's
            yield path, TouchTable.load(path)


@lru_cache
def table_for(scene: Scene) -> TouchTable | None:
    """The table of a scene's finger and support, if there is one: shipped, or made and kept
    here."""
    wanted = about_finger(scene)
    return next((table for _, table in tables() if _alike(table.about, wanted)), None)


def kept_as(table: TouchTable) -> Path:
    """Keep a table for this user, and where. Raises OSError."""
    KEPT.mkdir(parents=True, exist_ok=True)
    path = KEPT / f"{'-'.join(str(value) for value in table.about.values())}.npz"
    table.save(path)
    table_for.cache_clear()
    return path


def _alike(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    def same(a: Any, b: Any) -> bool:
        return abs(a - b) <= SAME * abs(b) if isinstance(b, float) else bool(a == b)

    return one.keys() == other.keys() and all(same(one[key], other[key]) for key in other)
