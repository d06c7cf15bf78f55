"""Rivals of a spot in a map of presses at any places: a step, or a ridge across it."""

import numpy as np

from drivers.core.arrays import Array
from probe.detection.map.bumps import TRUSTED, chance
from probe.detection.map.field import SPOT_UNKNOWNS, Map, Spot, weighted
from probe.detection.map.row_rivals import least_left, odds_instead, rises_anywhere
from probe.detection.map.row_shapes import explained, shape, step

DIRECTIONS = 24
"""In which a rival is tried, over half a turn: none is more than 3.8 degrees off, which moves it by
a quarter of the distance between presses at the rim of a map that is eight of them wide."""
WIDE = 4
"""Directions that differ by less than a ridge's width shows: a twelfth of half a turn each."""


def odds_of_a_straight_rise(seen: Map, spots: list[Spot], spot: Spot) -> float:
    """Odds that the map is higher on one side, as over a bone's edge, or along a straight line, as
    over a bone itself, instead of ``spot``, one of its ``spots``, or of all of them. Either has as
    many unknowns as a spot."""
    known = [np.append(one.place_m, one.half_width_m) for one in spots]
    rest = [k for k, one in zip(known, spots, strict=True) if one is not spot]
    *_, left = weighted(seen, known)
    rss, count = float(left @ left), len(seen.value)
    dof = max(count - seen.base.shape[1] - SPOT_UNKNOWNS * len(known), 1)
    beside = []
    for others in (rest, []):
        _, a, _, left = weighted(seen, others)
        beside.append((a, left, SPOT_UNKNOWNS * (len(rest) - len(others))))
    fits = []
    for one in _along(seen).T:  # a direction at a time: of a large map all take a gigabyte
        for rise in (step, shape):  # of a bone that a corner cuts short its end is as a spot
            columns = rises_anywhere(one, seen.spacing_m, rise) / seen.sd[:, None]
            fits += [(least_left(a, left, columns), fewer) for a, left, fewer in beside]
    return odds_instead(fits, rss, (rss + TRUSTED) / (dof + TRUSTED), count)


def straight_rise(seen: Map) -> tuple[float, float]:
    """The chance of a step or ridge as clear as the clearest anywhere in a map that has none, and
    its height, negative where it is a furrow."""
    _, a, _, left = weighted(seen, [])
    before, most, rise_pa = float(left @ left), 0.0, 0.0
    for along_m in _along(seen).T:
        for form in (shape, step):
            columns = rises_anywhere(along_m, seen.spacing_m, form)[:, :, 0].T
            drop, height = explained(a, left, columns / seen.sd[:, None])
            if drop.max() > most:
                k = int(np.argmax(drop))
                most, rise_pa = float(drop[k]), float(height[k] * np.ptp(columns[:, k]))
    lines = DIRECTIONS / WIDE * seen.span_m / seen.spacing_m
    dof = len(seen.value) - seen.base.shape[1]
    return chance(before, before - most, SPOT_UNKNOWNS, dof, 2 * lines), rise_pa


def _along(seen: Map) -> Array:
    """How far presses lie along each of `DIRECTIONS` (n, directions) [m]."""
    turns = np.pi / DIRECTIONS * np.arange(DIRECTIONS)
    return np.asarray(seen.place_m @ np.array([np.cos(turns), np.sin(turns)]))
