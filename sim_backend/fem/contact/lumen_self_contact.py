"""A lumen that closes: its upper wall comes to rest on its lower wall.

Upper nodes meet lower sides (node to segment, one pass, so that nothing is constrained twice),
frictionless. The pressure goes on acting between walls that touch, as a film of blood would.
In a solid that is so within each plane of nodes across the vessel. Where walls that touch lean
along the vessel by a slope and slip past each other along it, what a gap is off by is the product.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from sim_backend.arrays import Array, Bools, Ints
from sim_backend.fem.contact.pairs import node_dofs
from sim_backend.fem.lumen import Sides
from sim_backend.fem.mesh import Mesh


@dataclass(frozen=True)
class Walls:
    """``nodes`` (l,) once round the lumen, the lumen to their right; ``dofs`` (1, 2l), of a solid
    (1, 3l) direction by direction.

    ``upper`` (a,) index the nodes that face down, ``lower`` (b,) the first nodes of sides that
    face up.
    """

    nodes: Ints
    dofs: Ints
    upper: Ints
    lower: Ints

    @cached_property
    def begins(self) -> Bools:
        """Which sides (b,) of the lower wall have none before them."""
        return ~np.isin(self.lower - 1, self._wrapped)

    @cached_property
    def ends(self) -> Bools:
        """Which sides (b,) of the lower wall have none after them."""
        return ~np.isin(self.lower + 1, self._wrapped)

    @property
    def _wrapped(self) -> Ints:
        count = len(self.nodes)
        return np.concatenate([self.lower - count, self.lower, self.lower + count])


def walls(mesh: Mesh, sides: Sides) -> Walls:
    """The walls of one lumen of a section, in order round it."""
    k = sides.nodes.shape[1]
    path = [0, 1] if k == 4 else [0, 3, 1] if k == 6 else [0, 4, 1]
    (found,) = walls_along(sides.nodes[:, path], mesh.nodes)
    return found


def walls_along(paths: Ints, place: Array) -> list[Walls]:
    """The walls along ``paths`` (s, k) of nodes at ``place`` (n, d) [m], one for each way round a
    lumen that they join to."""
    follows = {int(a): int(b) for path in paths for a, b in pairwise(path)}
    found = []
    while follows:
        first = min(follows)
        loop = [first]
        while (node := follows.pop(loop[-1])) != first:
            loop.append(node)
        nodes = np.array(loop)
        height = place[nodes, 1]
        middle = (height.max() + height.min()) / 2
        low = height < middle + 1e-9
        lower = np.flatnonzero(low & np.roll(low, -1))
        dofs = node_dofs(nodes, place.shape[1]).T if place.shape[1] == 3 else node_dofs(nodes)
        found.append(
            Walls(nodes, dofs.reshape(1, -1), np.flatnonzero(height > middle + 1e-9), lower)
        )
    return found


@dataclass(frozen=True)
class NearestWalls:
    """``gap`` (a,) [m] from each upper node to the lower wall, its ``normal`` (a, 2) there, and
    where: between nodes ``first`` and ``second`` (a,) of the loop, at a ``share`` (a,) of the way.
    """

    gap: Array
    normal: Array
    first: Ints
    second: Ints
    share: Array


def nearest_walls(both: Walls, place: Array) -> NearestWalls:
    """What lies opposite each upper node for ``place`` (l, 2).

    The normal goes evenly from node to node, so that nothing jumps where a node slides from side
    to side. A node that lies past an end of the lower wall is its neighbour round the bend and
    cannot meet it: its gap is the distance."""
    a = place[both.upper]
    start, end = place[both.lower], place[(both.lower + 1) % len(place)]
    side = end - start
    length = np.maximum(np.hypot(*side.T), 1e-12)
    share = np.einsum("abi,bi->ab", a[:, None] - start, side) / length**2
    share = np.clip(share, 0.0, 1.0)
    foot = start + share[..., None] * side
    nearest = np.argmin(np.hypot(*np.moveaxis(a[:, None] - foot, 2, 0)), axis=1)
    row = np.arange(len(a))
    s = share[row, nearest]
    normal = _normals(place)
    first = both.lower[nearest]
    second = (first + 1) % len(place)
    normal = (1 - s)[:, None] * normal[first] + s[:, None] * normal[second]
    normal /= np.hypot(*normal.T)[:, None]
    offset = a - foot[row, nearest]
    gap = np.einsum("ai,ai->a", offset, normal)
    past = (s == 0) & both.begins[nearest] | (s == 1) & both.ends[nearest]
    return NearestWalls(np.where(past, np.hypot(*offset.T), gap), normal, first, second, s)


def wall_gaps(both: Walls, place: Array) -> tuple[Array, Array]:
    """Gap (a,) [m] from each upper node to the lower wall for ``place`` (l, 2), and its gradient
    (a, 2l) by the loop's displacements, the normal fixed."""
    found = nearest_walls(both, place)
    row, normal = np.arange(len(both.upper)), found.normal
    gradient = np.zeros((len(row), len(place), 2))
    gradient[row, both.upper] += normal
    gradient[row, found.first] -= (1 - found.share)[:, None] * normal
    gradient[row, found.second] -= found.share[:, None] * normal
    return found.gap, gradient.reshape(len(row), -1)


def _normals(place: Array) -> Array:
    """At each node (l, 2) the mean normal of its two sides, into the lumen."""
    chord = np.roll(place, -1, axis=0) - np.roll(place, 1, axis=0)
    across = np.stack([chord[:, 1], -chord[:, 0]], axis=1)
    return np.asarray(across / np.hypot(*chord.T)[:, None])
