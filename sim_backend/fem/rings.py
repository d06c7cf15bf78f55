"""Inclusions as circles of points, and the walls of vessels as rings of so many elements."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array, Ints

Size = Callable[[Array], Array]

LAYERS = 2.0
"""Elements through a wall over what square ones would be: a wall bends, and with one layer the
pulse was off by 1 % however fine the rest."""
MAX_HALVINGS = 20
"""From a block's height to its narrowest gap: a 20th halving of 64 mm is 0.06 um."""


@dataclass(frozen=True)
class Ring:
    """Concentric circles round ``centre`` with ``radii`` (k,) from the outside in.

    The layer between ``radii[i]`` and ``radii[i + 1]`` is region ``regions[i]``; the innermost
    circle bounds a lumen when ``hollow``, else it is filled with region ``regions[-1]``.
    """

    centre: tuple[float, float]
    radii: tuple[float, ...]
    regions: tuple[int, ...]
    hollow: bool


def around(ring: Ring, size: Size) -> int:
    """How many elements go round a ring: even, so that it is symmetric."""
    probe = circle(ring.centre, ring.radii[0], 2 * np.pi * np.arange(90) / 90)
    turn = float(np.mean(2 * np.pi * ring.radii[0] / size(probe)))
    return 2 * max(6, round(turn / 2))


def even(count: int) -> Array:
    """Angles (count,) from the top, once round."""
    return np.asarray(np.pi / 2 + 2 * np.pi * np.arange(count) / count)


def angles(ring: Ring, wanted: Size, in_gaps: Size) -> tuple[Array, float]:
    """Angles (n,) of a circle's points, even but for narrow gaps, and the even step [m]."""
    count = around(ring, wanted)
    step = 2 * np.pi * ring.radii[0] / count
    angle = even(count)
    for _ in range(MAX_HALVINGS):
        arc = np.diff(angle, append=angle[0] + 2 * np.pi)
        allowed = np.min(
            [in_gaps(circle(ring.centre, ring.radii[0], angle + t * arc)) for t in (0, 0.5, 1)], 0
        )
        long = ring.radii[0] * arc > allowed
        if not long.any():
            break
        angle = np.sort(np.concatenate([angle, (angle + arc / 2)[long]]))
    return angle, step


def circle(centre: tuple[float, float], radius: float, angle: Array) -> Array:
    return np.column_stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)])


def half_circle(rectangle: Array, outline: Array) -> tuple[Array, Array]:
    """The rectangle's points without those beside the circle's ends, and the right half circle
    from below up."""
    half = outline[outline[:, 0] > -1e-12]
    half[:, 0] = np.where(half[:, 0] < 1e-12, 0.0, half[:, 0])
    half = half[np.argsort(half[:, 1])]
    near = np.zeros(len(rectangle), dtype=bool)
    for end, beside in ((0, 1), (-1, -2)):
        step = np.hypot(*(half[end] - half[beside]))
        near |= np.hypot(*(rectangle - half[end]).T) < 0.6 * step
    return rectangle[~(near & (rectangle[:, 0] == 0.0))], half


def layers(ring: Ring, angle: Array, step: float) -> tuple[Array, Ints, Ints]:
    """Points, corner triangles and regions of a ring's layers, ``step`` [m] round its outside.
    Alternate circles are turned by half a step."""
    count = len(angle)
    between = angle + np.diff(angle, append=angle[0] + 2 * np.pi) / 2
    radii, regions = [ring.radii[0]], []
    for outer, inner, region in zip(ring.radii, ring.radii[1:], ring.regions, strict=False):
        layers = max(1, round(LAYERS * (outer - inner) / (step * outer / ring.radii[0])))
        radii += list(np.linspace(outer, inner, layers + 1)[1:])
        regions += [region] * layers
    points = np.vstack(
        [
            circle(ring.centre, r, np.roll((angle, between)[i % 2], -(i // 2)))
            for i, r in enumerate(radii)
        ]
    )
    i = np.arange(count)
    nxt = (i + 1) % count
    corners, region_of = [], []
    for layer, region in enumerate(regions):
        a, b = layer * count, (layer + 1) * count
        corners += [np.column_stack([a + i, a + nxt, b + i])]
        corners += [np.column_stack([b + nxt, b + i, a + nxt])]
        region_of += [np.full(2 * count, region)]
    return points, np.vstack(corners).astype(np.int64), np.concatenate(region_of)
