"""A mesh that follows circles: fine under the finger and at inclusions, coarse elsewhere.

Vessel walls are meshed as structured rings, so that a thin wall has well-shaped quadratic
elements through it; what lies around them is a Delaunay triangulation of graded points. All
lengths are metres.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from sim_backend.arrays import Array, Ints
from sim_backend.fem.gaps import GAP_SHARE, gap_sizes, gaps
from sim_backend.fem.rings import (
    MAX_HALVINGS,
    Ring,
    Size,
    angles,
    around,
    circle,
    even,
    half_circle,
    layers,
)

TISSUE = 0
SUPPORT_ARC_DEG = 10.0
TINY_M = 1e-12  # far below any element
"""Half of the arc by which a lone vessel is glued to its support, so that it cannot roll away."""
T6_EDGES = ((0, 3, 1), (1, 4, 2), (2, 5, 0))


@dataclass(frozen=True)
class Mesh:
    """Six-node triangles.

    ``nodes`` (n, 2) [m]; ``cells`` (m, 6), corners counter-clockwise then mid-sides 01, 12, 20;
    ``region`` (m,) numbers the material. ``surface`` (s,) are the nodes a finger can touch, from
    left to right; ``bottom`` (b,), left to right, are fixed by the support;
    ``resting`` (r,) may come to rest on it. ``lumens`` lists, for each lumen, the cells
    whose side 0-3-1 lies on it (the lumen to their right when walking from 0 to 1).
    """

    nodes: Array
    cells: Ints
    region: Ints
    surface: Ints
    bottom: Ints
    resting: Ints
    lumens: tuple[Ints, ...]


def block_mesh(
    width: float, height: float, rings: list[Ring], wanted: Size, gap_share: float = GAP_SHARE
) -> Mesh:
    """Mesh a block [0, width] x [0, height] that holds ``rings``; ``wanted`` (n, 2) -> (n,) [m].

    Elements in gaps are at most ``gap_share`` of the gap's width. Of a filled ring round a point of
    x = 0 the right half is meshed. Raises `SceneError` for a gap that is too narrow.
    """
    largest = float(wanted(np.array([[0, 0], [width, 0], [0, height], [width, height]])).max())
    found = gaps([(ring.centre, ring.radii[0]) for ring in rings], width, height)
    narrow = [gap for gap in found if gap_share * gap.narrowest_m < largest]
    in_gaps = gap_sizes(narrow, gap_share)

    def size(points: Array) -> Array:
        return np.minimum(wanted(points), in_gaps(points))

    fixed = [_rectangle(width, height, size)]
    ring_parts = []
    chords = []  # numbers of the points at the ends of each side of a circle
    for ring in rings:
        angle, step = angles(ring, wanted, in_gaps)
        outline = circle(ring.centre, ring.radii[0], angle)
        if ring.centre[0] == 0.0:
            fixed[0], outline = half_circle(fixed[0], outline)
        elif ring.hollow:
            ring_parts.append(layers(ring, angle, step))
        numbers = sum(map(len, fixed)) + np.arange(len(outline))
        both = np.column_stack([numbers, np.roll(numbers, -1)])
        chords.append(both[:-1] if ring.centre[0] == 0.0 else both)
        fixed.append(outline)
    anchors = np.vstack(fixed)
    free = _fill(width, height, anchors, rings, size)
    points = _relax(anchors, free, width, height, rings, size)
    sides = np.vstack(chords) if chords else np.empty((0, 2), dtype=np.int64)
    points, corners = _with_sides(points, len(anchors), sides, width, height)
    region = np.full(len(corners), TISSUE)
    middle = points[corners].mean(axis=1)
    keep = np.ones(len(corners), dtype=bool)
    for ring in rings:
        inside = np.hypot(*(middle - ring.centre).T) < ring.radii[0]
        if ring.hollow:
            keep &= ~inside
        else:
            region[inside] = ring.regions[-1]
    return _finish(points, corners[keep], region[keep], ring_parts, rings, height)


def count_round(ring: Ring, size_m: float) -> int:
    """Elements of about ``size_m`` round a ring that stands alone: so many that a node lies where
    the glue ends."""
    whole = round(360 / SUPPORT_ARC_DEG)
    wanted = around(ring, lambda points: np.full(len(points), size_m))
    return whole * max(1, round(wanted / whole))


def ring_mesh(ring: Ring, size_m: float) -> Mesh:
    """Mesh a hollow ring that stands alone on the support y = 0."""
    count = count_round(ring, size_m)
    part = layers(ring, even(count), 2 * np.pi * ring.radii[0] / count)
    empty = np.empty((0, 2)), np.empty((0, 3), dtype=np.int64), np.empty(0, dtype=np.int64)
    return _finish(*empty, [part], [ring], 2 * ring.radii[0])


def _rectangle(width: float, height: float, size: Size) -> Array:
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=float)
    sides = [_graded(corners[i], corners[(i + 1) % 4], size)[:-1] for i in range(4)]
    return np.vstack(sides)


def _graded(start: Array, end: Array, size: Size) -> Array:
    """Points from ``start`` to ``end`` (both included), spaced by ``size``."""
    length = float(np.hypot(*(end - start)))
    s = np.linspace(0, 1, 2001)
    for _ in range(MAX_HALVINGS):
        long = np.diff(s) * length > 0.5 * size(start + s[1:, None] * (end - start))
        if not long.any():
            break
        s = np.sort(np.concatenate([s, ((s[1:] + s[:-1]) / 2)[long]]))
    density = 1 / size(start + s[:, None] * (end - start))
    mean = (density[1:] + density[:-1]) / 2
    count = np.concatenate([[0], np.cumsum(mean * np.diff(s))]) * length
    n = max(2, round(count[-1]))
    at = np.interp(np.linspace(0, count[-1], n + 1), count, s)
    return np.asarray(start + at[:, None] * (end - start))


def _fill(width: float, height: float, anchors: Array, rings: list[Ring], size: Size) -> Array:
    """Interior points as the centres of a quadtree refined until its cells are ``size``."""
    step = height / 2
    nx = max(1, round(width / step))
    x, y = (np.arange(nx) + 0.5) * width / nx, (np.arange(2) + 0.5) * step
    cells = np.array([(a, b) for a in x for b in y])
    edge = np.array([width / nx, step])
    done = []
    for _ in range(14):
        large = edge.max() > 1.25 * size(cells)
        done.append(cells[~large])
        cells = cells[large]
        if not len(cells):
            break
        edge = edge / 2
        quarter = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]]) * edge / 2
        cells = (cells[:, None, :] + quarter).reshape(-1, 2)
    points: Array = np.vstack(done)
    distance, _ = cKDTree(anchors).query(points)
    points = points[distance > 0.6 * size(points)]
    for ring in rings:
        if ring.hollow:
            away = np.hypot(*(points - ring.centre).T) > ring.radii[0]
            points = points[away]
    return points


def _relax(
    anchors: Array, free: Array, width: float, height: float, rings: list[Ring], size: Size
) -> Array:
    """Even out the free points as a truss under pressure (Persson and Strang 2004, eq. 4)."""
    points = np.vstack([anchors, free])
    n = len(anchors)
    step = 0.2
    for iteration in range(16):
        if iteration % 4 == 0:
            points = _without_coincident(points)
            corners = _triangulate(points, width, height)
            bars = _ends(np.unique(_side_numbers(corners, len(points))), len(points))
            wanted = size(points[bars].mean(axis=1))
        span = points[bars[:, 0]] - points[bars[:, 1]]
        length = np.maximum(np.hypot(*span.T), TINY_M)  # two may lie in the same corner
        scale = np.sqrt((length**2).sum() / (wanted**2).sum())
        thrust = np.maximum(1.15 * scale * wanted - length, 0) / length
        force = np.zeros_like(points)
        for k, sign in ((0, 1.0), (1, -1.0)):
            for axis in (0, 1):
                force[:, axis] += np.bincount(
                    bars[:, k], sign * thrust * span[:, axis], minlength=len(points)
                )
        moved = points[n:] + step * force[n:]
        margin = 0.5 * size(moved)
        moved[:, 0] = np.clip(moved[:, 0], margin, width - margin)
        moved[:, 1] = np.clip(moved[:, 1], margin, height - margin)
        for ring in rings:
            moved = _keep_off(moved, points[n:], ring, margin)
        points = np.vstack([anchors, moved])
    return _without_coincident(points)


def _without_coincident(points: Array) -> Array:
    """Points, in their order, without those in another's place: triangles need one there."""
    _, first = np.unique(points, axis=0, return_index=True)
    return points if len(first) == len(points) else points[np.sort(first)]


