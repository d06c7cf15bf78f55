"""Recordings of tissue that holds still and of arteries that beat, as the benchmarks take them."""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d
from scipy.signal import periodogram

from drivers.core.arrays import Array
from probe.detection.pulse.possible_rates import FASTEST_HZ, SLOWEST_HZ


def holds(path: Path) -> list[tuple[Array, Array]]:
    """Of each curve of a CSV (curve, t_s, force_n) of indenting and holding: time from the highest
    force on [s], negative on the ramp, and force [N]."""
    curves = pd.read_csv(path).groupby("curve", sort=False)
    return [
        (curve.t_s.to_numpy() - curve.t_s.iloc[int(curve.force_n.argmax())],
         curve.force_n.to_numpy())
        for _, curve in curves
    ]  # fmt: skip


def pulses(path: Path) -> list[tuple[Array, Array]]:
    """Of each record of a CSV (record, t_s, pressure_mbar): time [s] and pulse, 1 from trough to
    crest in the median beat.

    The wander is the mean over two beats around each sample.
    """
    found = []
    for _, record in pd.read_csv(path).groupby("record", sort=False):
        time_s, mbar = record.t_s.to_numpy(), record.pressure_mbar.to_numpy()
        rate = 1 / float(np.median(np.diff(time_s)))
        hz, power = periodogram(mbar - uniform_filter1d(mbar, int(2 * rate)), rate, "hann")
        hearts = (hz >= SLOWEST_HZ) & (hz <= FASTEST_HZ)
        beat = int(rate / hz[hearts][np.argmax(power[hearts])])
        steady = mbar - uniform_filter1d(mbar, 2 * beat, mode="nearest")
        swing = [np.ptp(steady[i : i + beat]) for i in range(beat, len(steady) - 2 * beat, beat)]
        found.append((time_s - time_s[0], steady / float(np.median(swing))))
    return found
