"""Pressure in a lumen, on the deformed wall and, in plane stress, on the thinned section.

CalculiX lets the pressure act on the thinned area; without it the pulse is 8 % larger.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem import kernel
from sim_backend.fem.elements import Cells, gradients, operator, side_points
from sim_backend.fem.material import thinning
from sim_backend.fem.mesh import Mesh

_GAUSS = 0.5 + np.array([-0.5, 0.0, 0.5]) * np.sqrt(0.6)
_WEIGHTS = np.array([5, 8, 5]) / 18
# n ds = (-t_y, t_x) dt: from the wall's tangent to the force on it, walking with the wall left
_QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])


@dataclass(frozen=True)
class Sides:
    """The sides of a lumen: their cells' ``dofs`` (s, 2k) and nodes' undeformed places.

    ``value`` (q, k) shape functions and ``along`` (q, k) their derivative along the side;
    ``gradient`` (s, q, 2, k) as in `Cells`; ``shear``, ``bulk`` (s,) [Pa]; ``free`` thickness
    in plane stress.
    """

    nodes: Ints
    dofs: Ints
    place: Array
    value: Array
    along: Array
    gradient: Array
    shear: Array
    bulk: Array
    free: bool

    @cached_property
    def operator(self) -> Array:
        """As of `Cells`."""
        return operator(self.gradient)

    @cached_property
    def spread(self) -> Array:
        """Weights times shape functions (q, k)."""
        return _WEIGHTS[:, None] * self.value

    @cached_property
    def turn(self) -> Array:
        """How the force of each point turns with the side (q, 2k 2k), per thickness."""
        turn = np.einsum("qk,ql,ij->qkilj", self.spread, self.along, _QUARTER)
        return np.asarray(turn.reshape(len(_GAUSS), -1))


def lumen_sides(
    mesh: Mesh, cells: Cells, shear: Array, bulk: Array, free: bool
) -> tuple[Sides, ...]:
    """One `Sides` per lumen; ``shear`` and ``bulk`` (m,) [Pa] of all cells."""
    xi, direction = side_points(cells.shape, _GAUSS)
    value, gradient = cells.shape(xi)
    found = []
    for side in mesh.lumens:
        nodes = cells.nodes[side]
        slope, _ = gradients(mesh.nodes, nodes, gradient)
        found.append(
            Sides(
                nodes,
                cells.dofs[side],
                mesh.nodes[nodes],
                value,
                gradient @ direction,
                slope,
                shear[side],
                bulk[side],
                free,
            )
        )
    return tuple(found)


def flatness(lumens: Iterable[Sides], u: Array) -> float:
    """A lumen's own height over what displacements ``u`` (n, 2) [m] leave of it, the flattest
    one's: 1 at least."""
    most = 1.0
    for one in lumens:
        on_side = np.abs(one.value).max(axis=0) > 0
        before = one.place[:, on_side, 1]
        left = np.ptp(before + u[one.nodes[:, on_side], 1])
        most = max(most, float(np.ptp(before) / left))
    return most


def unit_pressure(sides: Sides, u: Array) -> tuple[Array, Array]:
    """Force (s, 2k) [m] of 1 Pa at displacements ``u`` (n, 2) [m], and its tangent (s, 2k, 2k)."""
    s, k = sides.nodes.shape
    if kernel.BUILT:
        force, stiffness = np.empty((s, 2 * k)), np.empty((s, 2 * k, 2 * k))
        kernel.unit_pressure(
            np.ascontiguousarray(u), sides.nodes, sides.place, sides.spread, sides.along,
            sides.gradient, sides.shear, sides.bulk, sides.free, force, stiffness,
        )  # fmt: skip
        return force, stiffness
    local = u[sides.nodes]
    tangent = sides.along @ (sides.place + local)
    normal = tangent @ _QUARTER.T
    push = (sides.spread[:, :, None] * normal[:, :, None]).reshape(s, len(_GAUSS), 2 * k)
    f = (sides.operator @ local.reshape(s, 1, 2 * k, 1))[..., 0] + np.array([1.0, 0, 0, 1.0])
    if not sides.free:
        stiffness = np.broadcast_to(sides.turn.sum(axis=0), (s, 4 * k * k))
        return push.sum(axis=1), stiffness.reshape(s, 2 * k, 2 * k)
    thickness, thinner = thinning(f, sides.shear[:, None], sides.bulk[:, None])
    force = (thickness[:, None] @ push)[:, 0]
    slimmer = (thinner[:, :, None] @ sides.operator)[:, :, 0]
    turn = (thickness @ sides.turn).reshape(s, 2 * k, 2 * k)
    return force, turn + np.swapaxes(push, 1, 2) @ slimmer
