"""Where stations are, by the plan and in words: x in a row, x and y in a grid."""

from collections.abc import Iterable, Mapping
from math import isfinite, nan
from typing import Any


def planned(config: Mapping[str, Any]) -> dict[int, tuple[float, float]]:
    """Where each station of the plan is: x, y [m], NaN where unknown; empty without a plan."""
    try:
        return {
            int(n): (_metres(x_mm), _metres(y_mm)) for n, x_mm, y_mm in config["plan"]["stations"]
        }
    except (KeyError, TypeError, ValueError):
        return {}


def _metres(length_mm: float | None) -> float:
    return nan if length_mm is None else 1e-3 * float(length_mm)


def has_rows(y_mm: Iterable[float | None]) -> bool:
    """Whether the known y [mm] differ, to the micrometre: a grid, not one row."""
    return len({round(y, 3) for y in y_mm if y is not None and isfinite(y)}) > 1


def plans_rows(config: Mapping[str, Any]) -> bool:
    """Whether the stations of a run's configuration snapshot are a grid."""
    return has_rows(1e3 * y_m for _, y_m in planned(config).values())


def place_words(x_m: float, y_m: float, *, in_grid: bool) -> str:
    """``x = 12.0 mm, y = 1.5 mm``; y in a grid, and wherever it is not 0."""
    known = [("x", x_m)] if isfinite(x_m) else []
    if isfinite(y_m) and (in_grid or abs(y_m) > 1e-6):
        known.append(("y", y_m))
    return ", ".join(f"{axis} = {1e3 * at:.1f} mm" for axis, at in known) or "an unknown place"
