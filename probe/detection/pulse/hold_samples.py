"""One hold as even samples: lost and clipped ones out, averaged to the pulse's bandwidth."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.core.arrays import Array, Bools, Ints
from probe.core.recording import Station
from probe.detection.pulse.hold_limits import MIN_SAMPLES, hold_limits
from probe.detection.pulse.lost_samples import (
    dropped_out,
    filled,
    mended,
    repeated,
    without_spikes,
)
from probe.detection.pulse.possible_rates import SLOWEST_HZ
from probe.detection.pulse.scatter import scatter

BIN_S = 0.02
"""Averages this long keep every harmonic of a pulse (up to 15 Hz) and make the rest cheap."""
ROUNDING = 1e-6
"""Of an average's length: a sample this near to the next one is its first."""
WHOLE = 0.01
"""Of a number of samples: an average this near to a whole number of them has as many."""
MAX_CODES, EVEN_CODES = 0.5, 0.05
"""Different values, over samples, that a signal in steps has at most, and how far from whole
numbers of steps they may be: values are stored in few digits."""
UNDITHERED = 0.35
"""Standard deviation of neighbours' differences over the step, below which steps are no noise: one
of a quarter of a step leaves 0.1 of it of the sawtooth that rounding makes, more noise less
(Widrow & Kollar 2008)."""
SAME = 1e-6
"""Of a hold's swing: values that are closer differ by the computer's rounding."""
MANY = 100
"""Averages of which the last may be left out, so that they are even: a hundredth of the hold."""
LONGEST_STEP_S = 1 / (2 * SLOWEST_HZ)
"""Slower samples cannot tell any heart's rate (Nyquist)."""
MIN_BINS = 7
"""More than what is fitted: a level, a drift and two harmonics."""
CONTACT_SIGMAS = 5.0
"""Standard errors by which a hold must lie above what was measured before contact."""
ONLY_NOISE = 1.5
"""Standard deviation of a signal that is noise and nothing else, over that of its differences."""
MAX_STILL = 0.5
"""Of a channel's readings in the air, how many may repeat themselves: of one that never rests more
often, a station of 100 readings is all alike once in 1e30 times."""
MAX_DEAD = 0.5
"""Share of a channel's samples that may be missing or clipped before it counts as dead."""

SMALLEST_PA, LARGEST_PA = 1e-15, 1e12
"""No reading of a sensor is beyond them: pressures end at that of the best vacuum (Gabrielse et al.
1990, below 7e-15 Pa) and of the hardest press (Dubrovinskaia et al. 2016, 1 TPa). Far beyond,
squares overflow."""


class NoHold(ValueError):
    """There is too little in a hold to say anything; the text says what is missing."""


class NoContact(NoHold):
    """The probe met nothing."""


@dataclass(frozen=True, eq=False)
class Hold:
    """``signal_pa`` (n,) at ``time_s`` (n,) since the hold began; ``weight`` (n,) is how many
    samples each is the mean of, over the mean. ``clipped`` is the share lost to saturation,
    ``lost`` the share that is missing otherwise, ``start_s`` when the hold began on the recording's
    clock. A mean weakens what oscillates at f as one over ``averaged_s`` without gaps does, by
    sinc(f averaged_s). Samples differ from ``code_pa`` by multiples of ``quantum_pa``, which is 0
    where no such steps show. Where noise does not reach over these there are so many ``stretches``
    of one value, else 0. ``outliers`` readings far off those beside them are left out. Two are
    equal only if they are the same one, so that what is made of one can be kept."""

    time_s: Array
    signal_pa: Array
    weight: Array
    clipped: float
    start_s: float
    averaged_s: float = 0.0
    quantum_pa: float = 0.0
    code_pa: float = 0.0
    stretches: int = 0
    lost: float = 0.0
    outliers: int = 0

    @property
    def step_s(self) -> float:
        return round(self.span_s / max(len(self.time_s) - 1, 1), 5)

    @property
    def span_s(self) -> float:
        return float(self.time_s[-1] - self.time_s[0])


def dead_channels(stations: Sequence[Station]) -> Bools:
    """Channels (c,) of an array that are dead or stuck; left out of all stations, so that their
    means compare.

    Dead in a station is one whose samples are mostly missing or clipped there while another's are
    not, or one that shows a single value there, contact and all, though it does not rest in the air
    of another; stuck is one that shows the same value other than zero in every sample of every
    station. A lone channel is never left out.
    """
    count = max((s.signal_pa.shape[1] for s in stations), default=0)
    dead, stuck, value = np.zeros(count, bool), np.ones(count, bool), np.full(count, np.nan)
    if count < 2:
        return dead
    still, restless = np.zeros(count, bool), np.zeros(count, bool)
    for station in stations:
        if station.signal_pa.shape[1] != count or not len(station.signal_pa):
            continue
        lost = (~np.isfinite(station.signal_pa) | station.saturated).mean(axis=0) > MAX_DEAD
        dead |= lost & ~lost.all()
        first = station.signal_pa[0]
        value = np.where(np.isnan(value), first, value)
        stuck &= (station.signal_pa == value).all(axis=0) & (value != 0)
        still |= (station.signal_pa == first).all(axis=0)
        air = station.signal_pa[station.time_s < station.indent_s]
        if len(air) >= MIN_SAMPLES:
            restless |= (np.diff(air, axis=0) != 0).mean(axis=0) > MAX_STILL
    dead |= still & restless & ~still.all()
    return dead if (dead | stuck).all() else dead | stuck


