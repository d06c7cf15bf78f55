"""A quarter of a solid scene as 20-node hexahedra, block by block, and the finger as facets.

Nothing is shared with `sim_backend.fem.solid`: there a section of triangles is extruded and bent;
here lattices fill the space between circles or spheres and boxes, and grids the space beyond.
Finger and inclusion lie at x = 0, z = 0 of the quarter x >= 0, z >= 0; the support is y = 0. All
lengths in mm.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sim_backend.arrays import Array, Bools, Ints
from sim_backend.scene.inclusion import Artery, Tumour
from sim_backend.scene.indenter import Cylinder, Indenter
from sim_backend.scene.scene_file import Scene

QUARTER = np.pi / 4
BOX = 1.35
"""Half side of the box around an inclusion over its radius."""
CORE = 0.55
"""Half side of the cube within a ball over its radius."""
FACET_MM = 0.25
"""Of the finger: a facet's middle lies FACET^2 / (8 R) = 0.002 mm inside a ball of 5 mm."""
LEAN_MM = 0.5
"""To either side of a place, where a path's lean is measured: half of the way between points."""
REACH = np.radians(62.0)
"""Angle from the lowest point up to which a finger has facets: 2 mm deep, 5 mm round, contact ends
below 53 degrees."""
_NODES = np.array([
    [0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [0, 0, 2], [2, 0, 2], [2, 2, 2], [0, 2, 2],
    [1, 0, 0], [2, 1, 0], [1, 2, 0], [0, 1, 0], [1, 0, 2], [2, 1, 2], [1, 2, 2], [0, 1, 2],
    [0, 0, 1], [2, 0, 1], [2, 2, 1], [0, 2, 1],
])  # fmt: skip
"""Places in a lattice of 3 x 3 x 3 of a C3D20's nodes (CalculiX manual, sec. 6.2)."""
SIDES = np.array([[0, 1, 2, 3], [4, 7, 6, 5], [0, 4, 5, 1], [1, 5, 6, 2], [2, 6, 7, 3],
                  [3, 7, 4, 0]])  # fmt: skip
"""Corners of a hexahedron's faces S1 to S6."""


@dataclass(frozen=True)
class Hexahedra:
    """``nodes`` (n, 3) [mm], ``cells`` (m, 20) and the ``middle`` (m, 3) of each, on no path."""

    nodes: Array
    cells: Ints
    middle: Array

    def outer_faces(self) -> tuple[Ints, Array]:
        """Faces of one hexahedron only: (f, 2) cell and side, and their corners (f, 4, 3)."""
        corners = np.sort(self.cells[:, SIDES].reshape(-1, 4), axis=1)
        _, first, count = np.unique(corners, axis=0, return_index=True, return_counts=True)
        cell, side = np.divmod(np.sort(first[count == 1]), 6)
        return np.column_stack([cell, side]), self.nodes[self.cells[cell[:, None], SIDES[side]]]


def quarter(scene: Scene, cells_45: int, z_edges: Array) -> Hexahedra:
    """Mesh ``scene``, a block over no more than one inclusion, with ``cells_45`` hexahedra to 45
    degrees around the inclusion and layers between ``z_edges``, which a ball's box replaces."""
    tissue = scene.tissue
    assert tissue is not None and tissue.length_mm is not None
    (one,) = scene.inclusion
    centre = np.array([0.0, tissue.height_mm - one.depth_mm, 0.0])
    box = min(BOX * one.outer_radius_mm, centre[1])
    x = np.append(box * np.tan(_halved(0.0, QUARTER, cells_45)),
                  _growing(box, tissue.width_mm / 2, box / cells_45)[1:])  # fmt: skip
    beside = np.append(-x[x <= box][:0:-1], x[x <= box])
    y = centre[1] + beside
    if centre[1] > box:
        y = np.append(_halved(0.0, y[0], round(y[0] / box * cells_45) or 1)[:-1], y)
    layers = max(2, round((tissue.height_mm - y[-1]) / (1.2 * box / cells_45)))
    y = np.append(y, _halved(y[-1], tissue.height_mm, layers)[1:])
    if isinstance(one, Tumour):
        z = np.append(x[x <= box], _growing(box, tissue.length_mm / 2, box / cells_45)[1:])
        inside = [centre + block for block in _ball(one.outer_radius_mm, box, cells_45)]
    else:
        z = _with_middles(z_edges)
        inside = [centre + block for block in _vessel(one, box, cells_45, z)]
    outside = _bricks(np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1))
    off = np.abs(outside[:, 1, 1, 1] - centre)
    if not isinstance(one, Tumour):
        off[:, 2] = 0.0
    bricks = np.concatenate([outside[off.max(axis=1) > box], *(_bricks(b) for b in inside)])
    bricks = bricks[~_is_lumen(scene, bricks[:, 1, 1, 1])]
    placed = bricks[:, *_NODES.T]
    nodes, cells = np.unique(np.round(placed.reshape(-1, 3), 6), axis=0, return_inverse=True)
    if isinstance(one, Artery) and one.path:
        nodes = _dipped(nodes, one, box, tissue.width_mm / 2, tissue.height_mm)
    return Hexahedra(nodes, cells.reshape(-1, 20), bricks[:, 1, 1, 1])


