"""Several devices' samples at the times of one: a frame each, for formats of one rate."""

import numpy as np

from drivers.core.arrays import Array


def frame_rate(time_s: Array) -> int:
    """The whole number of frames a second that is nearest to the rate of ``time_s`` (n,) [s], at
    least 1."""
    steps = np.diff(time_s)
    return max(1, round(1 / float(np.median(steps)))) if steps.any() else 1


def frame_times(time_s: Array, rate: int) -> Array:
    """Times (k,) from the first of ``time_s`` (n,) to the last."""
    count = int(np.floor((time_s[-1] - time_s[0]) * rate + 1e-6)) + 1
    return np.asarray(time_s[0] + np.arange(count) / rate)


def framed(time_s: Array, values: Array, times: Array, rate: int) -> Array:
    """``values`` (n, ...) read at ``time_s`` (n,) as they are in frames at ``times`` (k,): the mean
    of what was read within half a frame, where nothing was the nearest reading; NaN of what never
    was read.

    Examples
    --------
    >>> time_s = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 1.0])
    >>> framed(time_s, np.arange(6.0), np.array([0.0, 0.5, 1.0]), 2).tolist()
    [1.0, 3.5, 5.0]
    """
    flat = values.reshape(len(time_s), int(np.prod(values.shape[1:])))
    found = np.full((len(times), flat.shape[1]), np.nan)
    half_s = 0.5 / rate
    for n, column in enumerate(flat.T):
        read = np.isfinite(column)
        if not read.any():
            continue
        at, known = time_s[read], column[read]
        first = np.searchsorted(at, times - half_s + 1e-9)
        last = np.searchsorted(at, times + half_s + 1e-9)
        total = np.concatenate([[0.0], np.cumsum(known)])
        after = np.clip(np.searchsorted(at, times), 1, max(len(at) - 1, 1))
        before = after - 1
        after = np.minimum(after, len(at) - 1)
        nearest = np.where(times - at[before] <= at[after] - times, before, after)
        many = last > first
        mean = (total[last] - total[first]) / np.maximum(last - first, 1)
        found[:, n] = np.where(many, mean, known[nearest])
    return found.reshape(len(times), *values.shape[1:])
