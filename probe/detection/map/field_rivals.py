"""Rivals of a spot in a map of presses at any places: a step, or a ridge across it."""

import numpy as np

from probe.detection.map.bumps import TRUSTED
from probe.detection.map.field import SPOT_UNKNOWNS, Map, Spot, weighted
from probe.detection.map.row_rivals import least_left, odds_instead, rises_anywhere
from probe.detection.map.row_shapes import shape, step

DIRECTIONS = 24
"""In which a rival is tried, over half a turn: none is more than 3.8 degrees off, which moves it by
a quarter of the distance between presses at the rim of a map that is eight of them wide."""


def odds_of_a_straight_rise(seen: Map, spots: list[Spot], spot: Spot) -> float:
    """Odds that the map is higher on one side, as over a bone's edge, or along a straight line, as
    over a bone itself, instead of ``spot``, one of its ``spots``, or of all of them. Either has as
    many unknowns as a spot."""
    known = [np.append(one.place_m, one.half_width_m) for one in spots]
    rest = [k for k, one in zip(known, spots, strict=True) if one is not spot]
    *_, left = weighted(seen, known)
    rss, count = float(left @ left), len(seen.value)
    dof = max(count - seen.base.shape[1] - SPOT_UNKNOWNS * len(known), 1)
    turns = np.pi / DIRECTIONS * np.arange(DIRECTIONS)
    along_m = seen.place_m @ np.array([np.cos(turns), np.sin(turns)])
    beside = []
    for others in (rest, []):
        _, a, _, left = weighted(seen, others)
        beside.append((a, left, SPOT_UNKNOWNS * (len(rest) - len(others))))
    fits = []
    for one in along_m.T:  # a direction at a time: of a large map all take a gigabyte
        for rise in (step, shape):  # of a bone that a corner cuts short its end is as a spot
            columns = rises_anywhere(one, seen.spacing_m, rise) / seen.sd[:, None]
            fits += [(least_left(a, left, columns), fewer) for a, left, fewer in beside]
    return odds_instead(fits, rss, (rss + TRUSTED) / (dof + TRUSTED), count)
