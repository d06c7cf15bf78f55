"""The noise of a signal, by how much neighbouring samples differ: what is slower counts little."""

import numpy as np

from drivers.core.arrays import Array

SD_OF_MEDIAN = 1.4826  # of a normal distribution: 1 / Phi^-1(3/4) (Hampel 1974)


def scatter(signal: Array) -> Array:
    """Standard deviation of the white noise in channels (n, c), or of a single one (n,), without
    what is not a number. Outliers do not count, being fewer than half."""
    median = np.nanmedian(np.abs(np.diff(signal, axis=0)), axis=0)
    return np.asarray(SD_OF_MEDIAN * median / np.sqrt(2))
