"""The least pulse that a hold would have shown."""

import numpy as np
from scipy.special import fdtri, ncfdtrinc

from probe.detection.pulse.pooled_evidence import COHERENT
from probe.detection.pulse.possible_rates import independent_rates, unusual, weights
from probe.detection.pulse.search import SHARE, Search

POWER = 0.9
"""Of the holds with such a pulse at one rate and phase, how many show it."""
HEARTS = 0.75
"""Of the rates and phases that hearts have, for how many."""
DEGREES = 2
"""Of a pulse of the known shape: size and phase."""


def chance_each(false_alarm: float, presses: int) -> float:
    """Of the chance of a false pulse in a scan, that of each of its presses by itself; with more
    than one, half is for neighbours together."""
    return false_alarm / max(presses, 1) / (2 if presses > 1 else 1)


def least_pulse_pa(search: Search, chance: float) -> float:
    """Size of a pulse, trough to crest, that most such holds would show [Pa].

    ``chance`` is that of a false pulse in the hold. At each rate and phase the search's own F test
    passes with `POWER` at some size, by the noise that it found (the noncentral F distribution,
    Patnaik 1949); `HEARTS` of these sizes are smaller. It counts neither the presses beside it,
    which may pass together, nor what else than a pulse may have moved.
    """
    each = -np.expm1(np.log1p(-SHARE["shaped"] * chance) / independent_rates(search.span_s))
    left = search.dof - DEGREES
    limit = fdtri(DEGREES, left, 1 - np.minimum(weights(search.rates_hz) * each, 0.5))
    wanted = ncfdtrinc(DEGREES, left, 1 - POWER, limit)
    size_pa = np.sqrt(wanted[:, None] / np.maximum(search.power[0], 1e-300)) / COHERENT
    hearts = np.broadcast_to(np.exp(-unusual(search.rates_hz))[:, None], size_pa.shape).ravel()
    order = np.argsort(size_pa, axis=None)
    share = np.cumsum(hearts[order])
    return float(size_pa.ravel()[order][np.searchsorted(share, HEARTS * share[-1])])
