"""Nested dissection (George 1973): halves first, then what parts them, as a tree of fronts.

In three dimensions the factors of a minimum-degree order hold half as much again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix

from sim_backend.arrays import Array, Bools, Ints

LEAF = 60
"""Nodes below which nothing is halved any more."""
CUTS = (0.4, 0.45, 0.5, 0.55, 0.6)
"""Shares of the elements before a cut that are tried along each axis; that through the fewest nodes
is made."""


@dataclass(frozen=True)
class Front:
    """Nodes ``first`` to ``last`` of the order are eliminated together; ``border`` (b,) are the
    later ones that they then connect. ``children`` number the fronts that this one must follow."""

    first: int
    last: int
    border: Ints
    children: tuple[int, ...]


def dissected(
    nodes: Array, elements: Sequence[Ints], graph: csr_matrix
) -> tuple[Ints, list[Front]]:
    """Order (n,) in which to eliminate ``nodes`` (n, 3), and its fronts, each after its children.

    ``elements``, one (m, k) for each number of nodes k, are numbers of nodes, ``graph`` (n, n) has
    an entry where two nodes share an element. The elements are halved, and what both
    halves share parts them: sides of elements only. The nodes beside a cut through the nodes are
    half as many again, since those of quadratic elements are connected two rows far (TIHA-solid's
    second mesh: 18.6 and 30.1 billion operations, 81 and 98 MB of factors).
    """
    parts: list[_Part] = []
    each = [nodes[group].mean(axis=1) for group in elements]
    middles = np.concatenate(each)
    mesh = _Mesh(middles, np.full(nodes.shape, np.inf), np.full(nodes.shape, -np.inf), graph)
    for group, of_group in zip(elements, each, strict=True):
        for ones in group.T:
            np.minimum.at(mesh.first, ones, of_group)
            np.maximum.at(mesh.last, ones, of_group)
    _halve(np.arange(len(middles)), np.arange(len(nodes)), mesh, parts)
    order = np.concatenate([part.nodes for part in parts])
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    fronts: list[Front] = []
    first = 0
    for part in parts:
        last = first + len(part.nodes)
        reached = [place[part.near], *(fronts[c].border for c in part.children)]
        border = np.unique(np.concatenate(reached))
        fronts.append(Front(first, last, border[border >= last], part.children))
        first = last
    return order, fronts


@dataclass(frozen=True)
class _Part:
    """``nodes`` that make a front, those ``near`` them in the graph, and its children's numbers."""

    nodes: Ints
    near: Ints
    children: tuple[int, ...]


class _Mesh(NamedTuple):
    """``middles`` (m, 3) of the elements; ``first`` and ``last`` (n, 3): the smallest and the
    largest of those of each node's elements."""

    middles: Array
    first: Array
    last: Array
    graph: csr_matrix


def _halve(inside: Ints, part: Ints, mesh: _Mesh, parts: list[_Part]) -> tuple[int, ...]:
    """Numbers of the fronts at the top of ``part``, what is left of the nodes of the elements
    ``inside``: one, or more where nothing connects them."""
    children: tuple[int, ...] = ()
    best = None
    if len(part) > LEAF:
        best = _best_cut(mesh.first[part], mesh.last[part], mesh.middles[inside])
    if best is not None:
        before, low, high = best
        below = len(parts)
        halves = ((inside[before], part[low]), (inside[~before], part[high]))
        children = tuple(
            top for ones, half in halves if len(half)
            for top in _halve(ones, half, mesh, parts)
        )  # fmt: skip
        between = ~(low | high)
        if not between.any():
            return children
        part = _alike_together(part[between], parts[below:], len(mesh.first))
    parts.append(_Part(part, mesh.graph[part].indices.astype(np.int64), children))
    return (len(parts) - 1,)


def _best_cut(first: Array, last: Array, middles: Array) -> tuple[Bools, Bools, Bools] | None:
    """The elements (m,) before a cut and the nodes (k,) of those alone and of the others alone;
    None where no cut leaves a fifth of the nodes to either. ``first`` and ``last`` (k, 3)."""
    count = len(first)
    best, fewest = None, count + 1
    for axis, cuts in enumerate(np.quantile(middles, CUTS, axis=0).T):
        for cut in np.unique(cuts):
            low, high = last[:, axis] < cut, first[:, axis] >= cut
            before, after = int(low.sum()), int(high.sum())
            between = count - before - after
            if between < fewest and min(before, after) > 0.2 * count:
                best, fewest = (middles[:, axis] < cut, low, high), between
    return best


def _alike_together(between: Ints, below: list[_Part], count: int) -> Ints:
    """The nodes ``between`` two halves, ordered by the first and the last of the parts ``below``
    that they are next to.

    What is next to one part then follows one another in the fronts above it, and is added to them
    in a tenth as many blocks as in the order of the nodes (TIHA-solid's second mesh; Pichon et al.
    2017 reorder a supernodal solver's separators for the same).
    """
    first, last = np.zeros((2, count), dtype=np.int64)
    for number, part in enumerate(below):
        last[part.near] = number
    for number, part in reversed(list(enumerate(below))):
        first[part.near] = number
    return between[np.lexsort((last[between], first[between]))]
