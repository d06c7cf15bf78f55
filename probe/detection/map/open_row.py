"""A row that is not finished, or short: only what no further station could overturn is named."""

from collections.abc import Callable
from dataclasses import replace

from drivers.core.arrays import Array
from probe.detection.finding import LUMP, ObjectFinding
from probe.detection.map.bumps import least_height
from probe.detection.map.objects import objects_in
from probe.detection.map.pressed import Pressed
from probe.detection.map.row_shapes import surroundings, with_edges
from probe.detection.map.sideways import SQUEEZED
from probe.detection.repeats import MIN_NAMED, pitch_m

MIN_BEYOND = 3.0
"""Pitches between an object and the open end: a vessel raises the force two to either side, and
a bump's half width is up to 2.8."""
REASON = "the row is not finished: further stations may change this"
OR_BEYOND = "the row is not finished: this lies here or beyond the last station so far"


def open_objects(
    line: Pressed, pulse: float | None, false_alarm: float, end_x_m: float
) -> list[ObjectFinding]:
    """`objects_in` a row whose last station so far is at ``end_x_m``.

    Its level shows nothing before it has enough stations to tell a bump from the block's edge, nor
    what may be that edge: something at the first station that does not pulse. An object near the
    open end, and every one of a row that has fewer stations than show a bump beside what may
    follow, is undecided.
    """
    objects = objects_in(line, pulse, false_alarm, with_edges(line.x_m))
    pitch = pitch_m(line.x_m) if len(line.x_m) > 1 else 0.0
    short = len(line.x_m) < MIN_NAMED
    begin_m, end_m = sorted(line.x_m[[0, -1]].tolist(), key=lambda x: -abs(x - end_x_m))
    settled = []
    for thing in objects:
        if pulse is None and begin_m in thing.position_ci_m:
            continue
        kept = replace(thing, position_ci_m=_towards(end_m, thing.position_ci_m, line))
        near = short or abs(thing.position_m - end_m) < MIN_BEYOND * pitch
        reason = OR_BEYOND if end_m in kept.position_ci_m else REASON
        settled.append(kept.undecided(reason) if near else kept)
    return settled


def _towards(end_m: float, ends_m: tuple[float, float], line: Pressed) -> tuple[float, float]:
    """An interval that also holds if the block goes on beyond the open end: its middle, to which
    what is squeezed aside belongs, may then lie there."""
    low, high = ends_m
    aside = SQUEEZED * line.depth_m
    if end_m == line.x_m[-1]:
        return low, min(high + aside, end_m)
    return max(low - aside, end_m), high


def only_pulses(objects: list[ObjectFinding], line: Pressed) -> list[ObjectFinding]:
    """``objects`` of a finished row. In one of fewer than `MIN_NAMED` stations a lump cannot be
    distinguished from a block's end or from the flank of what lies beyond, and is undecided."""
    count = len(line.x_m)
    if count >= MIN_NAMED:
        return objects
    reason = (
        f"{count} stations do not show whether this is a lump or what lies beyond their ends: "
        "a longer row does"
    )
    return [thing.undecided(reason) if thing.kind == LUMP else thing for thing in objects]


def least_bump_pa(
    line: Pressed, false_alarm: float, under: Callable[[Array], Array] = surroundings
) -> float:
    """The bump of the level map that most such rows would show; infinite where none could."""
    return least_height(line.levels(under(line.x_m)), false_alarm / 2)
