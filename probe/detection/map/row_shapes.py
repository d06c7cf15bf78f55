"""The model of a row of stations: a tilted, curved level with edges, and bumps."""

import numpy as np

from drivers.core.arrays import Array
from probe.detection.repeats import MIN_NAMED, pitch_m

EDGE_PITCHES, EDGE_M = 0.45, 1.8e-3
"""How far the free sides of a block lower its level (an exponential): in station distances, and at
least. Under the paper's finger a plane section of 16.8 mm shows 1.6 to 2.0 mm."""
CURVATURE, EDGE = 0.2, 0.3
"""Prior standard deviations over the level: of the square over the row's length, and of an edge."""
LEAST_LEVEL = 1e-6
"""Over the largest: a row that is as uneven as this shows that nothing is pressed."""
TAIL, OTHER_TAILS = 1.5, (1.0, 50.0)
"""Of a bump's `shape`: what is fitted, and what it may be as well, a Lorentzian or (to 0.3 % of its
height) a Gaussian."""


def shape(
    x_m: Array, centre: Array | float, half_width: Array | float, tail: float = TAIL
) -> Array:
    """The bump that an inclusion makes: between a Gaussian and a Lorentzian."""
    return np.asarray((1 + ((x_m - centre) / half_width) ** 2 / tail) ** -tail)


def step(x_m: Array, middle: Array | float, width: Array | float) -> Array:
    """A level that is higher on one side, as over a bone's edge."""
    return np.asarray(np.tanh((x_m - middle) / width))


def surroundings(x_m: Array) -> Array:
    """Columns (n, 3 or 5) of a tilted, curved level, of 9 stations or more also its two edges."""
    columns = with_edges(x_m)
    return columns if len(x_m) >= MIN_NAMED else columns[:, :3]


def with_edges(x_m: Array) -> Array:
    """Columns (n, 5) of a tilted, curved level and of its two edges."""
    u = (x_m - x_m.mean()) / np.ptp(x_m)
    reach_m = max(EDGE_PITCHES * pitch_m(x_m), EDGE_M)
    edges = [np.exp(-np.abs(x_m - end) / reach_m) for end in (x_m[0], x_m[-1])]
    return np.column_stack([np.ones_like(u), u, u**2, *edges])


def floor(x_m: Array) -> Array:
    """The column (n, 1) of what noise alone makes of a size: the same everywhere."""
    return np.ones((len(x_m), 1))


def level_of(value: Array) -> float:
    """The usual one, above 0 also where a sensor reads less than none."""
    return max(float(np.median(value)), LEAST_LEVEL * float(np.abs(value).max())) or 1.0
