"""The heart rate in a scan, with its interval."""

import numpy as np

from probe.core.finding_words import NORMAL_95
from probe.detection.pulse.possible_rates import FASTEST_HZ, SLOWEST_HZ
from probe.detection.pulse.presses import Press

WHOLE_BEAT = 1.2
"""Beats that a hold must have for a rate to be distinguished from slower ones. In 48 scans of TIHA
that beats freely at 45 to 95 /min, holds of 0.6 to 2 s, rates of which fewer fit into the hold were
up to 57 /min too fast, all others at most 2 /min off."""
MOST_BEATS = 1.6
"""Beats that a hold may have had in which fewer than `WHOLE_BEAT` are found: tissue that relaxes
looks like a slow heart. Of 544 rows of benchmarks/heart_rates.py 135 were found so, with 0.81 to
1.37 beats, and of 445 of another author's waves and relaxation 133, with 0.80 to 1.63. Where more
were found the interval held the rate in all 409 and 312."""


def heart_rate(presses: tuple[Press, ...]) -> tuple[float, float, float] | None:
    """Rate and its 95 % interval [1/min] from the presses that pulse; None where none does.

    The doubt of one hold is that of a sine's frequency (Rife & Boorstyn 1974) together with the
    heart's own variability, what all holds show of it, over the beats that it saw. Where no hold
    has `WHOLE_BEAT`, the heart may beat as slowly as any that is looked for, and so fast that the
    longest has `MOST_BEATS`; unless a reference says how fast.
    """
    rates, weights = [], []
    pulsing = [
        (press, press.pulse) for press in presses
        if press.pulsing and press.pulse is not None and press.hold_s > 0
    ]  # fmt: skip
    if not pulsing:
        return None
    variability = float(np.sqrt(np.mean([pulse.variability**2 for _, pulse in pulsing])))
    for press, pulse in pulsing:
        phase_sd = pulse.size_sd_pa / max(pulse.size_pa, 1e-12)
        by_noise = np.sqrt(12) * phase_sd / (2 * np.pi * press.hold_s)
        beats = max(press.hold_s * pulse.rate_hz, 1)
        by_heart = pulse.rate_hz * variability / np.sqrt(beats)
        rates.append(pulse.rate_hz)
        weights.append(1 / (by_noise**2 + by_heart**2))
    rate = 60 * float(np.average(rates, weights=weights))
    reach = 60 * NORMAL_95 * float(np.sum(weights) ** -0.5)
    longest_s = max(p.hold_s for p in presses if p.pulsing)
    known = any(pulse.search is None for _, pulse in pulsing)  # by a reference
    if known or rate * longest_s >= 60 * WHOLE_BEAT:
        return rate, max(rate - reach, 0.0), rate + reach
    highest = 60 * min(MOST_BEATS / longest_s, FASTEST_HZ)
    return rate, min(60 * SLOWEST_HZ, rate), max(rate + reach, highest)
