"""Whether what lies in a block has room there: within its sides, none over another."""

from itertools import pairwise
from math import hypot

import numpy as np

from sim_backend.arrays import Array
from sim_backend.scene.inclusion import Artery, Inclusion, Tumour

ALONG = np.linspace(0.0, 1.0, 65)
"""Shares of the way between two points of a path at which two oblique vessels are looked at: the
room between them bends one way only, so that what lies between is missed by a thousandth of it."""
TURNS = np.linspace(0.0, np.pi, 181)
"""Directions in which they may be apart [rad]: of a cut twice as long as wide a degree hides a
ten-thousandth."""


def need_room(
    inclusion: tuple[Inclusion, ...], width_mm: float, height_mm: float, *, solid: bool
) -> None:
    """Raise `ValueError` for what breaks the block's surface, bottom or sides, at its place or at
    a point of its path, and for two that overlap anywhere along z.

    In a solid a section cuts an oblique vessel in an ellipse, which reaches further than its radius
    (`sim_backend.fem.solid.courses`); a plane section's vessel is the round one that it shows.
    """
    for n, one in enumerate(inclusion):
        where = f"inclusion[{n}] ({one.kind})"
        path = one.path if isinstance(one, Artery) else ()
        r = one.outer_radius_mm
        points = [("", one.x_mm, one.depth_mm, r, r)]
        for k, (_, x_mm, depth_mm) in enumerate(path):
            leans = _leans(path)[max(k - 1, 0) : k + 1] if solid else np.zeros((1, 2))
            across, down = (r * np.sqrt(1 + (leans**2).max(axis=0))).tolist()
            points.append((f"path[{k}]: ", x_mm, depth_mm, across, down))
        for key, x_mm, depth_mm, across, down in points:
            if depth_mm - down <= 0:
                raise ValueError(
                    f"{where}: {key}depth_mm = {depth_mm:g} breaks the surface; "
                    f"it must be above {_reach_words(down, r)}"
                )
            if depth_mm + down >= height_mm:
                raise ValueError(
                    f"{where}: {key}depth_mm = {depth_mm:g} breaks the bottom; "
                    f"it must be below {height_mm - down:g}"
                )
            if not across < x_mm < width_mm - across:
                raise ValueError(
                    f"{where}: {key}x_mm = {x_mm:g} breaks a side; "
                    f"it must lie between {across:g} and {width_mm - across:g}"
                )
        for m, other in enumerate(inclusion[:n]):
            distance_mm, needed_mm = _nearest_mm(one, other, solid=solid)
            if distance_mm <= needed_mm:
                raise ValueError(
                    f"{where} overlaps inclusion[{m}]: centres are {distance_mm:.3g} mm apart; "
                    f"they must be more than {needed_mm:g} mm apart"
                )


def _reach_words(down_mm: float, radius_mm: float) -> str:
    if down_mm == radius_mm:
        return f"the outer radius {radius_mm:g}"
    return f"{down_mm:g}, what its oblique cut reaches"


def _leans(path: tuple[tuple[float, float, float], ...]) -> Array:
    """How far each part of a path (n - 1, 2) goes in x and in depth per length along z."""
    steps = np.diff(np.array(path), axis=0)
    return np.asarray(steps[:, 1:] / steps[:, :1]) if len(steps) else np.zeros((1, 2))


def _nearest_mm(one: Inclusion, other: Inclusion, *, solid: bool) -> tuple[float, float]:
    """The distance of the centres in the section where they are nearest to each other, and the one
    that is needed there; between the points of a path they move straight. Balls in a solid may lie
    behind each other."""
    round_mm = one.outer_radius_mm + other.outer_radius_mm
    paths = [i for i in (one, other) if isinstance(i, Artery) and i.path]
    knots = sorted({z for i in paths for z, _, _ in i.path} or {0.0})
    gaps = [np.subtract(one.centre_mm(z), other.centre_mm(z)) for z in knots]
    nearest_mm = min(float(np.linalg.norm(gap)) for gap in gaps)
    for first, last in pairwise(gaps):
        way = last - first
        share = np.clip(-(first @ way) / max(float(way @ way), 1e-30), 0, 1)
        nearest_mm = min(nearest_mm, float(np.linalg.norm(first + share * way)))
    if not solid or len(knots) < 2 or nearest_mm <= round_mm:
        if solid and isinstance(one, Tumour) and isinstance(other, Tumour):
            nearest_mm = hypot(nearest_mm, (one.z_mm or 0.0) - (other.z_mm or 0.0))
        return nearest_mm, round_mm
    return min(
        (
            _oblique_mm(one, other, z, ends)
            for z, ends in zip(pairwise(knots), pairwise(gaps), strict=True)
        ),
        key=lambda found: found[0] - found[1],
    )


def _oblique_mm(
    one: Inclusion, other: Inclusion, z_mm: tuple[float, float], gaps: tuple[Array, Array]
) -> tuple[float, float]:
    """As `_nearest_mm` between two knots of solid vessels that are cut in ellipses there.

    Two ellipses are apart if they are so in some direction; one of radius r that leans by s reaches
    r sqrt(1 + (s n)^2) in direction n.
    """
    gap = gaps[0] + ALONG[:, None] * (gaps[1] - gaps[0])
    distance = np.linalg.norm(gap, axis=1)
    turns = np.broadcast_to(
        np.column_stack([np.cos(TURNS), np.sin(TURNS)]), (len(gap), len(TURNS), 2)
    )
    ways = np.concatenate([turns, (gap / distance[:, None])[:, None]], axis=1)
    room = np.abs(np.einsum("kni,ki->kn", ways, gap))
    for i in (one, other):
        lean = np.subtract(i.centre_mm(z_mm[1]), i.centre_mm(z_mm[0])) / (z_mm[1] - z_mm[0])
        room = room - i.outer_radius_mm * np.sqrt(1 + (ways @ lean) ** 2)
    most = room.max(axis=1)
    at = int(most.argmin())
    return float(distance[at]), float(distance[at] - most[at])
