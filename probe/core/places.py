"""Where stations are, by the plan and in words: x in a row, x and y in a grid."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from math import isfinite, nan
from typing import Any

SAME_PLACE_M = 50e-6
"""As near as this two stations are at one place, and two rows one: five times what a stage comes
back to a place by (`probe.detection.pulse.presses.REPEATABILITY_M`), less than probes resolve."""


def planned(config: Mapping[str, Any]) -> dict[int, tuple[float, float]]:
    """Where each station of the plan is: x, y [m], NaN where unknown; empty without a plan."""
    try:
        return {
            int(n): (_metres(x_mm), _metres(y_mm)) for n, x_mm, y_mm in config["plan"]["stations"]
        }
    except (KeyError, TypeError, ValueError):
        return {}


def presses_all(config: Mapping[str, Any]) -> bool:
    """Whether a whole scan presses every station; else a planner may leave out some."""
    try:
        return bool(config["rig"]["scan"].get("planner", "raster") == "raster")
    except (KeyError, TypeError, AttributeError):
        return True  # of an older run, an import, or one without a rig


def _metres(length_mm: float | None) -> float:
    return nan if length_mm is None else 1e-3 * float(length_mm)


def has_rows(y_mm: Iterable[float | None]) -> bool:
    """Whether the known y [mm] are those of several rows: a grid, not one row."""
    known = [1e-3 * y for y in y_mm if y is not None]
    return len(set(rows_of(known)) - {None}) > 1


def rows_of(y_m: Sequence[float]) -> list[int | None]:
    """The row of each y [m], counted from the lowest; None where y is unknown.

    A row ends where the next y is more than `SAME_PLACE_M` away: a robot comes back to the same y
    to within a few micrometres only, wherever that y lies.
    """
    known = sorted({y for y in y_m if isfinite(y)})
    row = dict.fromkeys(known[:1], 0)
    for below, above in pairwise(known):
        row[above] = row[below] + (above - below > SAME_PLACE_M)
    return [row.get(y) for y in y_m]


def plans_rows(config: Mapping[str, Any]) -> bool:
    """Whether the stations of a run's configuration snapshot are a grid."""
    return has_rows(1e3 * y_m for _, y_m in planned(config).values())


def place_words(x_m: float, y_m: float, *, in_grid: bool) -> str:
    """``x = 12.0 mm, y = 1.5 mm``; y in a grid, and wherever it is not 0."""
    known = [("x", x_m)] if isfinite(x_m) else []
    if isfinite(y_m) and (in_grid or abs(y_m) > 1e-6):
        known.append(("y", y_m))
    return ", ".join(f"{axis} = {1e3 * at:.1f} mm" for axis, at in known) or "an unknown place"