def _keep_off(points: Array, before: Array, ring: Ring, margin: Array) -> Array:
    """Hold points at ``margin`` from a ring's circle, on the side where they were."""
    away = points - ring.centre
    distance = np.maximum(np.hypot(*away.T), TINY_M)
    outside = np.hypot(*(before - ring.centre).T) >= ring.radii[0]
    low = np.where(outside, ring.radii[0] + 0.8 * margin, 0.0)
    high = np.where(outside, np.inf, ring.radii[0] - 0.8 * margin)
    kept = np.clip(distance, low, np.maximum(high, TINY_M))
    return np.asarray(ring.centre + away * (kept / distance)[:, None])


def _with_sides(
    points: Array, anchors: int, sides: Ints, width: float, height: float
) -> tuple[Array, Ints]:
    """Points and corners of a triangulation that holds all ``sides`` (s, 2) between the first
    ``anchors`` points. Free points that keep one out, within the circle round it, are left out."""
    while True:
        corners = _triangulate(points, width, height)
        numbers = np.unique(_side_numbers(corners, len(points)))
        low, high = np.sort(sides).T
        lost = sides[~np.isin(low * len(points) + high, numbers)]
        ends = points[lost]
        half = np.hypot(*(ends[:, 1] - ends[:, 0]).T) / 2
        near = cKDTree(points[anchors:]).query_ball_point(ends.mean(axis=1), half)
        out = sorted({n for some in near for n in some})
        if not len(lost):
            return points, corners
        if not out:
            x_mm, y_mm = 1e3 * ends[0].mean(axis=0)
            raise ValueError(f"the mesh loses an inclusion's outline at {x_mm:.3f}, {y_mm:.3f} mm")
        points = np.delete(points, anchors + np.array(out), axis=0)


