"""Finite elements by the field's names, as gradients and weights at their quadrature points.

CPS*/CPE* are plane stress and plane strain; here the plane is the scene's, so an element is named
by its shape: ``T6`` (quadratic triangle), ``Q4`` (full integration), ``Q4R`` (one point with
hourglass control), ``Q8R`` (quadratic, reduced), and ``T6M``, ``Q4M`` with one dilatation for the
whole element, which do not lock. Quadrilaterals come from splitting each triangle into three.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.mesh import Mesh

ELEMENTS = ("T6", "T6M", "Q4", "Q4R", "Q4M", "Q8R")
HOURGLASS = 0.01
"""Share of the elastic stiffness that holds hourglass modes (Flanagan and Belytschko 1981)."""

Shape = Callable[[Array], tuple[Array, Array]]
"""Values (q, k) and gradients (q, k, 2) at reference points (q, 2)."""

_G2 = 1 / np.sqrt(3)
_TRIANGLE = np.array([[1 / 6, 1 / 6], [2 / 3, 1 / 6], [1 / 6, 2 / 3]]), np.full(3, 1 / 6)
_FOUR = np.array([[a, b] for a in (-_G2, _G2) for b in (-_G2, _G2)]), np.ones(4)
_ONE = np.zeros((1, 2)), np.full(1, 4.0)


@dataclass(frozen=True)
class Cells:
    """Elements ready to integrate over the undeformed section.

    ``nodes`` (m, k); ``gradient`` (m, q, 2, k) of the shape functions [1/m]; ``weight`` (m, q)
    [m2]; ``region`` (m,).
    ``dilatation``: one volume change for the whole element. ``hourglass`` (m, k) are the
    patterns that one-point integration misses, None where there are none. ``hoop`` (m, q, 2k) takes
    an element's displacements to F33 - 1 where the section turns about x = 0, and ``weight`` is
    then a volume [m3]; None in a plane.
    """

    nodes: Ints
    gradient: Array
    weight: Array
    region: Ints
    dilatation: bool
    hourglass: Array | None
    shape: Shape
    hoop: Array | None = None

    @cached_property
    def dofs(self) -> Ints:
        """(m, 2k): displacement numbers of each element."""
        return np.stack([2 * self.nodes, 2 * self.nodes + 1], axis=-1).reshape(len(self.nodes), -1)

    @cached_property
    def operator(self) -> Array:
        """(m, q, 4, 2k): takes an element's displacements [ux0, uy0, ux1, ...] to
        [F11, F12, F21, F22] - I."""
        return operator(self.gradient)


def t6(xi: Array) -> tuple[Array, Array]:
    """Values (q, 6) and gradients (q, 6, 2) of the quadratic triangle at ``xi`` (q, 2)."""
    b, c = xi[:, 0], xi[:, 1]
    a = 1 - b - c
    n = np.stack(
        [a * (2 * a - 1), b * (2 * b - 1), c * (2 * c - 1), 4 * a * b, 4 * b * c, 4 * c * a], axis=1
    )
    z = np.zeros_like(a)
    db = np.stack([1 - 4 * a, 4 * b - 1, z, 4 * (a - b), 4 * c, -4 * c], axis=1)
    dc = np.stack([1 - 4 * a, z, 4 * c - 1, -4 * b, 4 * b, 4 * (a - c)], axis=1)
    return n, np.stack([db, dc], axis=2)


def q4(xi: Array) -> tuple[Array, Array]:
    """The bilinear quadrilateral, corners counter-clockwise from (-1, -1)."""
    r, s = xi[:, :1], xi[:, 1:]
    cr, cs = np.array([-1, 1, 1, -1]), np.array([-1, -1, 1, 1])
    n = (1 + cr * r) * (1 + cs * s) / 4
    return n, np.stack([cr * (1 + cs * s) / 4, cs * (1 + cr * r) / 4], axis=2)


def q8(xi: Array) -> tuple[Array, Array]:
    """The serendipity quadrilateral: corners, then mid-sides 01, 12, 23, 30."""
    r, s = xi[:, :1], xi[:, 1:]
    cr, cs = np.array([-1, 1, 1, -1]), np.array([-1, -1, 1, 1])
    corner = (1 + cr * r) * (1 + cs * s) * (cr * r + cs * s - 1) / 4
    corner_r = cr * (1 + cs * s) * (2 * cr * r + cs * s) / 4
    corner_s = cs * (1 + cr * r) * (2 * cs * s + cr * r) / 4
    side = np.hstack([(1 - r**2) * (1 - s), (1 + r) * (1 - s**2),
                      (1 - r**2) * (1 + s), (1 - r) * (1 - s**2)]) / 2  # fmt: skip
    side_r = np.hstack([-2 * r * (1 - s), 1 - s**2, -2 * r * (1 + s), -(1 - s**2)]) / 2
    side_s = np.hstack([-(1 - r**2), -2 * s * (1 + r), 1 - r**2, -2 * s * (1 - r)]) / 2
    return (
        np.hstack([corner, side]),
        np.stack([np.hstack([corner_r, side_r]), np.hstack([corner_s, side_s])], axis=2),
    )


def side_points(shape: Shape, t: Array) -> tuple[Array, Array]:
    """Reference points (q, 2) at ``t`` (q,) in [0, 1] along side 0-1, and d(point)/dt (2,)."""
    if shape is t6:
        return np.column_stack([t, np.zeros_like(t)]), np.array([1.0, 0.0])
    return np.column_stack([2 * t - 1, -np.ones_like(t)]), np.array([2.0, 0.0])


def as_element(mesh: Mesh, element: str) -> tuple[Mesh, Cells]:
    """The mesh with ``element``'s nodes, and its cells ready to integrate."""
    if element in ("T6", "T6M"):
        return mesh, _cells(mesh, mesh.cells, t6, _TRIANGLE, element == "T6M")
    split = _split_q8(mesh) if element == "Q8R" else _split_q4(mesh)
    if element == "Q8R":
        return split, _cells(split, split.cells, q8, _FOUR, False)
    if element == "Q4R":
        plain = _cells(split, split.cells, q4, _ONE, False)
        return split, _with_hourglass(split.nodes, plain)
    if element in ("Q4", "Q4M"):
        return split, _cells(split, split.cells, q4, _FOUR, element == "Q4M")
    raise ValueError(f"element = {element!r}: must be one of {', '.join(ELEMENTS)}")


