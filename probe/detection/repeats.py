"""Which stations of a row are repeats at one place, and how far its places lie from each other."""

import numpy as np

from drivers.core.arrays import Array, Ints
from probe.core.places import SAME_PLACE_M

MIN_NAMED = 9
"""Stations of a row that names what it holds: a level with its two edges and a bump have eight
unknowns. The one number that a person is told."""
REPEATS = 0.1
"""Of the pitch: stations as near as that are repeats, as are those within `SAME_PLACE_M`."""


def places_of(x_m: Array) -> Ints:
    """The place (n,) of each station at ``x_m`` (n,), finite and in any order: 0 is the lowest."""
    order = np.argsort(x_m, kind="stable")
    gaps = np.diff(x_m[order])
    pitches = gaps[gaps > SAME_PLACE_M]
    least_m = max(REPEATS * _usual_m(pitches), SAME_PLACE_M) if len(pitches) else np.inf
    place = np.empty(len(x_m), dtype=int)
    place[order] = np.concatenate([[0], np.cumsum(gaps > least_m)])[: len(x_m)]
    return place


def distinct_m(x_m: Array) -> Array:
    """The places (k,) of stations at ``x_m`` (n,), ascending; unknown ones are left out."""
    known = x_m[np.isfinite(x_m)]
    if not len(known):
        return known
    place = places_of(known)
    return np.asarray(np.bincount(place, weights=known) / np.bincount(place))


def pitch_m(x_m: Array) -> float:
    """The usual distance from one place to the next; NaN where there is only one."""
    places_m = distinct_m(x_m)
    return _usual_m(np.diff(places_m)) if len(places_m) > 1 else float("nan")


def _usual_m(gaps_m: Array) -> float:
    """The median, each gap weighted by the square root of its length. By number alone, the gaps
    within clusters of stations decide, which say nothing about what the row can show; by length, a
    single hole does."""
    longest = np.sort(gaps_m)[::-1]
    weight = np.cumsum(np.sqrt(longest))
    return float(longest[np.searchsorted(weight, weight[-1] / 2)])
