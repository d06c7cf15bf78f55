"""A row that is not finished, or short: only what no further station could overturn is named."""

from dataclasses import replace

import numpy as np

from probe.detection.finding import ObjectFinding
from probe.detection.map.bumps import (
    MIN_STATIONS,
    evenness,
    find_bumps,
    least_height,
    level_of,
    surroundings,
)
from probe.detection.map.row_objects import NORMAL_95, Line

MIN_BEYOND = 3.0
"""Pitches between an object and the open end: a vessel is felt two to either side, and a bump's
half width is up to 2.8."""
MIN_NAMED = MIN_STATIONS + int(MIN_BEYOND)
"""Stations that show a bump beside what may follow."""
LUMP_SHARE = 0.11
"""What a lump adds to the level at its middle: the built-in scene TIT, 9094 over 8187 Pa."""
DOUBT = 0.05
"""Chance below which a bump that is no finding yet is no reason to say "nothing" either."""
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
        "a longer row does"
    )
    return [
        replace(one, kind="undecided", reason=reason) if one.kind == "tumour" else one
        for one in objects
    ]


def least_bump_pa(line: Line, false_alarm: float) -> float:
    """The bump of the level map that most such rows would show; infinite where none could."""
    base = surroundings(line.x_m)
    return least_height(line.x_m, line.level_pa, line.level_sd_pa, base, false_alarm / 2)


def doubtful(lines: list[Line], least_pa: list[float]) -> list[ObjectFinding]:
    """Of finished rows without an object: what a lump could be, undecided, where a row would not
    show one (`LUMP_SHARE`). ``least_pa``: each row's `least_bump_pa`.

    That is a bump with a chance below `DOUBT`, or, in a row that is more uneven than its presses
    scatter, one as high as a lump: several lumps look like a scatter of each other.
    """
    found = []
    for line, least in zip(lines, least_pa, strict=True):
        lump_pa = LUMP_SHARE * level_of(line.level_pa)
        if not least > lump_pa:
            continue
        row = line.x_m, line.level_pa, line.level_sd_pa, surroundings(line.x_m)
        chance = DOUBT / len(lines)
        uneven = evenness(*row) < chance
        for bump in find_bumps(*row, false_alarm=1.0, most=1).bumps:
            clear = abs(bump.height) > max(lump_pa, NORMAL_95 * bump.height_sd)
            if bump.p_value > chance and not (uneven and clear):
                continue
            at = int(np.argmin(np.abs(line.x_m - bump.x_m)))
            low, high = np.clip((bump.x_low_m, bump.x_high_m), line.x_m[0], line.x_m[-1])
            word = "stiffer" if bump.height > 0 else "softer"
            found.append(ObjectFinding(
                "undecided", bump.x_m, (float(low), float(high)), bump.height,
                float(line.pulse_pa[at]), 0.0,
                f"no pulse; {abs(bump.height):.0f} Pa {word}, which {len(line.x_m)} stations "
                "cannot tell from a curved surface, a block's end or presses that differ: "
                "a longer row can",
            ))  # fmt: skip
    return found
