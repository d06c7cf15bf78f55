"""A row that is not finished: only what no further station could overturn is named."""

from dataclasses import replace

import numpy as np

from probe.detection.finding import ObjectFinding
from probe.detection.map.bumps import MIN_STATIONS
from probe.detection.map.row_objects import Line

MIN_BEYOND = 3.0
"""Pitches between an object and the open end: a vessel is felt two to either side, and a bump's
half width is up to 2.8."""
REASON = "the row is not finished: further stations may change this"


def only_settled(objects: list[ObjectFinding], line: Line, end_x_m: float) -> list[ObjectFinding]:
    """``objects`` of a row whose last station so far is at ``end_x_m``.

    An object near the open end, and every one of a row that has fewer stations than show a bump
    beside what may follow, is undecided.
    """
    pitch = float(np.median(np.diff(line.x_m))) if len(line.x_m) > 1 else 0.0
    short = len(line.x_m) < MIN_STATIONS + MIN_BEYOND
    return [
        replace(one, kind="undecided", reason=REASON)
        if short or abs(one.position_m - end_x_m) < MIN_BEYOND * pitch
        else one
        for one in objects
    ]
