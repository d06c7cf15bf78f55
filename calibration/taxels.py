"""Taxel arrays: a gain and an offset for each, and which of them are dead or saturated."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from calibration.errors import CalibrationError
from calibration.fit import Array, Fit, as_columns, linear_fit, same_length, stacked

DEAD_FRACTION = 0.05  # of the median sensitivity
CLIPPED = 0.02  # of the span below the line of the other readings: a taxel that stands still there
ADVICE = "press the whole array with at least three different known pressures"


@dataclass(frozen=True)
class TaxelCalibration:
    """``gain`` (taxels,) [Pa/raw], ``offset`` (taxels,) [raw]; NaN where ``dead``.

    ``ceiling`` (taxels,) [raw] is the reading at which a taxel clips; NaN if none was seen.
    """

    KIND: ClassVar[str] = "taxels"
    UNITS: ClassVar[dict[str, str]] = {
        "gain": "Pa/raw",
        "offset": "raw",
        "dead": "1",
        "ceiling": "raw",
    }
    gain: Array
    offset: Array
    dead: Array
    ceiling: Array
    fit: Fit = field(repr=False)

    def pressure(self, raw: Array) -> Array:
        """Pressures (n, taxels) [Pa] from readings (n, taxels); NaN for dead taxels."""
        return np.asarray((np.asarray(raw, dtype=float) - self.offset) * self.gain)

    def saturated(self, raw: Array) -> Array:
        """True (n, taxels) where a reading is at the ceiling: a bound, not a value."""
        return np.asarray(np.asarray(raw) >= self.ceiling)

    def misses(self, raw: Array, pressure_pa: Array) -> Array:
        """Readings less what this expects, of living taxels below their ceiling, without tare."""
        raw = np.asarray(raw, dtype=float)
        off = raw - np.divide.outer(np.asarray(pressure_pa, dtype=float), self.gain)
        off = np.where(self.saturated(raw), np.nan, off)[:, self.dead == 0]
        off = off - np.nanmean(off, axis=0)
        return np.asarray(off[np.isfinite(off)])


def fit_taxels(raw: Array, pressure_pa: Array) -> TaxelCalibration:
    """Each taxel's gain from uniform pressures (a bladder, or weights on a soft pad).

    ``raw`` (n, taxels), ``pressure_pa`` (n,). A taxel is dead if its sensitivity is below
    5 % of the median or not distinguishable from 0; it is saturated where readings stand still
    at its maximum while the pressure rises. Raises `CalibrationError`.
    """
    from scipy.special import stdtrit

    raw, pressure = as_columns(raw, "raw"), as_columns(pressure_pa, "pressure_pa", 1)[:, 0]
    same_length(raw=raw, pressure_pa=pressure)
    ceiling = np.array([_ceiling(channel, pressure) for channel in raw.T])
    fits = []
    for channel, limit in zip(raw.T, ceiling, strict=True):
        below = channel < limit
        if len(np.unique(pressure[below])) < 3:
            below = np.ones(len(channel), dtype=bool)
        design = np.column_stack([np.ones(int(below.sum())), pressure[below]])
        fits.append(linear_fit(design, channel[below], ("offset", "sensitivity"), ADVICE))
    slope = np.array([fit.values[1] for fit in fits])
    sigma = np.array([fit.sigma[1] for fit in fits])
    certain = np.array([stdtrit(fit.dof, 0.9995) for fit in fits])
    dead = (np.abs(slope) <= certain * sigma) | (
        np.abs(slope) < DEAD_FRACTION * np.median(np.abs(slope))
    )
    if dead.all():
        raise CalibrationError(f"no taxel answers the pressure; check the wiring, then {ADVICE}")
    offset = np.array([fit.values[0] for fit in fits])
    return TaxelCalibration(
        gain=np.where(dead, np.nan, 1 / np.where(dead, 1.0, slope)),
        offset=np.where(dead, np.nan, offset),
        dead=dead.astype(float),
        ceiling=np.where(dead | np.isinf(ceiling), np.nan, ceiling),
        fit=stacked(fits),
    )


def _ceiling(channel: Array, pressure: Array) -> float:
    """The maximum, if three readings or more stand at it below the line through all others."""
    stuck = channel == channel.max()
    if stuck.sum() < 3 or len(np.unique(pressure[~stuck])) < 3:
        return float("inf")
    slope, offset = np.polyfit(pressure[~stuck], channel[~stuck], 1)
    off = channel - (offset + slope * pressure)
    short = -float(off[stuck & (pressure == pressure[stuck].max())].mean())
    clear = max(4 * float(np.std(off[~stuck])), CLIPPED * float(np.ptp(channel)))
    return float(channel.max()) if short > clear else float("inf")
