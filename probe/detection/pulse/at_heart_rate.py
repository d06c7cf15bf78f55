"""Pulses in the rhythm of the one heart that a scan's presses share."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivers.core.arrays import Array
from probe.detection.pulse.beat_timing import own_beats_s
from probe.detection.pulse.estimate import (
    SHORTEST_TRAIN_S,
    Clearest,
    Pulse,
    Wave,
    beside,
    pulse_of,
    wave_at,
)
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.possible_rates import RATE_VARIABILITY, rates_hz
from probe.detection.pulse.rate import is_short, shared_rate
from probe.detection.pulse.size import Rates
from probe.detection.pulse.uneven_beats import MIN_WHOLE, Beats, beats_of, mean_rate

MOST_ASKED = 5
"""Clearest presses that say how fast the heart beats: as many as a vessel is seen at."""
FOLLOWED_SIGMAS, MIN_BEATS = 8.0, 2.0
"""Standard deviations of a pulse's size from which the beats found in it are believed, and how many
a hold must have for that."""


def heart_of(pulsing: Sequence[tuple[Hold, Clearest, Beats | None]]) -> Rates | None:
    """How fast a heart beats by the holds that pulse, the clearest first; None without any.

    Where a hold's beats are known and uneven, their mean rate.
    """
    uneven = [beats for *_, beats in pulsing if beats is not None and beats.uneven]
    if uneven:
        return mean_rate(uneven)
    clear = [(hold, _own_wave(hold, one), one.search) for hold, one, _ in pulsing[:MOST_ASKED]]
    return shared_rate(clear) if clear else None


def _own_wave(hold: Hold, own: Clearest) -> Wave:
    return wave_at(hold, own.rate_hz, own.noise, own.scale, own.beating_s)


def pulse_at(
    hold: Hold, own: Clearest, heart: Rates | None, pulsing: bool, beats: Beats | None
) -> Pulse:
    """The pulse at the heart's rate, its beats followed where it is clear enough.

    One that is ``pulsing`` and not clear in a steady heart's beats, or whose heart is uneven, may
    be followed in ``beats`` of any length, which are looked for where they are not known.
    """
    if heart is None or own.search is None:
        wave = _own_wave(hold, own)
        short = own.search is not None and is_short(hold.span_s)
        return pulse_of(hold, own, wave, Rates(rates_hz(hold.span_s)) if short else None)
    rate_hz = float(heart.hz[0])
    steady = wave_at(hold, rate_hz, *beside(hold, rate_hz, own.scale))
    found = None
    if hold.span_s * rate_hz >= MIN_BEATS:
        followed = _followed(hold, own, steady, own_beats_s(hold, steady), heart.variability)
        if followed.size_pa >= FOLLOWED_SIGMAS * followed.size_sd_pa:
            found = followed
    sought = pulsing and (found is None or heart.variability > RATE_VARIABILITY)
    found = found or pulse_of(hold, own, steady, heart)
    if not sought or hold.span_s < SHORTEST_TRAIN_S:
        return found
    beats = beats or beats_of(hold)
    if len(beats.whole_s) < MIN_WHOLE:
        return found
    rate_hz, counted_s = 1 / beats.mean_s, beats.counted_s(hold.time_s)
    begun = wave_at(hold, rate_hz, *beside(hold, rate_hz, own.scale, counted_s), counted_s)
    beating_s = own_beats_s(hold, begun)
    followed = _followed(hold, own, begun, beating_s, beats.variability)
    gain = _log_likelihood(followed) - _log_likelihood(found)
    if gain < 0.5 * len(beats.swing_pa) * np.log(len(hold.time_s)):  # Schwarz 1978
        return found
    sizes = followed.sizes
    doubt_pa = np.hypot(sizes.sd_pa, beats.size_doubt * sizes.size_pa)
    return replace(followed, sizes=replace(sizes, sd_pa=doubt_pa))


def _followed(hold: Hold, own: Clearest, wave: Wave, beating_s: Array, variability: float) -> Pulse:
    """The pulse of a wave's rate in beats of the hold's own."""
    rate_hz = wave.rate_hz
    noise, scale = beside(hold, rate_hz, own.scale, beating_s)
    rates = Rates(np.array([rate_hz]), variability)
    return pulse_of(hold, own, wave_at(hold, rate_hz, noise, scale, beating_s), rates)


def _log_likelihood(pulse: Pulse) -> float:
    """Of a hold's residual, in white noise of an unknown level."""
    left_pa = pulse.fit.residual_pa
    return -0.5 * len(left_pa) * float(np.log(max(float(left_pa @ left_pa), 1e-300)))
