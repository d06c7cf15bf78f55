"""A row that is not finished, or short: only what no further station could overturn is named."""

from dataclasses import replace

import numpy as np

from probe.detection.finding import ObjectFinding
from probe.detection.map.bumps import MIN_STATIONS
from probe.detection.map.row_objects import Line

MIN_BEYOND = 3.0
"""Pitches between an object and the open end: a vessel is felt two to either side, and a bump's
half width is up to 2.8."""
MIN_NAMED = MIN_STATIONS + int(MIN_BEYOND)
"""Stations that show a bump beside what may follow."""
REASON = "the row is not finished: further stations may change this"


def only_settled(objects: list[ObjectFinding], line: Line, end_x_m: float) -> list[ObjectFinding]:
    """``objects`` of a row whose last station so far is at ``end_x_m``.

    An object near the open end, and every one of a row that has fewer stations than show a bump
    beside what may follow, is undecided.
    """
    pitch = float(np.median(np.diff(line.x_m))) if len(line.x_m) > 1 else 0.0
    short = len(line.x_m) < MIN_NAMED
    return [
        replace(one, kind="undecided", reason=REASON)
        if short or abs(one.position_m - end_x_m) < MIN_BEYOND * pitch
        else one
        for one in objects
    ]


def only_pulses(objects: list[ObjectFinding], line: Line) -> list[ObjectFinding]:
    """``objects`` of a finished row. In one of fewer than `MIN_NAMED` stations a lump cannot be
    told from a block's end or from the flank of what lies beyond, and is undecided."""
    count = len(line.x_m)
    if count >= MIN_NAMED:
        return objects
    reason = (
        f"{count} stations do not show whether this is a lump or what lies beyond their ends: "
        f"{MIN_NAMED} do"
    )
    return [
        replace(one, kind="undecided", reason=reason) if one.kind == "tumour" else one
        for one in objects
    ]
