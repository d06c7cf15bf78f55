"""The calm half of a hold in which something else moved once, such as a hand.

A movement larger than the pulse is noise to the search, and explains the hold better than a pulse
does. So where one half swings much less than the other, it is also looked at by itself.
"""

from dataclasses import replace

import numpy as np

from drivers.core.arrays import Array
from probe.detection.pulse.estimate import SHORTEST_TRAIN_S, Clearest, find_pulse
from probe.detection.pulse.fit import design_of, fit
from probe.detection.pulse.hold_samples import MIN_BINS, Hold
from probe.detection.pulse.search import Prior

CALMER = 2.0
"""How much less a half must swing to be the calm one. Halves of a pulse differ by less than 1.6 in
99 of 100 holds of 5 s, and by 2 in one of 747; where a hand moved in people's records, by 2 to 20
(benchmarks/pulses.py)."""
MIN_BEATS = 2.0
"""Beats that a half must have: what swings once may be a breath or the movement's end."""
SHARE = 0.1
"""Of the chance of a false pulse, what a calm half may spend, where there is one. Any share keeps
the chance (Bonferroni's inequality with weights; Holm 1979); most pulses are seen in the whole."""


def clearest_part(hold: Hold, prior: Prior | None = None) -> tuple[Hold, Clearest]:
    """The hold or its calm half, in which a pulse is clearer, and the clearest pulse of it."""
    whole = find_pulse(hold, prior)
    calm = calm_half(hold)
    if calm is None:
        return hold, whole
    half = find_pulse(calm, prior)
    chances = whole.p_value / (1 - SHARE), half.p_value / SHARE
    beats = half.rate_hz * calm.span_s
    if beats >= MIN_BEATS and chances[1] < chances[0]:
        return calm, replace(half, p_value=min(1.0, chances[1]))
    return hold, replace(whole, p_value=min(1.0, chances[0]))


def calm_half(hold: Hold) -> Hold | None:
    """The half that is `CALMER` than the other; None if neither is or it is too short to judge."""
    if hold.span_s < 2 * SHORTEST_TRAIN_S:
        return None
    left = fit(hold, design_of(hold), np.empty((len(hold.time_s), 0))).residual_pa
    first = hold.time_s < hold.time_s[0] + hold.span_s / 2
    if min(first.sum(), (~first).sum()) < MIN_BINS:
        return None
    swing = [_swing(hold.time_s[half], left[half]) for half in (first, ~first)]
    if max(swing) < CALMER * min(swing):
        return None
    calm = first if swing[0] < swing[1] else ~first
    return replace(
        hold, time_s=hold.time_s[calm], signal_pa=hold.signal_pa[calm], weight=hold.weight[calm]
    )


def _swing(time_s: Array, signal: Array) -> float:
    """Standard deviation about a straight line."""
    t = time_s - time_s.mean()
    centred = signal - signal.mean()
    return float(np.std(centred - t * (t @ centred) / (t @ t)))
