"""Where a press is, in words: x in a row, x and y at every station of a grid."""

from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any


def has_rows(y_mm: Iterable[float | None]) -> bool:
    """Whether the known y [mm] differ, to the micrometre: a grid, not one row."""
    return len({round(y, 3) for y in y_mm if y is not None and isfinite(y)}) > 1


def plans_rows(config: Mapping[str, Any]) -> bool:
    """Whether the stations of a run's configuration snapshot are a grid."""
    return has_rows(y_mm for _, _, y_mm in config.get("plan", {}).get("stations", ()))


def place_words(x_m: float, y_m: float, *, in_grid: bool) -> str:
    """``x = 12.0 mm, y = 1.5 mm``; y in a grid, and wherever it is not 0."""
    known = [("x", x_m)] if isfinite(x_m) else []
    if isfinite(y_m) and (in_grid or abs(y_m) > 1e-6):
        known.append(("y", y_m))
    return ", ".join(f"{axis} = {1e3 * at:.1f} mm" for axis, at in known) or "an unknown place"