def quadrature_points(cells: Cells) -> Array:
    """Reference points (q, 2)."""
    return _quadrature(cells)[0]


def _quadrature(cells: Cells) -> tuple[Array, Array]:
    """Reference points (q, 2) and their weights (q,)."""
    return next(q for q in (_TRIANGLE, _FOUR, _ONE) if len(q[1]) == cells.weight.shape[1])


def placed(cells: Cells, nodes: Array) -> Cells:
    """The same elements of a plane section with their ``nodes`` (n, 2) [m] elsewhere."""
    points, weights = _quadrature(cells)
    gradient, det = gradients(nodes, cells.nodes, cells.shape(points)[1])
    moved = replace(cells, gradient=gradient, weight=det * weights)
    return moved if cells.hourglass is None else _with_hourglass(nodes, moved)


def gradients(nodes: Array, cells: Ints, shape_gradient: Array) -> tuple[Array, Array]:
    """dN/dX (m, q, 2, k) [1/m] and the Jacobian's determinant (m, q) [m2]."""
    jacobian = np.swapaxes(shape_gradient, 1, 2) @ nodes[cells][:, None]  # dX_i/dxi_a: (m, q, a, i)
    det = jacobian[..., 0, 0] * jacobian[..., 1, 1] - jacobian[..., 0, 1] * jacobian[..., 1, 0]
    inverse = np.empty_like(jacobian)  # dxi_a/dX_i
    inverse[..., 0, 0], inverse[..., 1, 1] = jacobian[..., 1, 1], jacobian[..., 0, 0]
    inverse[..., 0, 1], inverse[..., 1, 0] = -jacobian[..., 1, 0], -jacobian[..., 0, 1]
    inverse /= det[..., None, None]
    return np.swapaxes(inverse, 2, 3) @ np.swapaxes(shape_gradient, 1, 2), det


def operator(gradient: Array) -> Array:
    """(m, q, 2, k) gradients as the (m, q, 4, 2k) operator of `Cells`."""
    m, q, _, k = gradient.shape
    b = np.zeros((m, q, 2, 2, k, 2))
    b[:, :, 0, :, :, 0] = gradient
    b[:, :, 1, :, :, 1] = gradient
    return b.reshape(m, q, 4, 2 * k)