def _triangulate(points: Array, width: float, height: float) -> Ints:
    corners = Delaunay(points).simplices.astype(np.int64)
    a, b, c = (points[corners[:, k]] for k in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    corners[area < 0] = corners[area < 0][:, [0, 2, 1]]
    longest = np.max([np.hypot(*(a - b).T), np.hypot(*(b - c).T), np.hypot(*(c - a).T)], axis=0)
    flat = np.abs(area) < 1e-6 * longest**2
    on_side = np.zeros(len(corners), dtype=bool)
    for axis, high in ((0, width), (1, height)):
        for level in (0.0, high):
            on_side |= np.all(np.abs(points[corners][:, :, axis] - level) < TINY_M, axis=1)
    kept: Ints = corners[~(flat | on_side)]
    return kept


def _side_numbers(corners: Ints, points: int) -> Ints:
    """One number (m, 3) for each side of triangles (m, 3) between so many ``points``, whichever way
    round it is; in the order of its lower end, then of its higher one."""
    low, high = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)]), axis=0)
    return np.asarray(low * points + high)


def _ends(numbers: Ints, points: int) -> Ints:
    """The lower and the higher end (s, 2) of sides by their ``numbers`` (s,)."""
    return np.stack(np.divmod(numbers, points), axis=1)


def _finish(
    points: Array,
    corners: Ints,
    region: Ints,
    parts: list[tuple[Array, Ints, Ints]],
    rings: list[Ring],
    height: float,
) -> Mesh:
    """Join the parts, add mid-side nodes on true circles, name the boundaries."""
    points, corners, region = _join(points, corners, region, parts)
    nodes, cells = _mid_sides(points, corners, rings)
    lumens = tuple(_lumen_cells(nodes, cells, ring) for ring in rings if ring.hollow)
    alone = not np.any(region == TISSUE)
    if alone:
        (ring,) = rings
        on_outer = np.abs(np.hypot(*(nodes - ring.centre).T) - ring.radii[0]) < 1e-9
        down = np.degrees(np.arctan2(nodes[:, 0] - ring.centre[0], ring.centre[1] - nodes[:, 1]))
        glued = np.abs(down) <= SUPPORT_ARC_DEG + 1e-6
        bottom = np.flatnonzero(on_outer & glued)
        resting = np.flatnonzero(on_outer & (np.abs(down) <= 80) & ~glued)
        surface = np.flatnonzero(on_outer & (nodes[:, 1] > ring.centre[1] - 0.3 * ring.radii[0]))
        surface = surface[np.argsort(-np.arctan2(*(nodes[surface] - ring.centre).T[::-1]))]
    else:
        bottom = np.flatnonzero(np.abs(nodes[:, 1]) < 1e-9)
        resting = np.empty(0, dtype=np.int64)
        surface = np.flatnonzero(np.abs(nodes[:, 1] - height) < 1e-9)
        surface = surface[np.argsort(nodes[surface, 0])]
    bottom = bottom[np.argsort(nodes[bottom, 0])]
    return Mesh(nodes, cells, region, surface, bottom, resting, lumens)


