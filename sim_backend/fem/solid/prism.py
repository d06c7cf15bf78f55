"""A section's mesh extruded along z into 18-node wedges: six-node triangles times quadratic lines.

All nodes of a wedge's quadrilateral faces carry positive shares of an even pressure (1, 4 and 16
thirty-sixths), which nodal contact needs; serendipity wedges and hexahedra do not have that.
"""

from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.elements import t6

_TRIANGLE = np.array([[1 / 6, 1 / 6], [2 / 3, 1 / 6], [1 / 6, 2 / 3]])
_GAUSS = np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
_GAUSS_WEIGHTS = np.array([5, 8, 5]) / 9


@dataclass(frozen=True)
class Wedges:
    """``cells`` (m, 18) of ``nodes`` (n, 3) [m], ready to integrate over the undeformed body.

    ``gradient`` (m, 9, 18, 3) dN/dX [1/m]; ``weight`` (m, 9) [m3].
    """

    nodes: Array
    cells: Ints
    gradient: Array
    weight: Array

    @property
    def dofs(self) -> Ints:
        """(m, 54): displacement numbers of each wedge, by direction."""
        return (3 * self.cells[:, None] + np.arange(3)[:, None]).reshape(len(self.cells), -1)


def line(zeta: Array) -> tuple[Array, Array]:
    """Values and slopes (q, 3) of the quadratic line at ``zeta`` (q,) in [-1, 1]."""
    value = np.stack([zeta * (zeta - 1) / 2, 1 - zeta**2, zeta * (zeta + 1) / 2], axis=1)
    return value, np.stack([zeta - 0.5, -2 * zeta, zeta + 0.5], axis=1)


def planes_of(edges: Array) -> Array:
    """Heights (2l + 1,) of the node planes of the layers between ``edges`` (l + 1,)."""
    planes = np.empty(2 * len(edges) - 1)
    planes[::2], planes[1::2] = edges, (edges[1:] + edges[:-1]) / 2
    return planes


def extrude(nodes: Array, cells: Ints, edges: Array) -> tuple[Array, Ints]:
    """Nodes ((2l + 1) n, 3), plane by plane, and wedges (l, m, 18) of section ``nodes`` (n, 2)
    and ``cells`` (m, 6)."""
    planes, count = planes_of(edges), len(nodes)
    z = np.repeat(planes, count)
    placed = np.column_stack([np.tile(nodes, (len(planes), 1)), z])
    first = 2 * np.arange(len(edges) - 1)[:, None, None, None] * count
    above = np.arange(3)[None, None, :, None] * count
    wedges = first + above + cells[None, :, None, :]
    return placed, wedges.reshape(len(edges) - 1, len(cells), 18)


def wedge_gradient(flat: Array, height: Array) -> Array:
    """Gradients (q, 18, 3) at triangle points ``flat`` (q, 2) and ``height`` (q,) in [-1, 1]."""
    value, slope = t6(flat)
    along, rise = line(height)
    parts = ((along, slope[..., 0]), (along, slope[..., 1]), (rise, value))
    return np.stack([np.einsum("qa,qi->qai", *one).reshape(-1, 18) for one in parts], axis=-1)


def quad_shape() -> tuple[Array, Array, Array, Array]:
    """Values, slopes by z and along the side (9, 9) and weights (9,) of three nodes of a side times
    three planes."""
    value, rise = line(_GAUSS)
    parts = ((value, value), (rise, value), (value, rise))
    n, by_z, by_side = (np.einsum("pa,qi->pqai", *one).reshape(9, 9) for one in parts)
    return n, by_z, by_side, np.outer(_GAUSS_WEIGHTS, _GAUSS_WEIGHTS).ravel()


def triangle_shape() -> tuple[Array, Array, Array, Array]:
    """Values, slopes by both coordinates (3, 6) and weights (3,) of a six-node triangle."""
    value, slope = t6(_TRIANGLE)
    return value, slope[..., 0], slope[..., 1], np.full(3, 1 / 6)


def wedges_of(nodes: Array, cells: Ints) -> Wedges:
    """Raises ValueError where wedges are turned inside out."""
    slope = wedge_gradient(np.tile(_TRIANGLE, (3, 1)), np.repeat(_GAUSS, 3))
    weight = np.repeat(_GAUSS_WEIGHTS, 3) / 6
    place = nodes[cells]
    jacobian = np.einsum("qka,mki->mqia", slope, place, optimize=True)
    det = np.linalg.det(jacobian)
    if np.any(det <= 0):
        raise ValueError(f"{int(np.sum(np.any(det <= 0, axis=1)))} wedges are turned inside out")
    gradient = slope[None] @ np.linalg.inv(jacobian)
    return Wedges(nodes, cells, gradient, det * weight)
