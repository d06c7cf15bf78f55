"""Taxel arrays: a gain and an offset for each, and which of them are dead, stuck or bent."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from calibration.errors import CalibrationError
from calibration.fit import Array, Fit, Mask, as_columns, linear_fit, same_length, stacked
from calibration.rounding import least_step, no_finer

DEAD_FRACTION = 0.05  # of the median sensitivity
CLIPPED = 0.02  # of the span off the line of the other readings: a taxel that stands still there
BENT = 0.02  # of the span off the straight line: it does not fit
FALSE_BENT = 1e-3  # chance that of an array of straight taxels any is called bent
ADVICE = "press the whole array with at least three different known pressures"


@dataclass(frozen=True)
class TaxelCalibration:
    """``gain`` (taxels,) [Pa/raw], ``offset`` (taxels,) [raw]; NaN where ``dead``.

    ``ceiling`` and ``floor`` (taxels,) [raw] are the highest and the lowest reading that a taxel
    gives, where it was seen to stand still there; NaN if not. Either may be at the lowest
    pressures (a dead zone) or at the highest (it clips). ``bent`` (taxels,): how far readings
    between them are off a straight line, of their span; 0 where noise explains it.
    """

    KIND: ClassVar[str] = "taxels"
    UNITS: ClassVar[dict[str, str]] = {
        "gain": "Pa/raw",
        "offset": "raw",
        "dead": "1",
        "ceiling": "raw",
        "floor": "raw",
        "bent": "1",
    }
    ADDED: ClassVar[tuple[str, ...]] = ("floor", "bent")
    gain: Array
    offset: Array
    dead: Array
    ceiling: Array
    floor: Array
    bent: Array
    fit: Fit = field(repr=False)

    def pressure(self, raw: Array) -> Array:
        """Pressures (n, taxels) [Pa] from readings (n, taxels); NaN for dead taxels."""
        return np.asarray((np.asarray(raw, dtype=float) - self.offset) * self.gain)

    def saturated(self, raw: Array) -> Array:
        """True (n, taxels) where a taxel stands still: its reading is a bound, not a value."""
        raw = np.asarray(raw)
        return np.asarray((raw >= self.ceiling) | (raw <= self.floor))

    @property
    def dead_zone_pa(self) -> Array:
        """Pressures (taxels,) [Pa] up to which a taxel stands still; NaN if none was seen."""
        return np.asarray((self._rest - self.offset) * self.gain)

    @property
    def clips_pa(self) -> Array:
        """Pressures (taxels,) [Pa] from which on a taxel stands still; NaN if none was seen."""
        return np.asarray((self._most - self.offset) * self.gain)

    @property
    def span(self) -> Array:
        """Reading (taxels,) [raw] at which a taxel clips less that at rest; NaN if none was seen.

        Negative where readings fall with pressure.
        """
        return np.asarray(self._most - np.where(np.isnan(self._rest), self.offset, self._rest))

    @property
    def _rest(self) -> Array:
        return np.where(self.gain > 0, self.floor, self.ceiling)

    @property
    def _most(self) -> Array:
        return np.where(self.gain > 0, self.ceiling, self.floor)

    def misses(self, raw: Array, pressure_pa: Array) -> Array:
        """Readings less what this expects, of living taxels that move, without tare."""
        raw = np.asarray(raw, dtype=float)
        off = raw - np.divide.outer(np.asarray(pressure_pa, dtype=float), self.gain)
        off = np.where(self.saturated(raw), np.nan, off)[:, self.dead == 0]
        off = off - np.nanmean(off, axis=0)
        return np.asarray(off[np.isfinite(off)])


def fit_taxels(raw: Array, pressure_pa: Array) -> TaxelCalibration:
    """Each taxel's gain from uniform pressures (a bladder, or weights on a soft pad).

    ``raw`` (n, taxels), ``pressure_pa`` (n,). A taxel is dead if its sensitivity is below
    5 % of the median or not distinguishable from 0. Where its readings stand still at either end
    while the pressure changes they are left out. Raises `CalibrationError`.
    """
    from scipy.special import stdtrit

    raw, pressure = as_columns(raw, "raw"), as_columns(pressure_pa, "pressure_pa", 1)[:, 0]
    same_length(raw=raw, pressure_pa=pressure)
    fits, ends, bent = [], [], []
    for channel in raw.T:
        low, high = _stuck(channel, pressure)
        moves = ~(low | high)
        design = np.column_stack([np.ones(int(moves.sum())), pressure[moves]])
        fit = linear_fit(design, channel[moves], ("offset", "sensitivity"), ADVICE)
        fit = no_finer(fit, design, channel[moves])
        fits.append(fit)
        ends.append([channel.min() if low.any() else np.nan,
                     channel.max() if high.any() else np.nan])  # fmt: skip
        bent.append(_bent(fit.residuals, channel[moves], pressure[moves], raw.shape[1]))
    slope = np.array([fit.values[1] for fit in fits])
    sigma = np.array([fit.sigma[1] for fit in fits])
    certain = np.array([stdtrit(fit.dof, 0.9995) for fit in fits])
    dead = (np.abs(slope) <= certain * sigma) | (
        np.abs(slope) < DEAD_FRACTION * np.median(np.abs(slope))
    )
    if dead.all():
        raise CalibrationError(f"no taxel answers the pressure; check the wiring, then {ADVICE}")
    offset = np.array([fit.values[0] for fit in fits])
    floor, ceiling = np.where(dead, np.nan, np.array(ends).T)
    return TaxelCalibration(
        gain=np.where(dead, np.nan, 1 / np.where(dead, 1.0, slope)),
        offset=np.where(dead, np.nan, offset),
        dead=dead.astype(float),
        ceiling=ceiling,
        floor=floor,
        bent=np.where(dead, 0.0, bent),
        fit=stacked(fits),
    )


def _stuck(channel: Array, pressure: Array) -> tuple[Mask, Mask]:
    """Where a taxel stands still at its lowest reading (n,), and where at its highest (n,).

    It may, if two readings or more are equal there; it does, if the line through those that are at
    neither leads clearly past them. Readings beyond, towards the end of the pressures, count too.
    Of 500 arrays of nine good taxels none is said to be stuck at either end, quantised in steps of
    1, 2.5, 5, 10 or 25 % of their span or not, of 3, 4 or 8 pressures, once, 3 or 30 times each.
    """
    ends = [_at_end(channel == level, pressure) for level in (channel.min(), channel.max())]
    stuck = [_past(channel, pressure, end, moves=~(ends[0] | ends[1])) for end in ends]
    return (ends[0] & stuck[0], ends[1] & stuck[1])


def _at_end(at: Mask, pressure: Array) -> Mask:
    """Readings from an end of the pressures up to the last of those, two or more, that are ``at``
    one level; none where these are not at one end."""
    if at.sum() < 2 or at.all():
        return at & False
    if pressure[at].mean() < pressure[~at].mean():
        return np.asarray(pressure <= pressure[at].max())
    return np.asarray(pressure >= pressure[at].min())


def _past(channel: Array, pressure: Array, end: Mask, moves: Mask) -> bool:
    """Whether the line through what ``moves`` leads past the readings at the ``end``."""
    if not end.any() or len(np.unique(pressure[moves])) < 3:
        return False
    slope, offset = np.polyfit(pressure[moves], channel[moves], 1)
    middle = float(pressure[moves].mean())
    far = end & (np.abs(pressure - middle) == np.abs(pressure - middle)[end].max())
    away = float(pressure[far][0]) - middle
    short = slope * away + offset + slope * middle - float(channel[far].mean())
    off = channel[moves] - offset - slope * pressure[moves]
    spread = float(np.sum((pressure[moves] - middle) ** 2))
    doubt = np.sqrt(off @ off / (len(off) - 2) * (1 + 1 / len(off) + away**2 / spread))
    least = max(4 * float(doubt), CLIPPED * float(np.ptp(channel)), 2 * least_step(channel))
    return bool(short * np.sign(slope * away) > least)


def _bent(residuals: Array, channel: Array, pressure: Array, taxels: int) -> float:
    """How far a cubic through the residuals is off their line, of the span; 0 if noise, or what is
    rounded off, explains it."""
    from scipy.special import fdtri

    dof = len(residuals) - 4
    if dof < 1 or len(np.unique(pressure)) < 4:
        return 0.0
    at = (pressure - pressure.mean()) / np.ptp(pressure)
    cubic = np.polyval(np.polyfit(at, residuals, 3), at)
    left = float(np.sum((residuals - cubic) ** 2))
    off, span = float(np.abs(cubic).max()), max(float(np.ptp(channel)), 1e-300)
    noise = np.sum(cubic**2) / 2 <= fdtri(2, dof, 1 - FALSE_BENT / taxels) * left / dof
    return 0.0 if noise or off <= max(BENT * span, least_step(channel)) else off / span
