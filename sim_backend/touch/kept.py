"""Where touch tables lie: those that come with palpate, and those that were made here."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import platformdirs

from sim_backend.scene.scene_file import Scene
from sim_backend.touch.table import TouchTable, about_block

SHIPPED = Path(__file__).with_name("tables")
KEPT = Path(platformdirs.user_cache_dir("palpate")) / "touch"
SAME = 1e-3
"""Of a ratio of lengths: tables that differ by less are one."""


@lru_cache
def table_for(block: Scene) -> TouchTable | None:
    """The table of a scene's finger and block, if there is one: shipped, or made and kept here."""
    wanted = about_block(block)
    for path in (*SHIPPED.glob("*.npz"), *KEPT.glob("*.npz")):
        try:
            table = TouchTable.load(path)
        except (OSError, ValueError, KeyError):  # garbled, or another version's
            continue
        if _alike(table.about, wanted):
            return table
    return None


def _alike(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    def same(a: Any, b: Any) -> bool:
        return abs(a - b) <= SAME * abs(b) if isinstance(b, float) else bool(a == b)

    return one.keys() == other.keys() and all(same(one[key], other[key]) for key in other)
