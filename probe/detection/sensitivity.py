"""Can a scan see a pulse? What detection itself would need, and what would help.

A hold over nothing, with this sensor's noise, goes through the search that detection uses. The
least pulse that it says to show is the answer before a scan, as it is in the finding after one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, inf

import numpy as np

from drivers.core.arrays import Array
from probe.core.false_alarm import DEFAULT_FALSE_ALARM
from probe.core.finding_words import plain
from probe.detection.pulse.hold_samples import BIN_S, Hold
from probe.detection.pulse.least_pulse import chance_each, least_pulse_pa
from probe.detection.pulse.search import search
from probe.detection.pulse.shared_noise import noise_priors

HOLDS_S = tuple(float(h) for h in np.geomspace(0.5, 120.0, 25))
LONGEST_S = 5.0
"""Longest hold that is searched: from there on the least pulse falls as the root of time does (in
10 s it is 0.70 of that in 5 s)."""
SEEDS, MAX_HOLDS = 3, 15
"""Holds over nothing whose median is taken, of one press and of a scan."""


Relaxation = tuple[tuple[float, float], ...]
"""Pairs of a share of the force and the time [s] in which it relaxes."""
MEAT: Relaxation = ((0.179, 0.281), (0.167, 1.24), (0.277, 8.10))
"""Median fit of 117 indentation curves of meat (`benchmarks/real_data.py`)."""
LEVEL_OVER_NOISE = 1000.0
"""Of a press into relaxing tissue. At a tenth of it the least pulse is 8 to 11 % smaller in holds
of 0.8 to 1.7 s and the same in 5 s."""


@dataclass(frozen=True)
class Visibility:
    """Peak-to-peak pulses [N]: ``pulse_n`` expected, ``smallest_n`` that detection would show.

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


@lru_cache(maxsize=256)
def smallest_n(
    noise_n: float, rate_hz: float, hold_s: float, presses: int = 1, relaxation: Relaxation = MEAT
) -> float:
    """The least pulse from trough to crest [N] that nine of ten scans of so many presses show, by a
    sensor of ``noise_n`` rms at ``rate_hz`` [1/s] in holds of ``hold_s``."""
    searched_s = min(hold_s, LONGEST_S)
    each = max(1, round(rate_hz * BIN_S))
    count = max(int(rate_hz * searched_s) // each, 8)
    time_s: Array = np.asarray((np.arange(count) + 0.5) * each / rate_hz, float)
    noise = noise_n / np.sqrt(each)
    chance = chance_each(DEFAULT_FALSE_ALARM if presses == 1 else DEFAULT_FALSE_ALARM / 2, presses)
    relaxed = sum((g * np.expm1(-time_s / tau_s) for g, tau_s in relaxation), np.zeros(count))
    level = LEVEL_OVER_NOISE * noise_n * (1 + relaxed)
    drawn = np.random.default_rng(0).standard_normal((min(max(presses, SEEDS), MAX_HOLDS), count))
    holds = [Hold(time_s, level + noise * one, np.ones(count), 0.0, 0.0) for one in drawn]
    priors = noise_priors(holds) if presses > 1 else [None] * len(holds)
    shown = [
        least_pulse_pa(search(hold, prior)[0], chance)
        for hold, prior in zip(holds, priors, strict=True)
    ]
    return float(np.median(shown)) * float(np.sqrt(searched_s / hold_s))


def visibility(
    noise_n: float, rate_hz: float, hold_s: float, pulse_n: float, beat_hz: float,
    presses: int = 1, relaxation: Relaxation = MEAT,
) -> Visibility:  # fmt: skip
    """Whether ``pulse_n`` shows under a sensor of ``noise_n`` rms at ``rate_hz`` in a scan of so
    many ``presses`` into tissue of this ``relaxation``."""

    def shows(held_s: float) -> bool:
        return smallest_n(noise_n, rate_hz, held_s, presses, relaxation) <= pulse_n

    smallest = smallest_n(noise_n, rate_hz, hold_s, presses, relaxation)
    long_enough = _first(HOLDS_S, shows) if pulse_n > 0 else inf
    repeats = inf if pulse_n <= 0 else float(ceil((smallest / pulse_n) ** 2))
    return Visibility(pulse_n, smallest, long_enough, long_enough * beat_hz, max(repeats, 1.0))


def _first(holds_s: Sequence[float], shows: Callable[[float], bool]) -> float:
    """The shortest hold that shows a pulse, if longer ones do; inf without one."""
    low, high = 0, len(holds_s)
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if shows(holds_s[middle]) else (middle + 1, high)
    return holds_s[low] if low < len(holds_s) else inf


def in_words(seen: Visibility, face_m2: float | None = None) -> str:
    """One sentence, in mN and, with the probe's face, in Pa."""

    def size(force_n: float) -> str:
        pa = f" ({plain(force_n / face_m2, 3)} Pa)" if face_m2 else ""
        return f"{plain(1e3 * force_n, 3)} mN{pa}"

    text = f"expected {size(seen.pulse_n)}; a scan shows {size(seen.smallest_n)} or more"
    if seen.visible:
        return f"yes: {text}"
    helps = [f"{seen.repeats:.0f} repeats"] if seen.repeats < 1000 else []
    if seen.hold_s < inf:
        helps.insert(0, f"a hold of {seen.hold_s:.2g} s ({seen.beats:.0f} beats)")
    what = " or ".join(helps) if helps else "only a quieter sensor or a larger face"
    return f"no: {text}; {what} would show it"
