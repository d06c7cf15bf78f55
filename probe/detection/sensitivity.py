"""Can a sensor see a pulse? The Cramér-Rao bound of its size in one hold, and what would help.

The bound is that of any unbiased estimator (Rao 1945) for a sine of known rate and unknown phase in
white noise, beside a level and a drift: a short hold spends part of what it knows on telling the
pulse from them. If the fitted relaxation has the wrong sign, more information is lost and the bound
is optimistic.
"""

from dataclasses import dataclass
from math import ceil, inf

import numpy as np

from probe.core.finding_words import plain

SIGMAS = 5.0
HOLDS_S = tuple(float(h) for h in np.geomspace(0.5, 120.0, 60))
MAX_SAMPLES = 4000


@dataclass(frozen=True)
class Visibility:
    """Peak-to-peak pulses [N]: ``pulse_n`` expected, ``smallest_n`` that one hold shows at 5 sigma.

    ``hold_s`` and ``beats`` would show it in one hold (inf: not within two minutes), ``repeats`` of
    the hold as it is would by averaging.
    """

    pulse_n: float
    smallest_n: float
    hold_s: float
    beats: float
    repeats: float

    @property
    def visible(self) -> bool:
        return self.pulse_n >= self.smallest_n


def bound_n(noise_n: float, rate_hz: float, hold_s: float, beat_hz: float) -> float:
    """Standard deviation of a pulse's size from trough to crest [N], at best."""
    n = max(int(rate_hz * hold_s), 12)
    kept = min(n, MAX_SAMPLES)
    t = np.linspace(0.0, hold_s, kept)
    turn = 2 * np.pi * beat_hz * t
    nuisance, _ = np.linalg.qr(np.column_stack([np.ones(kept), t / hold_s]))
    beat = np.column_stack([np.cos(turn), np.sin(turn)])
    beat = beat - nuisance @ (nuisance.T @ beat)
    covariance = np.linalg.pinv(beat.T @ beat) * noise_n**2 * kept / n
    return float(2 * np.sqrt(0.5 * np.trace(covariance)))


def visibility(
    noise_n: float, rate_hz: float, hold_s: float, pulse_n: float, beat_hz: float
) -> Visibility:
    """Whether ``pulse_n`` shows under a sensor of ``noise_n`` rms at ``rate_hz``."""
    smallest = SIGMAS * bound_n(noise_n, rate_hz, hold_s, beat_hz)
    long_enough = inf
    if pulse_n > 0:
        long_enough = next(
            (h for h in HOLDS_S if SIGMAS * bound_n(noise_n, rate_hz, h, beat_hz) <= pulse_n), inf
        )
    repeats = inf if pulse_n <= 0 else float(ceil((smallest / pulse_n) ** 2))
    return Visibility(pulse_n, smallest, long_enough, long_enough * beat_hz, max(repeats, 1.0))


def in_words(seen: Visibility, face_m2: float | None = None) -> str:
    """One sentence, in mN and, with the probe's face, in Pa."""

    def size(force_n: float) -> str:
        pa = f" ({plain(force_n / face_m2, 3)} Pa)" if face_m2 else ""
        return f"{plain(1e3 * force_n, 3)} mN{pa}"

    text = f"expected {size(seen.pulse_n)}; one hold shows {size(seen.smallest_n)} or more"
    if seen.visible:
        return f"yes: {text}"
    helps = [f"{seen.repeats:.0f} repeats"] if seen.repeats < 1000 else []
    if seen.hold_s < inf:
        helps.insert(0, f"a hold of {seen.hold_s:.2g} s ({seen.beats:.0f} beats)")
    what = " or ".join(helps) if helps else "only a quieter sensor or a larger face"
    return f"no: {text}; {what} would show it"
