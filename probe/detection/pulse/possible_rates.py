"""The rates of hearts: where a pulse is looked for, and how much of the chance each rate gets."""

import numpy as np
from numpy.typing import ArrayLike

from drivers.core.arrays import Array

SLOWEST_HZ, FASTEST_HZ = 40 / 60, 180 / 60
USUAL_HZ, USUAL_SPREAD = 72 / 60, 0.3
"""Resting hearts: the median rate, and the standard deviation of the logarithm."""
RATE_VARIABILITY = 0.05
"""Standard deviation of one beat's length over the mean's: in people at rest a few per cent."""
CROSSINGS, NUISANCE_S, MIN_RATES = 2.5, 0.9, 5.0
"""Independent rates to a Hz of a hold of a second: sqrt(2 ln(1/p)) 2 pi / sqrt(12) / sqrt(2 pi),
the crossings of a sine's statistic (Davies 1987), at a chance p of 0.002. Level, drift and decays
take what 0.9 s show. With both, of 48,000 holds of white noise of 2 to 10 s at 10 Hz, 0.86 to 1.08
times as many pass at a chance of 0.02 as should, and 0.7 times at 100 Hz; with `MIN_RATES`, below
1.8 s, 0.6 times."""
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
    given rate: at any of the rates that are independent."""
    return float(-np.expm1(independent_rates(span_s) * np.log1p(-min(one, 1 - 1e-16))))


def independent_rates(span_s: float) -> float:
    """How many rates a hold of ``span_s`` looks at as far as chance goes."""
    return max(MIN_RATES, CROSSINGS * (FASTEST_HZ - SLOWEST_HZ) * (span_s - NUISANCE_S))
