"""When the hold of a press begins and ends: seen in the signal where the record does not say."""

import numpy as np

from drivers.core.arrays import Array, Bools
from probe.core.recording import Station
from probe.detection.pulse.possible_rates import SLOWEST_HZ
from probe.detection.pulse.running_median import running_median
from probe.detection.pulse.scatter import SD_OF_MEDIAN

SETTLING_S, SETTLING_SAMPLES = 0.01, 2
"""Left out after the ramp, the longer of both: the stage is still slowing down, and of slow samples
nobody knows between which two the ramp ended."""
RAMP_RISE = 0.7
"""A record that starts below this share of its highest value begins with a ramp; one that ends
below this share of its level ends with a fall."""
FALLING = 0.25
"""Of the time from a hold's end to half its level, left out before: a stage gathers speed. Of 2,400
presses (test_hold_limits.py: 10 to 500 Hz, noise of 0.01 to 3 %) 11 keep more than 1 % of the fall,
and lose 0.12 s at the median; without it 452, and 0.01 s; with 0.5, 2 and 0.24 s."""
MOST_SAMPLES, MOST_STARTS = 5000, 200
"""Of a record that are looked at for its fall, and of what may be its start, 16 MB: a longer one is
thinned, and looked at again where it falls."""
AHEAD_S = 0.25
"""Of a hold beside its ramp or lift, what is looked at at least: a third of a beat."""
NEAR_TOP_SHARE = 0.9
"""Of the highest force: a ramp does not end below, though a beat on it may look like its end."""
LOW_SHARE, REST_OF_RAMP = 0.1, 1.8
"""From the first share of its force to half of it, a ramp takes a time; from there to its end up to
1.25 times that (forces that grow with a power of 1 to 1.6 of the depth); so is the rest hold."""
STEP_S, STEP_REST_S, STEP_OVER_FALL, STEP_OVER_NOISE = 0.02, 0.3, 2.0, 8.0
"""A lift's first step falls within the first of these, and is followed by at most so long a rest;
no beat falls so much more steeply than those before, and no noise by so many of its standard
deviations. Of 240 holds with such a step (100 and 500 Hz, pulses as large as it and a third of it)
1.2 % end after it; with half or twice of the first 5.4 and 3.3, with two thirds or 1.7 times of the
second the same, of the third 1.2 and 2.1, of the fourth the same. Of 500 holds of noise none ends
early, with half of the fourth one."""
MIN_SAMPLES = 12


def hold_limits(station: Station, mean: Array, whole: Bools) -> tuple[float, float, float]:
    """When the hold begins and ends; seen in the signal where the record does not say, and then how
    much earlier the hold may have begun [s]."""
    time_s, mean = station.time_s[whole], mean[whole]
    if len(time_s) < MIN_SAMPLES:
        return -np.inf, np.inf, 0.0
    step = float(np.median(np.diff(time_s)))
    begin, end, doubt = station.hold_s, station.retract_s, 0.0
    settling = max(SETTLING_S, SETTLING_SAMPLES * step)
    smooth = running_median(mean, 3)
    if not np.isfinite(begin):
        begin = time_s[0]
        zero = float(smooth.min())  # a sensor may have any
        over = smooth - zero
        high = float(np.median(over[over >= 0.5 * over.max()]))
        if smooth[0] < RAMP_RISE * (zero + high):
            begin, doubt = _end_of_ramp(time_s, mean - zero, over, high, step)
        else:
            settling = 0.0
    if not np.isfinite(end):
        held = time_s >= begin
        end = _end_of_hold(time_s[held], mean[held], smooth[held], step)
    return begin + settling, end, doubt


