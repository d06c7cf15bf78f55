"""Narrow gaps: between inclusions that nearly touch each other or the block's outline.

A side of a mesh survives a Delaunay triangulation if no point lies within the circle that has it as
diameter (Ruppert 1995). So no side along a gap is longer than about the gap's width there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array
from sim_backend.scene.scene_file import SceneError

GAP_SHARE = 1.5
"""Longest side along a gap over the gap's width: below 2, at which a point across the gap may fall
into the circle round the side."""
GROWTH = 0.45
"""How fast elements grow from a gap into what bounds it, as in `fem.model`; coarser models, whose
error is measured with theirs, choose their own."""
LEAST_GAP_M = 1e-6
"""Gaps below this are not meshed: a cell of soft tissue is 10 to 100 um across (Alberts et al.
2014, *Molecular Biology of the Cell*), so nothing there is a continuum."""

Distance = Callable[[Array], Array]
Circle = tuple[tuple[float, float], float]
"""Centre and radius [m]."""


@dataclass(frozen=True)
class Gap:
    """Between two outlines: how far points (n, 2) lie outside of each [m], negative within; how
    wide it is where it is ``narrowest_m``; and ``between`` what."""

    one: Distance
    other: Distance
    narrowest_m: float
    between: str

    def allows(self, points: Array, share: float) -> Array:
        """Largest element sizes (n,) [m]: ``share`` of the width, and more within the outlines."""
        one, other = self.one(points), self.other(points)
        within = np.maximum(-np.minimum(one, other), 0.0)
        return np.asarray(share * np.maximum(one + other, self.narrowest_m) + GROWTH * within)


def gaps(circles: Sequence[Circle], width_m: float, height_m: float) -> list[Gap]:
    """Of the inclusions round ``circles`` in a block, in the scene's order. A circle round a point
    of x = 0 is a half circle, which meets that side.

    Raises `SceneError` for one that is too narrow to be meshed.
    """
    found = []
    for n, circle in enumerate(circles):
        found += [_between(circle, other, n, m) for m, other in enumerate(circles[:n])]
        found += _to_sides(circle, n, width_m, height_m)
    for gap in found:
        if gap.narrowest_m < LEAST_GAP_M:
            raise SceneError(
                f"{gap.between} are {1e6 * gap.narrowest_m:.3g} um apart, too little to be meshed: "
                f"move them at least {1e6 * LEAST_GAP_M:g} um apart"
            )
    return found


def gap_sizes(found: Sequence[Gap], share: float) -> Callable[[Array], Array]:
    """Largest element sizes (n,) [m] at points (n, 2) that all gaps allow."""

    def size(points: Array) -> Array:
        allowed = np.full(len(points), np.inf)
        for gap in found:
            allowed = np.minimum(allowed, gap.allows(points, share))
        return allowed

    return size


def _between(one: Circle, other: Circle, n: int, m: int) -> Gap:
    centres = float(np.hypot(*(np.asarray(one[0]) - np.asarray(other[0]))))
    return Gap(
        _outside(*one), _outside(*other), centres - one[1] - other[1],
        f"inclusion[{m}] and inclusion[{n}]",
    )  # fmt: skip


def _to_sides(circle: Circle, n: int, width_m: float, height_m: float) -> list[Gap]:
    (x, y), radius = circle
    sides: list[tuple[Distance, float, str]] = [
        (lambda points: height_m - points[:, 1], height_m - y, "the surface"),
        (lambda points: points[:, 1], y, "the bottom"),
        (lambda points: width_m - points[:, 0], width_m - x, "the right side"),
    ]
    if x != 0.0:
        sides.append((lambda points: points[:, 0], x, "the left side"))
    return [
        Gap(_outside(*circle), away, far - radius, f"inclusion[{n}] and {name}")
        for away, far, name in sides
    ]


def _outside(centre: tuple[float, float], radius: float) -> Distance:
    return lambda points: np.hypot(*(points - np.asarray(centre)).T) - radius
