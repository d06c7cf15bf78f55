"""Nested dissection (George 1973): halves first, then what parts them, as a tree of fronts.

In three dimensions the factors of a minimum-degree order hold half as much again.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from sim_backend.arrays import Array, Bools, Ints

LEAF = 60
"""Nodes below which nothing is halved any more."""


@dataclass(frozen=True)
class Front:
    """Nodes ``first`` to ``last`` of the order are eliminated together; ``border`` (b,) are the
    later ones that they then connect. ``children`` number the fronts that this one must follow."""

    first: int
    last: int
    border: Ints
    children: tuple[int, ...]


def dissected(nodes: Array, graph: csr_matrix) -> tuple[Ints, list[Front]]:
    """Order (n,) in which to eliminate ``nodes`` (n, 3), and its fronts, each after its children.

    ``graph`` (n, n) has an entry where two nodes share an element.
    """
    parts: list[_Part] = []
    _halve(np.arange(len(nodes)), nodes, graph, parts)
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


def _halve(part: Ints, nodes: Array, graph: csr_matrix, parts: list[_Part]) -> tuple[int, ...]:
    """Numbers of the fronts at the top of ``part``: one, or more where nothing connects them."""
    best: tuple[int, Bools, Bools] | None = None
    if len(part) > LEAF:
        near = graph[part][:, part]
        for axis in range(3):
            at = nodes[part, axis]
            for cut in np.quantile(at, [0.42, 0.5, 0.58]):
                low = at < cut
                if not 0.25 < low.mean() < 0.75:
                    continue
                between = ~low & (near @ low.astype(np.float32) > 0)
                if best is None or between.sum() < best[0]:
                    best = int(between.sum()), low, between
    children: tuple[int, ...] = ()
    if best is not None:
        _, low, between = best
        below = len(parts)
        halves = [part[low], part[~low & ~between]]
        children = tuple(
            top for half in halves if len(half) for top in _halve(half, nodes, graph, parts)
        )
        if not between.any():
            return children
        part = _alike_together(part[between], parts[below:], len(nodes))
    parts.append(_Part(part, graph[part].indices.astype(np.int64), children))
    return (len(parts) - 1,)


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
