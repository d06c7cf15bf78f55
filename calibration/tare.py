"""Tare: the reading at no load, and how fast it drifts."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from calibration.errors import CalibrationError
from calibration.fit import (
    Array,
    Fit,
    as_columns,
    ascending,
    correlated,
    linear_fit,
    same_length,
    stacked,
)
from calibration.rounding import no_nearer


@dataclass(frozen=True)
class TareCalibration:
    """``bias`` (channels,) at ``at_s`` and ``drift`` (channels,) per second."""

    KIND: ClassVar[str] = "tare"
    UNITS: ClassVar[dict[str, str]] = {"at_s": "s", "bias": "raw", "drift": "raw/s"}
    at_s: float
    bias: Array
    drift: Array
    fit: Fit = field(repr=False)

    def zeroed(self, values: Array, time_s: Array) -> Array:
        """``values`` (n, channels) less bias and drift at ``time_s`` (n,)."""
        since = np.asarray(time_s, dtype=float) - self.at_s
        return np.asarray(values - self.bias - np.multiply.outer(since, self.drift))

    def known_to(self) -> float:
        """Half of the bias' 95 % interval [the channels' unit], in the best channel."""
        low, high = self.fit.interval()[0::2].T  # bias, drift, bias, drift, ...
        return float((high - low).min()) / 2

    def good_for_s(self, tolerance: float) -> float:
        """Seconds until drift alone may exceed ``tolerance`` [the channels' unit].

        The upper end of the drift's 95 % interval is taken, in the worst channel.
        """
        worst = float(np.abs(self.fit.interval()[1::2]).max())
        return tolerance / worst if worst > 0 else float("inf")


def fit_tare(time_s: Array, values: Array) -> TareCalibration:
    """Bias and drift from readings without load; ``time_s`` (n,), ``values`` (n, channels).

    Filtered sensors give correlated noise: see `calibration.fit.correlated`; readings in steps
    larger than their noise: `calibration.rounding.no_nearer`. Raises `CalibrationError`.
    """
    time = as_columns(time_s, "time_s", 1)[:, 0]
    values = as_columns(values, "values")
    same_length(time_s=time, values=values)
    if len(time) < 10:
        raise CalibrationError(
            f"a tare needs at least 10 readings, there are {len(time)}; record a second or more"
        )
    ascending("time_s", time)
    if not np.ptp(values, axis=0).any():
        raise CalibrationError(
            "the readings never change, and say nothing of drift: the sensor stands still, or "
            "rounds more coarsely than its noise; record for minutes, or look at its settings"
        )
    at_s = float(time.mean())
    design = np.column_stack([np.ones(len(time)), time - at_s])
    fits = []
    for channel in values.T:
        fit = linear_fit(design, channel, ("bias", "drift"), "record longer")
        fits.append(no_nearer(fit, design, channel) or correlated(fit, design))
    bias = np.array([fit.values[0] for fit in fits])
    drift = np.array([fit.values[1] for fit in fits])
    return TareCalibration(at_s, bias, drift, stacked(fits))
