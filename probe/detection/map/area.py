"""Presses at any places (x, y), which form no rows: how far apart they are, and what is under."""

import numpy as np
from scipy.spatial import Delaunay, QhullError, cKDTree

from drivers.core.arrays import Array, Bools
from probe.core.places import SAME_PLACE_M
from probe.detection.map.row_shapes import CURVATURE, level_of
from probe.detection.map.seen_map import Map

MIN_PRESSES = 15
"""Places that can show a bump (four unknowns) apart from a curved background (six)."""
WITHIN = 0.999
"""A point on the edge, drawn in by the rest, is inside for whatever rounding does."""
NARROW = 2.0
"""Distances between presses that a map must be wide in both directions, or it is a line."""


def spacing_m(place_m: Array) -> float:
    """The usual distance from one press (n, 2) to the next, repeats aside; 0 where all lie on a
    line."""
    repeats = cKDTree(place_m).query_pairs(SAME_PLACE_M, output_type="ndarray")
    places = np.delete(place_m, repeats[:, 1], axis=0)
    if len(places) < MIN_PRESSES:
        return 0.0
    usual = float(np.median(np.asarray(cKDTree(places).query(places, k=2)[0])[:, 1]))
    across = np.sqrt(12 * np.linalg.eigvalsh(np.atleast_2d(np.cov(places.T))).min())
    return usual if across >= NARROW * usual else 0.0


def map_of(place_m: Array, value: Array, sd: Array, *, curved: bool = True) -> Map:
    """A map over a level that is tilted and ``curved``, or else the same everywhere."""
    widest_m = float((place_m.max(axis=0) - place_m.min(axis=0)).max())
    u = (place_m - place_m.mean(axis=0)) / widest_m
    one, x, y = np.ones(len(u)), u[:, 0], u[:, 1]
    columns = np.column_stack([one, x, y, x * x, x * y, y * y] if curved else [one])
    weight = np.array([0.0, 0.0, 0.0, *[1 / CURVATURE] * 3])[: columns.shape[1]]
    return Map(place_m, value, sd, columns, weight / level_of(value), spacing_m(place_m))


def among(point_m: Array, place_m: Array) -> Bools:
    """Which points (k, 2) lie among presses (n, 2), edges included: (k,), none if those lie on a
    line."""
    try:
        hull = Delaunay(place_m)
    except QhullError:
        return np.zeros(len(point_m), dtype=bool)
    middle_m = place_m.mean(axis=0)
    return np.asarray(hull.find_simplex(middle_m + WITHIN * (point_m - middle_m)) >= 0)