def _end_of_ramp(
    time_s: Array, mean: Array, smooth: Array, high: float, step_s: float
) -> tuple[float, float]:
    """When the ramp of a record (n,) ends that holds about ``high``: seen from the hold, backwards
    in time, it is a fall. The hold is looked at for about as long as the ramp takes, up to the
    middle of what is above half of its force. A beat on a slow ramp looks like an end: where what
    follows within a beat still rises half as fast as the ramp, or faster, the ramp goes on."""
    above = np.flatnonzero(smooth >= 0.5 * high)
    half, last = int(above[0]), int(above[-1])
    low = np.flatnonzero(smooth[:half] < LOW_SHARE * high)
    rising_s = float(time_s[half] - time_s[low[-1] if len(low) else 0])
    until_s = time_s[half] + max(REST_OF_RAMP * rising_s, AHEAD_S)
    until_s = min(until_s, (time_s[half] + time_s[last]) / 2)
    near = slice(half, max(int(np.searchsorted(time_s, until_s, "right")), half + MIN_SAMPLES))
    begins_s = -_start_of_fall(-time_s[near][::-1], mean[near][::-1])
    top_s = float(time_s[np.argmax(smooth >= NEAR_TOP_SHARE * smooth.max())])
    begin = min(int(np.searchsorted(time_s, max(begins_s, top_s))), len(time_s) - 1)
    slope = (0.5 - LOW_SHARE) * high / max(rising_s, step_s)
    ahead, beat = (max(2, round(span_s / step_s)) for span_s in (AHEAD_S, 1 / SLOWEST_HZ))

    def goes_on(i: int) -> bool:
        later = smooth[i + ahead : i + 1 + beat] - smooth[i]
        after_s = step_s * np.arange(ahead, ahead + len(later))
        return bool((later > 0.5 * slope * after_s).any())

    end_s = max(begins_s, top_s)
    if goes_on(begin):
        tops = (i for i in range(begin + 1, last) if smooth[i] >= smooth[i : i + ahead].max())
        end_s = float(time_s[next((i for i in tops if not goes_on(i)), begin)])
    return end_s, max(end_s - begins_s, 0.0)


def _end_of_hold(time_s: Array, mean: Array, smooth: Array, step_s: float) -> float:
    """Of a record (n,) from the hold's begin on: before it falls, if it does."""
    level = float(np.median(smooth)) if len(smooth) else 0.0
    above = np.flatnonzero(smooth > 0.5 * level) if level > 0 else np.arange(len(smooth))
    if not len(above) or smooth[-1] >= RAMP_RISE * level:
        return float(time_s[above[-1]]) if len(above) else np.inf
    low = min(int(above[-1]) + 1, len(time_s) - 1)
    falls_s = _start_of_fall(time_s[: low + 1], mean[: low + 1])
    gathering_s = FALLING * (float(time_s[low]) - falls_s)
    end_s = falls_s - gathering_s - max(SETTLING_S, SETTLING_SAMPLES * step_s)
    held = time_s <= end_s
    return _before_a_step(time_s[held], mean[held], end_s)


def _start_of_fall(time_s: Array, mean: Array) -> float:
    """When a record (n,) that ends within a fall began to fall: where a line that breaks off, at
    once or gathering speed, fits it best. First in all of it, then twice in what is near."""
    start_s = time_s[0]
    for _ in range(3):
        near = np.flatnonzero(time_s >= start_s)
        near = near[:: -(-len(near) // MOST_SAMPLES)]
        t, y = time_s[near] - start_s, mean[near]
        starts = t[:: -(-len(t) // MOST_STARTS)]
        past = np.maximum(t[:, None] - starts, 0.0)
        falls = np.hstack([past, past**2])
        q, _ = np.linalg.qr(np.column_stack([np.ones_like(t), t]))
        falls -= q @ (q.T @ falls)
        along = np.minimum((y - q @ (q.T @ y)) @ falls, 0.0)
        gain = along**2 / np.maximum((falls**2).sum(axis=0), 1e-300)
        found_s = start_s + starts[int(np.argmax(gain)) % len(starts)]
        start_s = max(start_s, found_s - max(2 * (time_s[-1] - found_s), AHEAD_S))
    return float(found_s)


def _before_a_step(time_s: Array, mean: Array, end_s: float) -> float:
    """The end of a hold (n,) before a lift's first step, which a rest may follow: where it falls as
    steeply as no pulse does, beside a line."""
    if len(time_s) < MIN_SAMPLES:
        return end_s
    q, _ = np.linalg.qr(np.column_stack([np.ones_like(time_s), time_s - time_s[0]]))
    left = mean - q @ (q.T @ mean)
    wide = max(1, round(STEP_S / float(np.median(np.diff(time_s)))))
    fallen, rise = left[:-wide] - left[wide:], np.abs(np.diff(mean))
    late = max(int(np.searchsorted(time_s, time_s[-1] - STEP_REST_S)), len(fallen) // 2)
    if late >= len(fallen):
        return end_s
    step = late + int(np.argmax(fallen[late:]))
    if step - wide < MIN_SAMPLES:
        return end_s
    usual = float(fallen[: step - wide].max(initial=0.0))
    # of a coarse sensor, half of its readings and more are alike
    least = float(rise[rise > 0].min()) if rise.any() else 0.0
    noise = max(SD_OF_MEDIAN * float(np.median(rise)), least) / np.sqrt(2)
    steep = fallen[step] > max(STEP_OVER_FALL * usual, STEP_OVER_NOISE * noise)
    return float(time_s[step]) if steep else end_s