def _cells(
    mesh: Mesh,
    cells: Ints,
    shape: Shape,
    points: tuple[Array, Array],
    dilatation: bool,
) -> Cells:
    gradient, det = gradients(mesh.nodes, cells, shape(points[0])[1])
    if np.any(det <= 0):
        raise ValueError(f"{int(np.sum(np.any(det <= 0, axis=1)))} elements are turned inside out")
    return Cells(cells, gradient, det * points[1], mesh.region, dilatation, None, shape)


def _with_hourglass(nodes: Array, cells: Cells) -> Cells:
    """Patterns orthogonal to all linear fields (Flanagan and Belytschko 1981, eq. 38)."""
    h = np.array([1.0, -1.0, 1.0, -1.0])
    gradient = cells.gradient[:, 0]  # of the one point
    gamma = h - np.einsum("k,mki,mia->ma", h, nodes[cells.nodes], gradient)
    return replace(cells, hourglass=gamma)


def _split_q4(mesh: Mesh) -> Mesh:
    """Each triangle into three quadrilaterals through its centre and mid-sides."""
    centre = t6(np.full((1, 2), 1 / 3))[0][0]
    middle = np.einsum("k,mki->mi", centre, mesh.nodes[mesh.cells])
    c = len(mesh.nodes) + np.arange(len(mesh.cells))
    n = mesh.cells.T
    quads = np.stack(
        [
            np.stack([n[0], n[3], c, n[5]], axis=1),
            np.stack([n[3], n[1], n[4], c], axis=1),
            np.stack([n[2], n[5], c, n[4]], axis=1),
        ],
        axis=1,
    ).reshape(-1, 4)
    nodes = np.vstack([mesh.nodes, middle])
    # side 0-3-1 of a lumen cell becomes sides 0-1 of its first two quadrilaterals
    lumens = tuple(np.concatenate([3 * cells, 3 * cells + 1]) for cells in mesh.lumens)
    return Mesh(
        nodes, quads, np.repeat(mesh.region, 3), mesh.surface, mesh.bottom, mesh.resting, lumens
    )


def _split_q8(mesh: Mesh) -> Mesh:
    """As `_split_q4`, with mid-side nodes on the quadratic triangle's own geometry."""
    split = _split_q4(mesh)
    corner = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5], [1 / 3, 1 / 3]])
    local = np.array([[0, 3, 6, 5], [3, 1, 4, 6], [2, 5, 6, 4]])
    sides = [(0, 1), (1, 2), (2, 3), (3, 0)]
    quads = split.cells.reshape(-1, 3, 4)
    pairs, places = [], []
    for part in range(3):
        for a, b in sides:
            at = (corner[local[part, a]] + corner[local[part, b]]) / 2
            value = t6(at[None])[0][0]
            places.append(np.einsum("k,mki->mi", value, mesh.nodes[mesh.cells]))
            pairs.append(np.sort(quads[:, part][:, [a, b]], axis=1))
    pair = np.stack(pairs, axis=1).reshape(-1, 2)
    place = np.stack(places, axis=1).reshape(-1, 2)
    _, first, index = np.unique(pair, axis=0, return_index=True, return_inverse=True)
    more = (len(split.nodes) + index.reshape(-1, 3, 4)).astype(np.int64)
    cells = np.concatenate([quads, more], axis=2).reshape(-1, 8)
    nodes = np.vstack([split.nodes, place[first]])
    surface = _between(split.surface, pair[first], len(split.nodes))
    bottom = _between(split.bottom, pair[first], len(split.nodes))
    return Mesh(nodes, cells, split.region, surface, bottom, split.resting, split.lumens)


def _between(ends: Ints, pair: Ints, first: int) -> Ints:
    """``ends``, and between neighbours of them the node that halves their side."""
    order = {int(n): i for i, n in enumerate(ends)}
    places = [(float(i), n) for n, i in order.items()]
    for k in np.flatnonzero(np.isin(pair, ends).all(axis=1)):
        a, b = order[int(pair[k, 0])], order[int(pair[k, 1])]
        places.append(((a + b) / 2, int(first + k)))
    return np.array([n for _, n in sorted(places)], dtype=np.int64)
