"""A press as an array saw it: what each taxel read in its hold, and how it pulsed."""

from collections.abc import Sequence

import numpy as np

from drivers.core.array_layout import taxel_places
from drivers.core.arrays import Array

HARMONICS = 6  # those above hold 0.5 % of the variance of `sim_backend.scene.waves`' measured beat


def taxel_image(values: Array, names: Sequence[str]) -> Array | None:
    """``values`` (n,) in the rows and columns that the channels' ``names`` say, or ``device.name``;
    NaN where no taxel is, such as a dead one that a calibration left out. None where they say none.
    """
    places = taxel_places([name.rpartition(".")[2] for name in names])
    if places is None:
        return None
    rows, columns = places.T
    table = np.full((rows.max() + 1, columns.max() + 1), np.nan)
    table[rows, columns] = values
    return table


def beat_ends(time_s: Array, signal: Array, period_s: float) -> Array:
    """Lowest and highest (2, k) of the mean beat of each column of a hold's ``signal`` (n, k).

    A straight line (relaxation is no pulse) and `HARMONICS` of the beat are fitted together to the
    hold: over a single beat a line fitted alone would take a fifth of a sine with it. A heart that
    runs free of the scan is read as one that waits for it. NaN where less than a whole beat was
    held.
    """
    if len(time_s) < 4 * (2 * HARMONICS + 2) or time_s[-1] - time_s[0] < 0.97 * period_s:
        return np.full((2, signal.shape[1]), np.nan)
    angle = 2 * np.pi * np.outer(time_s - time_s[0], np.arange(1, HARMONICS + 1)) / period_s
    waves = np.hstack([np.cos(angle), np.sin(angle)])
    straight = np.stack([np.ones_like(time_s), time_s - time_s.mean()], axis=1)
    fitted, *_ = np.linalg.lstsq(np.hstack([straight, waves]), signal, rcond=None)
    beat = waves @ fitted[2:]
    return np.asarray(signal.mean(axis=0) + np.stack([beat.min(axis=0), beat.max(axis=0)]))
