"""Evidence pooled over neighbouring presses, for a pulse that is too faint for each alone."""

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc, chdtri

from drivers.core.arrays import Array
from probe.detection.pulse.possible_rates import anywhere, unusual, weights
from probe.detection.pulse.search import Search

COHERENT = 0.95
"""What a wave of one steady rate sees of a pulse whose beats vary by 4 to 6 % in a hold of 5 s."""
LESS_CLEAR = 0.25
"""Of a row's holds. Of 120 faint pulses in white noise of 1.7 to 5 s 79 % are found by a quarter of
them and 64 % by half; of 200 rows without a pulse, in white noise and random walks, 3 and 4."""


def usual_excess(searches: Sequence[Search]) -> float:
    """How much clearer than in white noise holds are at most rates, at least 1: tremor that is
    not quite the noise that was fitted adds up over stations.

    It is that of the `LESS_CLEAR` holds, which do not pulse: a wide vessel pulses in half of a row.
    """
    usual = np.quantile([np.median(s.clear) for s in searches], LESS_CLEAR)
    return max(1.0, float(usual / chdtri(2, 0.5)))


def shared_chance(searches: Sequence[Search], excess: float) -> float:
    """How often holds without a pulse are together as clear at one rate as these: the sum of their
    chi-squares (Fisher 1925) over ``excess``."""
    longest = max(searches, key=lambda s: s.span_s)
    rates = longest.rates_hz
    total = np.sum([np.interp(rates, s.rates_hz, s.clear) for s in searches], axis=0)
    one = chdtrc(2 * len(searches), total / excess) / weights(rates)
    return anywhere(float(one.min()), longest.span_s)


def hidden(searches: Sequence[Search], profile: Array, size_pa: Array) -> Array:
    """Likelihood (n,) of pulses of ``size_pa`` (n,) over that of none, given all holds.

    ``profile`` (holds,) is each hold's share of the size. Phases are unknown and each hold's own,
    the rate is shared and as hearts' are. Each hold's noise is any that counts in it.
    """
    longest = max(searches, key=lambda s: s.span_s)
    usual = -unusual(longest.rates_hz)
    usual -= np.logaddexp.reduce(usual)
    excess = usual_excess(searches)
    ratio = np.zeros((len(size_pa), len(usual)))
    for one, share in zip(searches, profile, strict=True):
        size = COHERENT * share * size_pa[:, None, None, None]
        each = (size * one.along - 0.5 * size**2 * one.power) / excess + one.noises[:, None, None]
        top = each.max(axis=(1, 3), keepdims=True)
        here = np.log(np.exp(each - top).mean(axis=3).sum(axis=1)) + top[:, 0, :, 0]
        same = len(one.rates_hz) == len(usual)
        at = one.rates_hz
        ratio += here if same else np.array([np.interp(longest.rates_hz, at, r) for r in here])
    return np.asarray(np.exp(np.logaddexp.reduce(ratio + usual, axis=1)))