def _dipped(nodes: Array, one: Artery, box: float, width: float, height: float) -> Array:
    """``nodes`` (n, 3) of a straight vessel's quarter, moved up and down along its path: its box as
    it is, longer where the vessel leans, and what is above, below and beside by straight lines."""
    x, y, z = nodes.T
    centre = height - one.depth_mm
    fades = np.clip(1 - (x - box) / (width - box), 0.0, 1.0)

    def rise(at: Array) -> Array:
        return one.depth_mm - np.interp(at, *np.array(one.path)[:, [0, 2]].T)

    lean = (rise(z + LEAN_MM) - rise(z - LEAN_MM)) / (2 * LEAN_MM)
    half = box * (1 + fades * (np.hypot(1.0, lean) - 1))
    middle = centre + fades * rise(z)
    below = y / (centre - box) * (middle - half)
    within = middle + (y - centre) / box * half
    above = height - (height - y) / (height - centre - box) * (height - middle - half)
    moved = np.where(y < centre - box, below, np.where(y > centre + box, above, within))
    return np.column_stack([x, moved, z])


def material_of(scene: Scene, middle: Array) -> Ints:
    """0 tissue, 1 wall or lump, 2 stenosis, for hexahedra with ``middle`` (m, 3)."""
    (one,) = scene.inclusion
    radius = _radius(scene, middle)
    found = (radius < one.outer_radius_mm).astype(int)
    if isinstance(one, Artery):
        found[radius < one.inner_diameter_mm / 2] = 2
    return found


def _is_lumen(scene: Scene, middle: Array) -> Bools:
    (one,) = scene.inclusion
    if isinstance(one, Tumour):
        return np.zeros(len(middle), dtype=bool)
    within = _radius(scene, middle) < one.inner_diameter_mm / 2
    if one.stenosis is not None:
        assert one.stenosis.z_mm is not None
        within &= middle[:, 2] > one.stenosis.z_mm[1]
    return np.asarray(within)


def _radius(scene: Scene, middle: Array) -> Array:
    """From the inclusion's middle or axis."""
    (one,) = scene.inclusion
    off = middle - np.array([0.0, scene.surface_mm - one.depth_mm, 0.0])
    return np.asarray(np.linalg.norm(off[:, : 3 if isinstance(one, Tumour) else 2], axis=1))


def _vessel(one: Artery, box: float, cells_45: int, z: Array) -> Iterator[Array]:
    """Lattices from the lumen to the box."""
    angle = _halved(-2 * QUARTER, 2 * QUARTER, 4 * cells_45)
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    square = box * ray / np.abs(ray).max(axis=1, keepdims=True)
    circles = [one.inner_diameter_mm / 2, one.outer_radius_mm]
    if one.stenosis is not None:
        circles = [circles[0] * (1 - one.stenosis.fraction), *circles]
    bounds = [*(radius * ray for radius in circles), square]
    for low, high in pairwise(bounds):
        share = _halved(0.0, 1.0, 2 if high is square else 1)[:, None, None]
        plane = (1 - share) * low + share * high
        flat = np.broadcast_to(plane[:, :, None], (*plane.shape[:2], len(z), 2))
        along = np.broadcast_to(z, flat.shape[:-1])
        yield np.concatenate([flat, along[..., None]], axis=-1)


def _ball(radius: float, box: float, cells_45: int) -> Iterator[Array]:
    """Lattices of a cube, and of what lies between it, the ball and the box."""
    half = np.tan(_halved(0.0, QUARTER, cells_45))
    whole = np.append(-half[:0:-1], half)
    core = CORE * radius
    yield core * np.stack(np.meshgrid(half, whole, half, indexing="ij"), axis=-1)
    sides = (((1, whole), (2, half), 0, 1.0), ((0, half), (2, half), 1, 1.0),
             ((0, half), (2, half), 1, -1.0), ((0, half), (1, whole), 2, 1.0))  # fmt: skip
    for (first, a), (second, b), third, sign in sides:
        ray = np.empty((len(a), len(b), 3))
        ray[..., first], ray[..., second], ray[..., third] = a[:, None], b, sign
        ball = radius * ray / np.linalg.norm(ray, axis=-1, keepdims=True)
        for low, high in ((core * ray, ball), (ball, box * ray)):
            share = _halved(0.0, 1.0, 2)[:, None, None, None]
            yield (1 - share) * low + share * high