def _join(
    points: Array, corners: Ints, region: Ints, parts: list[tuple[Array, Ints, Ints]]
) -> tuple[Array, Ints, Ints]:
    for more, its_corners, its_region in parts:
        corners = np.vstack([corners, its_corners + len(points)])
        points = np.vstack([points, more])
        region = np.concatenate([region, its_region])
    _, first, merged = np.unique(
        np.round(points, 9), axis=0, return_index=True, return_inverse=True
    )
    corners = merged.ravel()[corners]
    used = np.zeros(len(first), dtype=bool)
    used[corners] = True
    number = np.cumsum(used) - 1
    return points[first][used], number[corners], region


def _mid_sides(points: Array, corners: Ints, rings: list[Ring]) -> tuple[Array, Ints]:
    numbers, index = np.unique(_side_numbers(corners, len(points)), return_inverse=True)
    unique = _ends(numbers, len(points))
    middle = points[unique].mean(axis=1)
    for ring in rings:
        away = points - np.asarray(ring.centre)
        radius = np.hypot(*away.T)
        within = radius[unique] <= ring.radii[0] * (1 + 1e-9)
        smallest = ring.radii[-1] if ring.hollow else ring.radii[0]
        curved = np.all(within & (radius[unique] >= smallest * (1 - 1e-9)), axis=1)
        direction = middle[curved] - ring.centre
        mean_radius = radius[unique[curved]].mean(axis=1)
        middle[curved] = ring.centre + direction * (mean_radius / np.hypot(*direction.T))[:, None]
    cells = np.hstack([corners, len(points) + index.reshape(-1, 3)])
    return np.vstack([points, middle]), cells.astype(np.int64)


def _lumen_cells(nodes: Array, cells: Ints, ring: Ring) -> Ints:
    """Cells with a side on the lumen, renumbered in place so that it is side 0-3-1."""
    on = np.abs(np.hypot(*(nodes - ring.centre).T) - ring.radii[-1]) < 1e-9
    found = []
    for turn, side in enumerate(T6_EDGES):
        hit = np.flatnonzero(np.all(on[cells[:, side]], axis=1))
        order = [(k + turn) % 3 for k in range(3)]
        cells[hit] = cells[hit][:, order + [3 + k for k in order]]
        found.append(hit)
    return np.sort(np.concatenate(found))
