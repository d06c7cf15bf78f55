"""The least pulse that a hold would have shown."""

import numpy as np
from scipy.optimize import brentq
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

    ``chance`` is that of a false pulse in the hold. At each rate and phase the search's F test
    passes with `POWER` if the pulse raises the log likelihood ratio by ``wanted`` (the noncentral F
    distribution, Patnaik 1949). A hold without it is as likely as its noises leave the pulse
    unexplained: one of a low frequency explains much of a pulse in a short hold. For `HEARTS` of
    the rates and phases the size suffices. It counts neither the presses beside it, which may pass
    together, nor what else than a pulse may have moved.
    """
    each = -np.expm1(np.log1p(-SHARE["shaped"] * chance) / independent_rates(search.span_s))
    dof = search.dof - DEGREES
    limit = fdtri(DEGREES, dof, 1 - np.minimum(weights(search.rates_hz) * each, 0.5))
    wanted = 0.5 * dof * np.log1p(ncfdtrinc(DEGREES, dof, 1 - POWER, limit) / dof)[:, None]
    hearts = np.exp(-unusual(search.rates_hz))

    def hidden(log_size: float) -> float:
        power = (np.exp(log_size) * COHERENT) ** 2 * search.power / dof
        unexplained = search.noises[:, None, None] - 0.5 * dof * np.log1p(power)
        gain = -np.logaddexp.reduce(unexplained, axis=0)
        return float(HEARTS - hearts @ (gain >= wanted).mean(axis=1) / hearts.sum())

    # in the noise that explains least of it, and in the one that explains most
    bounds = [
        0.5 * np.log(dof * np.expm1(2 * gain / dof) / max(power, 1e-300)) - np.log(COHERENT)
        for gain, power in (
            (wanted.min(), search.power.max()), (wanted.max(), search.power.min())
        )
    ]  # fmt: skip
    if hidden(bounds[1]) > 0:  # samples this sparse show nothing of most of these pulses
        return float(np.exp(bounds[1]))
    return float(np.exp(brentq(hidden, bounds[0] - 1e-3, bounds[1], xtol=1e-3)))
