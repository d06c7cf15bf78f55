"""Samples that are not measurements: spikes, and gaps that a sensor filled."""

import numpy as np

from drivers.core.arrays import Array, Bools
from probe.detection.pulse.hold_limits import MIN_SAMPLES
from probe.detection.pulse.running_median import running_median
from probe.detection.pulse.scatter import SD_OF_MEDIAN, scatter

SPIKE_SIGMAS = 8.0
"""Robust standard deviations beyond which a sample is no sample."""
BY_CHANCE = 0.01
"""How often in one record a reading may repeat itself so often by chance, to be left in. With
0.001 and 0.1 all of 180 holds with gaps (test_lost_samples.py, 100 Hz) are called the same."""
OUTSIDE = 0.5
"""Of the level: readings that leave it by more from one sample to the next and come back so are no
force on tissue. A pulse of that size would rise in several samples: of 1,498 holds of people's
pulses on meat at 10 Hz five lose some, which swing by 0.7 to 2.4 times their median. With 0.25 and
0.75 the 180 holds with gaps are called the same."""
BACK = 0.5
"""How near to where it left a signal comes back, over how far it was away. With 0.25 and 0.75 the
180 holds with gaps are called the same."""


def repeated(signal: Array) -> Bools:
    """Samples (n,) of stretches of one value, longer than readings repeat themselves by chance and
    far from those beside them: a gap filled with zeros, a full scale or the last reading.

    Readings that are alike with probability p make stretches of one and two in the ratio 1 : p. The
    first and the last stretch are left: a record may begin and end in air.
    """
    rise = np.abs(np.diff(signal))
    starts = np.flatnonzero(rise != 0) + 1
    if not len(starts):
        return np.zeros(len(signal), dtype=bool)
    length = np.diff(np.concatenate([[0], starts, [len(signal)]]))
    alike = min((np.count_nonzero(length == 2) + 1) / (np.count_nonzero(length == 1) + 1), 1.0)
    edge = rise[starts - 1]
    # of a coarse sensor, the least edge is its step; beside a missing reading all is far
    far = ~(edge <= SPIKE_SIGMAS * np.nanmin(edge, initial=np.inf))
    long = len(signal) * alike ** (length - 1.0) < BY_CHANCE
    return np.repeat(long & np.append(False, far) & np.append(far, False), length)


def dropped_out(signal: Array) -> Bools:
    """Samples (n,) of a hold in stretches that are suddenly far off the level and back again: a
    sensor that reads no load for a while."""
    lost, rise = np.zeros(len(signal), dtype=bool), np.diff(signal)
    size = np.abs(rise)
    if not size.any():
        return lost
    usual = SD_OF_MEDIAN * np.median(size[size > 0])  # where readings differ: they may be held
    gone: list[int] = []  # the last samples before it left, of which it has not come back
    for i in np.flatnonzero(size > SPIKE_SIGMAS * usual).tolist():
        back = [k for k in gone if abs(signal[i + 1] - signal[k]) <= BACK * size[k]]
        if back:
            lost[back[-1] + 1 : i + 1] = True
            gone = gone[: gone.index(back[-1])]
        elif size[i] > OUTSIDE * abs(signal[i]):
            gone.append(i)
    return lost


def without_spikes(signal: Array) -> Bools:
    """Samples (n,) that are near to those around them."""
    if len(signal) < MIN_SAMPLES:
        return np.ones(len(signal), dtype=bool)
    off = signal - running_median(signal, 5)
    noise = max(float(scatter(signal)), 1e-12 * np.abs(signal).max(initial=1.0))
    return np.asarray(np.abs(off) <= SPIKE_SIGMAS * noise)


def mended(signal: Array) -> Array:
    """An array's channels (n, c), spikes replaced by the median around them: one channel's would
    hide in the mean."""
    middle = running_median(signal, 5)
    noise = scatter(signal)
    off = np.abs(signal - middle) > SPIKE_SIGMAS * np.maximum(noise, 1e-12 * np.abs(middle))
    return np.asarray(np.where(off & (noise > 0), middle, signal))


def filled(signal: Array) -> Array:
    """An array's channels (n, c), what one misses for a while taken from those that miss nothing:
    by its own gain over their mean, and its distance from it before and after. Else every sample
    would be lost that any channel misses."""
    lost = ~np.isfinite(signal)
    whole = ~lost.any(axis=0)
    if whole.all() or not whole.any():
        return signal
    mean = signal[:, whole].mean(axis=1)
    found = signal.copy()
    for channel in np.flatnonzero(~whole):
        there = ~lost[:, channel]
        if there.sum() < MIN_SAMPLES:
            continue
        about = mean[there] - mean[there].mean()
        power = float(about @ about)
        gain = float(about @ signal[there, channel]) / power if power else 0.0
        off = running_median(signal[there, channel] - gain * mean[there], 5)
        gap, known = np.flatnonzero(~there), np.flatnonzero(there)
        found[gap, channel] = gain * mean[gap] + np.interp(gap, known, off)
    return found
