"""Whether what lies in a block has room there: within its sides, none over another."""

from itertools import pairwise
from math import hypot

import numpy as np

from sim_backend.scene.inclusion import Artery, Inclusion, Tumour


def need_room(
    inclusion: tuple[Inclusion, ...], width_mm: float, height_mm: float, *, solid: bool
) -> None:
    """Raise `ValueError` for what breaks the block's surface, bottom or sides, at its place or at
    a point of its path, and for two that overlap anywhere along z."""
    for n, one in enumerate(inclusion):
        r = one.outer_radius_mm
        where = f"inclusion[{n}] ({one.kind})"
        path = one.path if isinstance(one, Artery) else ()
        points = [("", one.x_mm, one.depth_mm)]
        points += [(f"path[{k}]: ", x_mm, depth_mm) for k, (_, x_mm, depth_mm) in enumerate(path)]
        for key, x_mm, depth_mm in points:
            if depth_mm - r <= 0:
                raise ValueError(
                    f"{where}: {key}depth_mm = {depth_mm:g} breaks the surface; "
                    f"it must be above the outer radius {r:g}"
                )
            if depth_mm + r >= height_mm:
                raise ValueError(
                    f"{where}: {key}depth_mm = {depth_mm:g} breaks the bottom; "
                    f"it must be below {height_mm - r:g}"
                )
            if not r < x_mm < width_mm - r:
                raise ValueError(
                    f"{where}: {key}x_mm = {x_mm:g} breaks a side; "
                    f"it must lie between {r:g} and {width_mm - r:g}"
                )
        for m, other in enumerate(inclusion[:n]):
            distance_mm = _distance_mm(one, other, solid=solid)
            if distance_mm <= r + other.outer_radius_mm:
                raise ValueError(
                    f"{where} overlaps inclusion[{m}]: centres are {distance_mm:.3g} mm apart; "
                    f"they must be more than {r + other.outer_radius_mm:g} mm apart"
                )


def _distance_mm(one: Inclusion, other: Inclusion, *, solid: bool) -> float:
    """The least distance of the centres in one section; between the points of a path they move
    straight. Balls in a solid may lie behind each other."""
    knots = {z for i in (one, other) if isinstance(i, Artery) for z, _, _ in i.path} or {0.0}
    gaps = [np.subtract(one.centre_mm(z), other.centre_mm(z)) for z in sorted(knots)]
    nearest_mm = min(float(np.linalg.norm(gap)) for gap in gaps)
    for first, last in pairwise(gaps):
        way = last - first
        share = np.clip(-(first @ way) / max(float(way @ way), 1e-30), 0, 1)
        nearest_mm = min(nearest_mm, float(np.linalg.norm(first + share * way)))
    if solid and isinstance(one, Tumour) and isinstance(other, Tumour):
        return hypot(nearest_mm, (one.z_mm or 0.0) - (other.z_mm or 0.0))
    return nearest_mm