def hold_of(station: Station, dead: Bools | None = None) -> Hold:
    """The mean over the channels during the hold, without ``dead`` ones.

    Raises `NoHold`, of these `NoContact` where the probe met nothing.
    """
    if not station.signal_pa.shape[1]:
        raise NoHold(f"station {station.index + 1}: no channel of a sensor was recorded")
    if dead is not None and dead.any() and len(dead) == station.signal_pa.shape[1]:
        station = replace(
            station, signal_pa=station.signal_pa[:, ~dead], saturated=station.saturated[:, ~dead]
        )
    time_s, signal, clipped, lost, outliers = _between(_in_order(station))
    good = without_spikes(signal)
    outliers += int(np.count_nonzero(~good))
    kept = _unbroken(time_s[good])
    time_s, signal = time_s[good][kept], signal[good][kept]
    lost += (1 - lost) * (1 - float(kept.mean())) if len(kept) else 0.0
    if len(time_s) < MIN_SAMPLES:
        raise NoHold(
            f"station {station.index + 1}: {len(time_s)} usable samples in the hold"
            + (f" ({100 * clipped:.0f} % are clipped)" if clipped else "")
            + (f" ({100 * lost:.0f} % are missing)" if lost else "")
            + f"; at least {MIN_SAMPLES} are needed"
        )
    largest_pa = float(np.abs(signal).max())
    if largest_pa <= LARGEST_PA:
        _check_contact(station, signal)
    if not SMALLEST_PA <= largest_pa <= LARGEST_PA and largest_pa > 0:
        raise NoHold(
            f"station {station.index + 1}: it reads {largest_pa:.3g} Pa, which no sensor does: are "
            "its forces in newtons, and the face in m2?"
        )
    step_s = float(np.median(np.diff(time_s)))
    if step_s > LONGEST_STEP_S:
        raise NoHold(
            f"station {station.index + 1}: a sample every {step_s:.3g} s shows no heartbeat; one "
            f"every {LONGEST_STEP_S:.2g} s is needed. Are its times in seconds?"
        )
    step = max(BIN_S, 1.001 * step_s)
    bins = _averages_of(time_s, step_s, step)
    count = np.bincount(bins)
    if (count > 0).sum() < MIN_BINS:
        raise NoHold(
            f"station {station.index + 1}: a hold of {time_s[-1] - time_s[0]:.3f} s shows no "
            f"pulse; at least {MIN_BINS * step:.2f} s are needed, two heartbeats to see one well"
        )
    there = count > 0
    if len(count) > MANY and count[-1] < np.median(count[there]):
        there[-1] = False  # where the hold ends within it, its mean is of another time
    start = float(station.hold_s if np.isfinite(station.hold_s) else time_s[0])
    mean = [np.bincount(bins, weights=v)[there] / count[there] for v in (time_s - start, signal)]
    weight = count[there] / count[there].mean()
    averaged_s = round(step_s * float(np.sqrt(max(np.median(count[there]) ** 2 - 1, 0.0))), 4)
    return Hold(mean[0], mean[1], weight, clipped, start, averaged_s,
                *_steps_of(station, signal), lost, outliers)  # fmt: skip


def _unbroken(time_s: Array) -> Bools:
    """The samples (n,) of the longest stretch without a gap that is longer than all that was read:
    a clock jumped, or it is two holds, and span over count is no sample's length any more."""
    gaps_s = np.diff(time_s)
    far = gaps_s > len(time_s) * np.median(gaps_s) if len(gaps_s) else np.empty(0, bool)
    stretch = np.concatenate([[0], np.cumsum(far)])[: len(time_s)].astype(int)
    return np.asarray(stretch == np.argmax(np.bincount(stretch, minlength=1)))


def _averages_of(time_s: Array, each_s: float, step_s: float) -> Ints:
    """Which average of ``step_s`` each sample (n,) belongs to, at ``time_s`` (n,) ``each_s`` apart.

    By their numbers where an average has a whole number of them: a clock of few digits, such as the
    seconds since 1970, and jitter would put more into one and less into the next, and a relaxation
    seen through such averages beats.
    """
    many = round(step_s / each_s)
    gaps = np.rint(np.diff(time_s) / each_s)
    if many > 1 and abs(step_s / each_s - many) <= WHOLE * many and (gaps >= 1).all():
        return np.concatenate([[0], np.cumsum(gaps)]).astype(int) // many
    return np.asarray(np.floor((time_s - time_s[0]) / step_s + ROUNDING).astype(int))


