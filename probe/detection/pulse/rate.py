"""The rate of one heart in several holds."""

import numpy as np
from scipy.optimize import minimize_scalar

from probe.detection.pulse.estimate import SHARES, Pulse, described
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.noise import WHITE, likeliest
from probe.detection.pulse.pooled_evidence import unusual
from probe.detection.pulse.search import FASTEST_HZ, SLOWEST_HZ, TESTED_HARMONICS, rates_hz

SMOOTH = 0.75
"""Cycles that the last harmonic looked at may gain in a hold from one rate tried to the next: of
more harmonics the likelihood is too narrow a peak."""
CANDIDATES, EXACT_HZ = 4, 1e-3
"""Rates that each way of searching proposes, and how exactly the best of them is wanted."""


def shared_rate(clear: list[tuple[Hold, Pulse]]) -> float:
    """The rate that explains the clearest pulses best, given what rates hearts have."""
    rates = max((rates_hz(hold.span_s) for hold, _ in clear), key=len)

    def unlikely(rate_hz: float, most: int) -> float:
        misfit = sum(_misfit(hold, pulse, rate_hz, most) for hold, pulse in clear)
        return float(unusual(rate_hz)) + misfit

    reach = float(rates[1] - rates[0])
    searches = [pulse.search for _, pulse in clear if pulse.search is not None]
    likely = [
        np.sum([np.interp(rates, s.rates_hz, seen) for s, seen in each], axis=0) - unusual(rates)
        for each in ([(s, s.gain) for s in searches], [(s, s.clear / 2) for s in searches])
    ]
    span_s = max(hold.span_s for hold, _ in clear)
    smooth = int(np.clip(round(SMOOTH / (reach * span_s)), TESTED_HARMONICS + 1, len(SHARES)))
    tried = {int(k) for one in likely for k in np.argsort(one)[-CANDIDATES:]}
    if (
        smooth > TESTED_HARMONICS + 1
    ):  # in a short hold the wave's shape tells more than the search knows
        tried = set(range(len(rates)))
    rate = min((float(rates[k]) for k in tried), key=lambda one: unlikely(one, smooth))
    for most, share in ((smooth, 1.0), (len(SHARES), 0.25)):
        bounds = max(rate - share * reach, SLOWEST_HZ), min(rate + share * reach, FASTEST_HZ)
        found = minimize_scalar(unlikely, bounds=bounds, args=(most,), method="bounded",
                                options={"xatol": EXACT_HZ})  # fmt: skip
        rate = float(found.x)
    return rate


def _misfit(hold: Hold, pulse: Pulse, rate_hz: float, most: int) -> float:
    """Minus the log likelihood, the noise's level and spectrum unknown."""
    one, _ = described(hold, rate_hz, WHITE, pulse.scale, most=most)
    noise = likeliest(one.residual_pa, hold.step_s)
    if noise is not WHITE:
        one, _ = described(hold, rate_hz, noise, pulse.scale, most=most)
    return 0.5 * len(hold.time_s) * float(np.log(max(one.rss, 1e-300)))
