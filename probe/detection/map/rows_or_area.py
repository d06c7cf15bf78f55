"""Whether a scan is judged row by row, or its presses as an area."""

from collections.abc import Sequence

import numpy as np

from probe.core.false_alarm import DEFAULT_FALSE_ALARM
from probe.core.recording import Station
from probe.detection.map.area import MIN_PRESSES, spacing_m
from probe.detection.map.bumps import MIN_STATIONS
from probe.detection.map.objects import beating
from probe.detection.map.pressed import over_area
from probe.detection.map.ridge import find_ridge
from probe.detection.map.vessel_tracking import MAX_STRAY_PITCHES
from probe.detection.pulse.presses import Press
from probe.detection.repeats import distinct_m

MIN_ROWS = 3
"""Rows that show which way a line goes: through a bump in each of two there is always one."""


def is_area(stations: Sequence[Station], rows: list[list[int]]) -> bool:
    """Whether the stations in ``rows`` are a map without rows: most lie in none that could show a
    bump, and together they cover an area."""
    every = [
        i for row in rows for i in row if np.isfinite([stations[i].x_m, stations[i].y_m]).all()
    ]
    in_rows = sum(
        len(row) for row in rows
        if len(distinct_m(np.array([stations[i].x_m for i in row]))) >= MIN_STATIONS
    )  # fmt: skip
    place_m = np.array([(stations[i].x_m, stations[i].y_m) for i in every]).reshape(-1, 2)
    return 2 * in_rows < len(every) and spacing_m(place_m) > 0


def runs_along_rows(presses: Sequence[Press], pitch_m: float) -> bool:
    """Whether a vessel runs so much along the rows of a grid that no row shows it as a bump, or it
    is too far aside in the next row: rows are then presses at any places. ``pitch_m`` is the rows'
    own."""
    area = over_area(presses)
    y_m = distinct_m(area.place_m[:, 1])
    if len(area.level_pa) < MIN_PRESSES or len(y_m) < MIN_ROWS:
        return False
    ridge = find_ridge(area.pulses(), beating(area, DEFAULT_FALSE_ALARM))
    if ridge is None:
        return False
    aside_m = float(np.median(np.diff(y_m))) / max(abs(np.tan(ridge.angle_rad)), 1e-9)
    return bool(aside_m > MAX_STRAY_PITCHES * pitch_m)
