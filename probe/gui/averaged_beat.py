"""One mean beat of a hold, for the live window: samples by their phase in the beat, averaged."""

import numpy as np

from drivers.core.arrays import Array

PARTS = 24


def averaged_beat(time_s: Array, values: Array, period_s: float) -> tuple[Array, Array]:
    """Means of ``values`` (n,) over `PARTS` equal parts of a beat: phase [s] and mean (bins,).

    A part without samples is NaN. The beat starts at the first sample.
    """
    phase = np.mod(time_s - time_s[0], period_s)
    part = np.minimum((phase / period_s * PARTS).astype(int), PARTS - 1)
    count = np.bincount(part, minlength=PARTS)
    total = np.bincount(part, weights=values, minlength=PARTS)
    mean = np.full(PARTS, np.nan)
    mean[count > 0] = total[count > 0] / count[count > 0]
    return (np.arange(PARTS) + 0.5) * period_s / PARTS, mean
