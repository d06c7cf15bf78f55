"""When the hold of a press begins and ends: seen in the signal where the record does not say."""

import numpy as np

from drivers.core.arrays import Array, Bools
from probe.core.recording import Station
from probe.detection.pulse.possible_rates import SLOWEST_HZ
from probe.detection.pulse.running_median import running_median

SETTLING_S, SETTLING_SAMPLES = 0.01, 2
"""Left out after the ramp, the longer of both: the stage is still slowing down, and of slow samples
nobody knows between which two the ramp ended."""
RAMP_RISE = 0.7
"""A record that starts below this share of its highest value begins with a ramp."""
NEAR_TOP_SHARE, AHEAD_S = 0.9, 0.25
"""A ramp ends where nothing higher follows this soon, this far up from lowest to highest."""
MIN_SAMPLES = 12


def hold_limits(station: Station, mean: Array, whole: Bools) -> tuple[float, float]:
    """When the hold begins and ends; seen in the signal where the record does not say."""
    time_s, mean = station.time_s[whole], mean[whole]
    if len(time_s) < MIN_SAMPLES:
        return -np.inf, np.inf
    step = float(np.median(np.diff(time_s)))
    begin, end = station.hold_s, station.retract_s
    settling = max(SETTLING_S, SETTLING_SAMPLES * step)
    smooth = running_median(mean, 3)
    if not np.isfinite(begin):
        begin = time_s[0]
        top = _top_of_ramp(mean, smooth, step)
        if smooth[0] < RAMP_RISE * smooth[top] and top <= len(smooth) - MIN_SAMPLES:
            begin = time_s[top]
        else:
            settling = 0.0
    if not np.isfinite(end):
        held = time_s >= begin
        level = np.median(smooth[held])
        above = np.flatnonzero(held & (smooth > 0.5 * level)) if level > 0 else np.flatnonzero(held)
        end = time_s[above[-1]] if len(above) else np.inf
    return begin + settling, end


def _top_of_ramp(mean: Array, smooth: Array, step_s: float) -> int:
    """The first top of those that come near the highest sample, which may be a later beat's.

    A beat on a slow ramp makes a top too: where what follows within a beat still rises half as
    fast as the ramp, or faster, the ramp goes on.
    """
    low, span = float(smooth.min()), float(np.ptp(smooth))
    ahead, beat = (max(2, round(one / step_s)) for one in (AHEAD_S, 1 / SLOWEST_HZ))
    near_top = np.flatnonzero(smooth >= low + NEAR_TOP_SHARE * span)
    tops = [int(i) for i in near_top if smooth[i] >= smooth[i : i + ahead].max()]
    early = int(np.argmax(smooth >= low + (1 - NEAR_TOP_SHARE) * span))
    slope = (2 * NEAR_TOP_SHARE - 1) * span / max(int(near_top[0]) - early, 1)

    def goes_on(i: int) -> bool:
        later = smooth[i + 1 : i + 1 + beat] - smooth[i]
        return bool((later > 0.5 * slope * np.arange(1, len(later) + 1)).any())

    top = next((i for i in tops if not goes_on(i)), tops[-1])
    return max(range(max(top - 1, 0), min(top + 2, len(mean))), key=lambda i: mean[i])
