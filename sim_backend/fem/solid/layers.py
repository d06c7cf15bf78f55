"""Layers along z: fine where the finger's end, a lump or a stenosis's end is, coarse elsewhere."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from sim_backend.arrays import Array

_SAMPLES = 400


def graded_edges(breaks: Sequence[float], size: Callable[[Array], Array]) -> Array:
    """Edges (l + 1,) [m] of layers about ``size`` (n,) -> (n,) thick that end at all ``breaks``."""
    edges = [np.array(breaks[:1])]
    for start, end in pairwise(breaks):
        z = np.linspace(start, end, _SAMPLES)
        density = 1 / size(z)
        steps = np.diff(z) * (density[1:] + density[:-1]) / 2
        count = np.concatenate([[0.0], np.cumsum(steps)])
        layers = max(1, round(float(count[-1])))
        edges.append(np.interp(np.linspace(0, count[-1], layers + 1)[1:], count, z))
    return np.concatenate(edges)