def _bricks(lattice: Array) -> Array:
    """(m, 3, 3, 3, 3): the points of each hexahedron of ``lattice`` (2a + 1, 2b + 1, 2c + 1, 3)."""
    windows = np.lib.stride_tricks.sliding_window_view(lattice, (3, 3, 3), axis=(0, 1, 2))
    bricks = np.moveaxis(windows[::2, ::2, ::2], 3, -1).reshape(-1, 3, 3, 3, 3)
    here = bricks[:, 1, 1, 1]
    edges = np.stack([bricks[:, 2, 1, 1] - here, bricks[:, 1, 2, 1] - here,
                      bricks[:, 1, 1, 2] - here], axis=1)  # fmt: skip
    return np.where((np.linalg.det(edges) < 0)[:, None, None, None, None], bricks[:, ::-1], bricks)


def _halved(low: float, high: float, cells: int) -> Array:
    return np.linspace(low, high, 2 * cells + 1)


def _with_middles(edges: Array) -> Array:
    found = np.empty(2 * len(edges) - 1)
    found[::2], found[1::2] = edges, (edges[1:] + edges[:-1]) / 2
    return found


def _growing(low: float, high: float, first: float, ratio: float = 1.5) -> Array:
    """From ``low`` to ``high`` in steps that grow by ``ratio``, the first about ``first``."""
    cells = max(1, round(np.log1p((high - low) * (ratio - 1) / first) / np.log(ratio)))
    steps = ratio ** np.arange(cells)
    return _with_middles(low + (high - low) * np.append(0.0, np.cumsum(steps) / steps.sum()))


def finger_facets(indenter: Indenter, surface_mm: float) -> tuple[Array, Ints]:
    """Outer and inner points (2k, 3) of a finger that just touches ``surface_mm``, and its
    eight-node cells (m, 8), whose first four nodes face outwards. It reaches a little beyond the
    planes of symmetry."""
    if isinstance(indenter, Cylinder):
        assert indenter.axis == "along" and indenter.edge_radius_mm is not None
        edge, radius = indenter.edge_radius_mm, indenter.radius_mm
        half = indenter.length_mm / 2 - edge
        turn = np.linspace(0.0, np.pi / 2, 1 + round(edge * np.pi / 2 / FACET_MM))
        side = np.linspace(-1.0, half, 2 + round(half))[:-1]
        cap = np.arange(radius - edge, 1.0, -1.0)[1:]
        along = np.concatenate([side, half + edge * np.sin(turn), np.full(len(cap), half + edge)])
        out = np.concatenate([np.full(len(side), radius), radius - edge + edge * np.cos(turn), cap])
        ways = np.zeros((len(along), 2))  # outward: (away from the axis, along it)
        ways[: len(side)] = 1.0, 0.0
        ways[len(side) : len(side) + len(turn)] = np.column_stack([np.cos(turn), np.sin(turn)])
        ways[len(side) + len(turn) :] = 0.0, 1.0
        angle = np.arange(-2, 1 + REACH * radius / FACET_MM) * FACET_MM / radius
        spoke = np.column_stack([np.sin(angle), -np.cos(angle)])[:, None]

        def placed(away: Array, z: Array) -> Array:
            points = np.empty((len(angle), len(z), 3))
            points[..., :2], points[..., 2] = spoke * away[:, None], z
            return points

        outer = placed(out, along)
        inner = outer - 0.5 * edge * placed(ways[:, 0], ways[:, 1])
    else:
        radius = indenter.width_mm_projected / 2
        angle = np.arange(-2, 1 + REACH * radius / FACET_MM) * FACET_MM / radius
        slope = np.tan(angle)
        ray = np.stack([*np.broadcast_arrays(slope[:, None], -1.0, slope)], axis=-1)
        outer = radius * ray / np.linalg.norm(ray, axis=-1, keepdims=True)
        inner = 0.9 * outer
    rise = np.array([0.0, surface_mm + radius, 0.0])
    rows, columns = outer.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    face = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1)
    cells = face.reshape(-1, 4)
    points = np.concatenate([outer.reshape(-1, 3), inner.reshape(-1, 3)])
    a, b, c = (points[cells[:, k]] for k in (0, 1, 3))
    inward = points[cells[:, 0] + rows * columns] - a
    turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), inward) < 0
    cells[turned] = cells[turned][:, ::-1]
    return points + rise, np.hstack([cells, cells + rows * columns])