def _steps_of(station: Station, signal: Array) -> tuple[float, float, int]:
    """``quantum_pa``, ``code_pa`` and ``stretches`` of a hold's ``signal`` (n,).

    One of one value shows no step: it is the least by which the station's samples differ elsewhere,
    or else what the computer's rounding leaves.
    """
    first_pa, least_pa = float(signal[0]), SAME * float(np.abs(signal).max())
    if np.ptp(signal) <= least_pa:
        gaps = np.diff(np.unique(station.signal_pa[np.isfinite(station.signal_pa)]))
        return float(min(gaps[gaps > least_pa], default=least_pa)), first_pa, 1
    quantum_pa, rises = quantum_of(signal), np.diff(signal)
    crisp = float(np.std(rises)) < UNDITHERED * quantum_pa
    return quantum_pa, first_pa, 1 + int(np.count_nonzero(np.abs(rises) > least_pa)) if crisp else 0


def quantum_of(signal: Array) -> float:
    """The step [Pa] of which all differences of samples (n,) are multiples, 0 if there is none or
    noise hides it: then rounding does no more than add to the noise (Widrow & Kollar 2008)."""
    values = np.unique(signal)
    if not 1 < len(values) <= MAX_CODES * len(signal):
        return 0.0
    gaps = np.diff(values)
    step = float(gaps[gaps > SAME * np.ptp(values)].min())
    codes = (values - values[0]) / step
    noise = float(scatter(signal))
    even = bool(np.abs(codes - np.round(codes)).max() <= EVEN_CODES)
    return step if even and noise <= step else 0.0


def _in_order(station: Station) -> Station:
    """The same samples by their times, of several of one time the first: packets may come so."""
    if (np.diff(station.time_s) > 0).all():
        return station
    order = np.argsort(station.time_s, kind="stable")
    order = order[np.append(True, np.diff(station.time_s[order]) != 0)]
    return replace(
        station, time_s=station.time_s[order], signal_pa=station.signal_pa[order],
        saturated=station.saturated[order], depth_m=station.depth_m[order],
    )  # fmt: skip


def _between(station: Station) -> tuple[Array, Array, float, float, int]:
    """Times and channel means of the hold, the shares of it that were clipped and lost, and how
    many readings were far off for a while."""
    clipped = np.asarray(station.saturated.any(axis=1))
    stale = np.column_stack([repeated(channel) for channel in station.signal_pa.T])
    each = np.where(stale & ~station.saturated, np.nan, station.signal_pa)
    if each.shape[1] > 1:
        each = filled(mended(each))
    whole = np.isfinite(each).all(axis=1) & np.isfinite(station.time_s)
    mean = np.where(whole, each.mean(axis=1), np.nan)
    steady = mean.copy()
    steady[whole] = mended(mean[whole])  # one reading far off may not say when a hold ends
    begin, end, doubt_s = hold_limits(station, steady, whole)
    inside = (station.time_s >= begin) & (station.time_s <= end)
    if inside.any() and doubt_s > (hold_s := float(np.ptp(station.time_s[inside]))):
        raise NoHold(
            f"station {station.index + 1}: where its ramp ends is in doubt by {doubt_s:.2f} s, and "
            f"its hold lasts {hold_s:.2f} s: record the phase, ramp faster or hold longer"
        )
    kept = inside & whole & ~clipped
    gone = dropped_out(mean[kept])
    kept[kept] = ~gone
    lost = inside & ~kept & ~clipped

    def share(some: Bools) -> float:
        return float(some[inside].mean()) if inside.any() else 0.0

    return station.time_s[kept], mean[kept], share(clipped), share(lost), int(gone.sum())


def _check_contact(station: Station, signal: Array) -> None:
    """Raises `NoContact` if the hold's ``signal`` (n,) is not above what was before contact.

    Where nothing was recorded before, only a signal that is constant, or noise about zero, is none.
    """
    before = station.signal_pa[station.time_s < station.indent_s]
    before = before.mean(axis=1) if before.size else np.empty(0)
    before = before[np.isfinite(before)]
    noise = float(scatter(signal))
    if len(before) >= MIN_SAMPLES:
        error = max(noise, float(np.std(before))) * np.sqrt(1 / len(signal) + 1 / len(before))
        rise = float(np.median(signal) - np.median(before))
        if rise <= CONTACT_SIGMAS * error:
            raise NoContact(
                f"station {station.index + 1}: no contact (the hold is {rise:.3g} Pa above what "
                f"was measured before it, of {CONTACT_SIGMAS * error:.3g} Pa that would show)"
            )
        return
    near_zero = abs(float(np.median(signal))) <= CONTACT_SIGMAS * noise / np.sqrt(len(signal))
    if np.ptp(signal) == 0 or (near_zero and float(np.std(signal)) <= ONLY_NOISE * noise):
        raise NoContact(f"station {station.index + 1}: no contact (the signal is constant)")
