"""The rates of hearts: where a pulse is looked for, and how much of the chance each rate gets."""

import numpy as np
from numpy.typing import ArrayLike

from drivers.core.arrays import Array

SLOWEST_HZ, FASTEST_HZ = 40 / 60, 180 / 60
USUAL_HZ, USUAL_SPREAD = 72 / 60, 0.3
"""Resting hearts: the median rate, and the standard deviation of the logarithm."""
RATE_VARIABILITY = 0.05
"""Standard deviation of one beat's length over the mean's: in people at rest a few per cent."""
EVEN = 0.5
"""Share of the chance that is spread evenly: a heart at an unusual rate then needs at most a
likelihood twice as clear, one at rest half as clear."""


def unusual(rate_hz: ArrayLike) -> Array:
    """Minus the log density of a heart's rate, but for a constant."""
    return np.asarray(0.5 * (np.log(np.asarray(rate_hz) / USUAL_HZ) / USUAL_SPREAD) ** 2)


def weights(rates_hz: Array) -> Array:
    """How much of the chance of a false pulse each rate (r,) may spend, on average 1.

    Half as hearts at rest have them and half evenly: a chance divided by its weight keeps the
    whole one (Genovese, Roeder & Wasserman 2006).
    """
    grid = np.linspace(SLOWEST_HZ, FASTEST_HZ, 1000)
    usual = np.exp(-unusual(rates_hz)) / float(np.exp(-unusual(grid)).mean())
    return EVEN + (1 - EVEN) * usual


def rates_hz(span_s: float) -> Array:
    """Rates to try: four to each resolvable one."""
    count = max(24, int(np.ceil(4 * (FASTEST_HZ - SLOWEST_HZ) * span_s)))
    return np.linspace(SLOWEST_HZ, FASTEST_HZ, count)


def anywhere(one: float, span_s: float) -> float:
    """How often a hold without a pulse shows at its best rate what has the chance ``one`` at a
    given rate: the number of rates that are independent (Davies 1987: crossings of the statistic,
    here about two for each resolvable rate)."""
    return float(-np.expm1(independent_rates(span_s) * np.log1p(-min(one, 1 - 1e-16))))


def independent_rates(span_s: float) -> float:
    """Rates that a hold of ``span_s`` tells apart."""
    return 1 + 2 * (FASTEST_HZ - SLOWEST_HZ) * span_s
