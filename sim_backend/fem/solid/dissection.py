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
    parts: list[tuple[Ints, tuple[int, ...]]] = []
    _halve(np.arange(len(nodes)), nodes, graph, parts)
    order = np.concatenate([part for part, _ in parts])
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    fronts: list[Front] = []
    first = 0
    for part, children in parts:
        last = first + len(part)
        reached = [place[graph[part].indices], *(fronts[c].border for c in children)]
        border = np.unique(np.concatenate(reached))
        fronts.append(Front(first, last, border[border >= last], children))
        first = last
    return order, fronts


def _halve(
    part: Ints, nodes: Array, graph: csr_matrix, parts: list[tuple[Ints, tuple[int, ...]]]
) -> int:
    """Number of the front at the top of ``part``."""
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
    if best is None:
        parts.append((part, ()))
        return len(parts) - 1
    _, low, between = best
    halves = [part[low], part[~low & ~between]]
    children = tuple(_halve(half, nodes, graph, parts) for half in halves if len(half))
    parts.append((part[between], children))
    return len(parts) - 1
