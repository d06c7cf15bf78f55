"""A pulse with a reference: a PPG or ECG gives the beats; size and shape are unknown."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.special import fdtrc

from drivers.core.arrays import Array
from probe.detection.pulse.estimate import Clearest, beside, scale_of, wave_at
from probe.detection.pulse.fit import design_of, fit, harmonics
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.noise import likeliest
from probe.detection.pulse.possible_rates import FASTEST_HZ, RATE_VARIABILITY, SLOWEST_HZ
from probe.detection.pulse.search import TESTED_HARMONICS
from probe.detection.pulse.uneven_beats import MIN_WHOLE

SMOOTHED_S, INTEGRATED_S = 0.04, 0.1
"""Half of a QRS complex, which noise and mains are averaged over, and its length, over which its
steep slopes are summed (Pan and Tompkins 1985)."""
MIN_ENERGY = 0.12
"""Least energy of a beat's slopes over the median one's: a beat 0.35 as steep. T waves have at most
0.06 and whole beats at least 0.47 in the recordings of tests/data/beats, noise or not."""

NEARER_TO_ONE = 0.5
"""Of the usual beat: what is off by more is nearer to two beats, or to none."""


def beats_s(time_s: Array, reference: Array) -> Array:
    """When the beats of a reference come: where it rises steepest, at most one per fastest period.

    A QRS complex and a pulse's upstroke are the steepest parts of a beat, whatever the height of
    what follows them; so height is not asked. A reference that falls more steeply than it rises
    (an inverted lead, light that blood absorbs) is turned over.
    """
    from scipy.ndimage import uniform_filter1d
    from scipy.signal import find_peaks  # half a second to import, for scans with a reference

    good = np.isfinite(time_s) & np.isfinite(reference)
    time_s, reference = time_s[good], reference[good]
    if len(time_s) < 3 or np.ptp(reference) == 0:
        return np.empty(0)
    step = float(np.median(np.diff(time_s)))
    if step <= 0:
        return np.empty(0)
    smooth = uniform_filter1d(reference, max(1, round(SMOOTHED_S / step)))
    slope = np.gradient(smooth)
    slope = slope if float((slope**3).sum()) >= 0 else -slope
    energy = uniform_filter1d(np.maximum(slope, 0.0) ** 2, max(1, round(INTEGRATED_S / step)))
    closest = max(1, int(1 / FASTEST_HZ / step))
    peaks, _ = find_peaks(energy, distance=closest)
    if not len(peaks):
        return np.empty(0)
    beats = max(1, int(SLOWEST_HZ * (time_s[-1] - time_s[0])))  # as many there are at least
    usual = float(np.median(np.sort(energy[peaks])[-beats:]))
    return np.asarray(time_s[peaks[energy[peaks] >= MIN_ENERGY * usual]])


def find_pulse_by(hold: Hold, time_s: Array, reference: Array) -> Clearest | None:
    """The pulse that beats as ``reference`` (m,) does at ``time_s`` (m,), counted as the hold's.

    None where the reference has fewer than two beats, none near the hold, or two lengths so unlike
    that neither is usual. Beats may vary: time is counted in beats before the harmonics are
    fitted, so a mean over many beats (synchronous averaging) does not smear.
    """
    beats = beats_s(time_s, reference)
    between = np.diff(beats)
    if len(beats) < 2:
        return None
    usual = float(np.median(between))
    whole = between[np.abs(between - usual) < NEARER_TO_ONE * usual]
    if not len(whole):
        return None
    period = float(whole.mean())
    if not SLOWEST_HZ / 2 <= 1 / period <= 2 * FASTEST_HZ:
        return None
    if hold.time_s[0] < beats[0] - period or hold.time_s[-1] > beats[-1] + period:
        return None
    warped = replace(hold, time_s=_in_beats(hold.time_s, beats, period) * period)
    rate = 1 / period
    design, none = design_of(hold), np.empty((len(hold.time_s), 0))
    columns = harmonics(warped.time_s, rate, TESTED_HARMONICS)
    known = fit(hold, design, columns)
    noise = likeliest(known.residual_pa, hold.step_s, hold.averaged_s)
    without, with_ = fit(hold, design, none, noise), fit(hold, design, columns, noise)
    free = columns.shape[1]
    ratio = max(without.rss - with_.rss, 0.0) / free / (with_.rss / max(with_.dof, 1))
    p_value = float(fdtrc(free, max(with_.dof, 1), ratio))
    noise, scale = beside(hold, rate, scale_of(without, with_), warped.time_s)
    seen = float(whole.std(ddof=1)) / period if len(whole) >= MIN_WHOLE else 0.0
    return Clearest(
        rate, p_value, noise, scale, None, warped.time_s, max(seen, RATE_VARIABILITY)
    )  # fmt: skip


def contradicted(both: Iterable[tuple[Hold, Clearest, Clearest]]) -> bool:
    """Whether holds beat otherwise than their reference does: a light that nobody wears, a lead
    that fell off, or another person's.

    ``both`` are holds that pulse without it, their pulse by the reference and that by themselves.
    The one has to explain them better than the other by more than its free rates may
    (Schwarz 1978).
    """
    gain = 0.0
    for hold, by_reference, alone in both:
        rss = [
            wave_at(hold, one.rate_hz, one.noise, one.scale, one.beating_s).fit.rss
            for one in (by_reference, alone)
        ]
        n = len(hold.time_s)
        gain += 0.5 * n * float(np.log(max(rss[0], 1e-300) / max(rss[1], 1e-300))) - np.log(n)
    return gain > 0


def _in_beats(time_s: Array, beats: Array, period: float) -> Array:
    """Time as a number of beats (n,), continued at the usual rate before the first and last."""
    ends = np.concatenate([[beats[0] - period], beats, [beats[-1] + period]])
    return np.asarray(np.interp(time_s, ends, np.arange(-1.0, len(beats) + 1)))
