"""The heart's rate in a scan, with its doubt."""

import numpy as np

from probe.core.finding_words import NORMAL_95
from probe.detection.pulse.possible_rates import RATE_VARIABILITY, SLOWEST_HZ
from probe.detection.pulse.presses import Press

WHOLE_BEAT = 1.2
"""Beats that a hold must have for a rate to be distinguished from slower ones. In 48 scans of TIHA
that beats freely at 45 to 95 /min, holds of 0.6 to 2 s, rates of which fewer fit into the hold were
up to 57 /min too fast, all others at most 2 /min off."""


def heart_rate(presses: tuple[Press, ...]) -> tuple[float, float, float] | None:
    """Rate and its 95 % interval [1/min] from the presses that pulse; None where none does.

    The doubt of one hold is that of a sine's frequency (Rife & Boorstyn 1974) together with the
    heart's own variability over the beats that it saw. Where no hold has `WHOLE_BEAT`, the heart
    may beat as slowly as any that is looked for.
    """
    rates, weights = [], []
    for press in presses:
        if not press.pulsing or press.pulse is None or press.hold_s <= 0:
            continue
        pulse = press.pulse
        phase_sd = pulse.size_sd_pa / max(pulse.size_pa, 1e-12)
        by_noise = np.sqrt(12) * phase_sd / (2 * np.pi * press.hold_s)
        by_heart = pulse.rate_hz * RATE_VARIABILITY / np.sqrt(max(press.hold_s * pulse.rate_hz, 1))
        rates.append(pulse.rate_hz)
        weights.append(1 / (by_noise**2 + by_heart**2))
    if not rates:
        return None
    rate = 60 * float(np.average(rates, weights=weights))
    reach = 60 * NORMAL_95 * float(np.sum(weights) ** -0.5)
    longest_s = max(p.hold_s for p in presses if p.pulsing)
    distinct = rate * longest_s >= 60 * WHOLE_BEAT
    return rate, max(rate - reach, 0.0) if distinct else min(60 * SLOWEST_HZ, rate), rate + reach
