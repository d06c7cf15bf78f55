"""Elimination order by nested dissection (George 1973): halves first, then what parts them.

In three dimensions the factors of a minimum-degree order hold half as much again.
"""

import numpy as np
from scipy.sparse import csr_matrix

from sim_backend.arrays import Array, Bools, Ints

_LEAF = 40
"""Nodes below which nothing is halved any more."""


def nested_dissection(nodes: Array, cells: Ints) -> Ints:
    """Order (n,) in which to eliminate ``nodes`` (n, 3) that ``cells`` (m, k) connect."""
    n, (m, k) = len(nodes), cells.shape
    belongs = csr_matrix((np.ones(m * k), (cells.ravel(), np.repeat(np.arange(m), k))), (n, m))
    graph = (belongs @ belongs.T).tocsr()
    order: list[Ints] = []
    _halve(np.arange(n), nodes, graph, order)
    return np.concatenate(order)


def _halve(part: Ints, nodes: Array, graph: csr_matrix, order: list[Ints]) -> None:
    if len(part) <= _LEAF:
        order.append(part)
        return
    best: tuple[int, Bools, Bools] | None = None
    near = graph[part][:, part]
    for axis in range(3):
        at = nodes[part, axis]
        for cut in np.quantile(at, [0.42, 0.5, 0.58]):
            low = at < cut
            if not 0.25 < low.mean() < 0.75:
                continue
            parts = ~low & (near @ low.astype(float) > 0)
            if best is None or parts.sum() < best[0]:
                best = int(parts.sum()), low, parts
    if best is None:
        order.append(part)
        return
    _, low, parts = best
    _halve(part[low], nodes, graph, order)
    _halve(part[~low & ~parts], nodes, graph, order)
    order.append(part[parts])
