"""What is stiff along a straight line: a bone, a tendon or a band, or a lump that is long."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from probe.core.finding_words import percent
from probe.detection.classify.classifier import ELSE, MIN_POSTERIOR, PRIOR
from probe.detection.finding import ObjectFinding, stated
from probe.detection.map.bumps import MIN_DISTANCE
from probe.detection.map.field import Map, find_spots
from probe.detection.map.field_rivals import odds_of_a_straight_rise, straight_rise
from probe.detection.map.open_row import LUMP_SHARE
from probe.detection.map.row_shapes import level_of
from probe.detection.pulse.presses import Press

MIN_POINTS = 3
"""Of a course: two are always on a line."""
ELSE_OF_A_LINE = PRIOR[ELSE] / (PRIOR[ELSE] + PRIOR["tumour"])
"""Of what is as stiff from one edge of a map to the other, and does not pulse."""


def unnamed_line(judged: Sequence[Press], levels: Map, false_alarm: float) -> list[ObjectFinding]:
    """What is as high as a lump in a map without spots, but straight, undecided."""
    chance, height_pa = straight_rise(levels) if levels.spacing_m > 0 else (1.0, 0.0)
    if chance > false_alarm or abs(height_pa) < LUMP_SHARE * level_of(levels.value):
        return []
    x_m, word = levels.place_m[:, 0], "stiffer" if height_pa > 0 else "softer"
    return [ObjectFinding(
        "undecided", float(np.median(x_m)), (float(x_m.min()), float(x_m.max())), height_pa,
        float(np.median([p.size_pa for p in judged])), 0.0,
        f"no pulse; {abs(height_pa):.0f} Pa {word} along a straight line or on one side of it, as "
        "over a bone, a tendon or a step of the surface: press as deep from where the surface is "
        "at each station, and farther to all sides",
    )]  # fmt: skip


def or_a_line(named: list[ObjectFinding], levels: Map, false_alarm: float) -> list[ObjectFinding]:
    """The lumps of a grid in which nothing pulses, or where a straight line right across the map
    explains its ``levels`` better, what that may be: one object, undecided."""
    points_m = np.array([place for one in named for place in one.course])
    if (
        levels.spacing_m <= 0 or len(points_m) < MIN_POINTS
        or all(one.kind == "undecided" for one in named)
    ):  # fmt: skip
        return named
    off_m = points_m - points_m.mean(axis=0)
    aside_m = off_m @ np.linalg.svd(off_m, full_matrices=False)[2][1]
    if np.abs(aside_m).max() > MIN_DISTANCE * levels.spacing_m:
        return named
    if spots := find_spots(levels, false_alarm):
        odds = odds_of_a_straight_rise(levels, spots, spots[0])
        line = odds / (1 + odds)
    else:
        line = float(straight_rise(levels)[0] <= false_alarm)
    clearest = max(named, key=lambda one: one.confidence)
    confidence = clearest.confidence * (1 - ELSE_OF_A_LINE * line)
    if confidence >= MIN_POSTERIOR:
        return named
    ends_m = [end for one in named for end in one.position_ci_m]
    return [replace(
        clearest, kind="undecided", confidence=stated(confidence),
        position_m=float(np.median(points_m[:, 0])), position_ci_m=(min(ends_m), max(ends_m)),
        course=tuple((float(x), float(y)) for x, y in points_m[np.argsort(points_m[:, 1])]),
        reason=f"between tumour {percent(stated(confidence))} and a bone, a tendon or a band: as "
        "stiff along a straight line from edge to edge of the map; press farther along it, where a "
        "lump ends",
    )]  # fmt: skip
