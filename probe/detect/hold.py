"""One hold as even samples: spikes and clipped samples out, averaged to the pulse's bandwidth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from probe.recording import Station

Array = NDArray[np.float64]

BIN_S = 0.02
"""Averages this long keep every harmonic of a pulse (up to 15 Hz) and make the rest cheap."""
SETTLING_S, SETTLING_SAMPLES = 0.01, 2
"""Left out after the ramp, the longer of both: the stage is still slowing down, and of slow samples
nobody knows between which two the ramp ended."""
RISE = 0.7
"""A record that starts below this share of its highest value begins with a ramp."""
SPIKE = 8.0
"""Robust standard deviations beyond which a sample is no sample."""
NEAR, AHEAD_S = 0.9, 0.25
"""A ramp ends where nothing higher follows this soon, this far up from lowest to highest."""
FEWEST = 12


class NoHold(ValueError):
    """There is too little in a hold to say anything; the text says what is missing."""


@dataclass(frozen=True)
class Hold:
    """``signal_pa`` (n,) at ``time_s`` (n,) since the hold began; ``weight`` (n,) is how many
    samples each is the mean of, over the mean. ``clipped`` is the share lost to saturation,
    ``start_s`` when the hold began on the recording's clock."""

    time_s: Array
    signal_pa: Array
    weight: Array
    clipped: float
    start_s: float

    @property
    def span_s(self) -> float:
        return float(self.time_s[-1] - self.time_s[0])


def hold_of(station: Station) -> Hold:
    """The mean over the channels during the hold. Raises `NoHold`."""
    time_s, signal, clipped = _between(station)
    order = np.argsort(time_s, kind="stable")
    time_s, signal = time_s[order], signal[order]
    good = _without_spikes(signal)
    time_s, signal = time_s[good], signal[good]
    if len(time_s) < FEWEST:
        raise NoHold(
            f"station {station.index}: {len(time_s)} usable samples in the hold"
            + (f" ({100 * clipped:.0f} % are clipped)" if clipped else "")
            + f"; at least {FEWEST} are needed"
        )
    step = max(BIN_S, 1.001 * float(np.median(np.diff(time_s))))
    bins = np.floor((time_s - time_s[0]) / step).astype(int)
    count = np.bincount(bins)
    there = count > 0
    mean = [np.bincount(bins, weights=v)[there] / count[there] for v in (time_s, signal)]
    weight = count[there] / count[there].mean()
    start = float(station.hold_s if np.isfinite(station.hold_s) else time_s[0])
    return Hold(mean[0] - start, mean[1], weight, clipped, start)


def _between(station: Station) -> tuple[Array, Array, float]:
    """Times, channel means and the clipped share of the hold."""
    clipped = np.asarray(station.saturated.any(axis=1))
    whole = np.isfinite(station.signal_pa).all(axis=1) & np.isfinite(station.time_s)
    mean = np.where(whole, station.signal_pa.mean(axis=1), np.nan)
    begin, end = _limits(station, mean, whole)
    inside = (station.time_s >= begin) & (station.time_s <= end)
    kept = inside & whole & ~clipped
    share = float(clipped[inside].mean()) if inside.any() else 0.0
    return station.time_s[kept], mean[kept], share


def _limits(station: Station, mean: Array, whole: NDArray[np.bool_]) -> tuple[float, float]:
    """When the hold begins and ends; seen in the signal where the record does not say."""
    time_s, mean = station.time_s[whole], mean[whole]
    if len(time_s) < FEWEST:
        return -np.inf, np.inf
    step = float(np.median(np.diff(time_s)))
    begin, end = station.hold_s, station.retract_s
    settling = max(SETTLING_S, SETTLING_SAMPLES * step)
    smooth = median_filter(mean, size=3, mode="nearest")
    if not np.isfinite(begin):
        begin = time_s[0]
        top = _top_of_ramp(mean, smooth, step)
        if smooth[0] < RISE * smooth[top] and top <= len(smooth) - FEWEST:
            begin = time_s[top]
        else:
            settling = 0.0
    if not np.isfinite(end):
        held = time_s >= begin
        level = np.median(smooth[held])
        above = np.flatnonzero(held & (smooth > 0.5 * level)) if level > 0 else np.flatnonzero(held)
        end = time_s[above[-1]] if len(above) else np.inf
    return begin + settling, end


def _top_of_ramp(mean: Array, smooth: Array, step_s: float) -> int:
    """The first top of those that come near the highest sample, which may be a later beat's."""
    ahead = max(2, round(AHEAD_S / step_s))
    near_top = np.flatnonzero(smooth >= smooth.max() - (1 - NEAR) * np.ptp(smooth))
    top = next(int(i) for i in near_top if smooth[i] >= smooth[i : i + ahead].max())
    return max(range(max(top - 1, 0), min(top + 2, len(mean))), key=lambda i: mean[i])


def _without_spikes(signal: Array) -> NDArray[np.bool_]:
    if len(signal) < FEWEST:
        return np.ones(len(signal), dtype=bool)
    off = signal - median_filter(signal, size=5, mode="nearest")
    scatter = 1.4826 * np.median(np.abs(np.diff(signal))) / np.sqrt(2)
    return np.asarray(np.abs(off) <= SPIKE * max(scatter, 1e-12 * np.abs(signal).max(initial=1.0)))
