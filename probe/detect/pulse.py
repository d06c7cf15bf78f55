"""Is there a pulse in a hold, at what rate, and how large?"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as f_distribution

from probe.detect.fit import (
    WHITE,
    Design,
    Fit,
    colour_of,
    design_of,
    fit,
    harmonics,
    scale_rows,
    whiten,
)
from probe.detect.hold import Hold

Array = NDArray[np.float64]

SLOWEST_HZ, FASTEST_HZ = 40 / 60, 180 / 60
TESTED = 2
"""Harmonics that decide whether there is a pulse: they carry nine tenths of its power."""
MOST_SECOND = 1.0
"""Largest second harmonic over the first: radial and brachial waves have 0.4 to 0.8."""
WAVE_MMHG = np.array([13.94, 7.88, 4.43])
WAVE_RAD = np.array([-1.727, -2.203, -2.906])
"""The brachial wave's first harmonics (mean of 8 subjects, repat8/cam-bpw-sim-pub): what a pulse
looks like to the test. Knowing the shape leaves two unknowns, size and phase, instead of four."""
PHASES = 24
SHARES = np.array([0.35, 0.20, 0.11, 0.064, 0.055, 0.038, 0.025, 0.02, 0.015, 0.012])
"""Harmonics that describe one: the brachial wave's over its swing from trough to crest."""
MISFIT = 0.008
"""How far a beat strays from ten harmonics at one rate, over the largest pulse there may be."""
SWALLOWED = 3.0
"""How much larger a pulse may be than what a fit of relaxation and drift leaves of it."""
FINEST = 0.4
"""Harmonics above this share of the sampling rate are not looked at: mains hum folds there."""
SHORT = 20
"""Samples below which only the fundamental is looked for."""


@dataclass(frozen=True)
class Scale:
    """How large a pulse may be, trough to crest, and the noise of a sample."""

    swing_pa: float
    noise_pa: float


@dataclass(frozen=True)
class Pulse:
    """A station's pulse at ``rate_hz``: ``size_pa`` from trough to crest as fitted, its standard
    deviation, and ``p_value`` of one at least as clear in a hold without any, at any rate.

    ``baseline_pa`` is the mean over the hold of all but the pulse, with its standard deviation;
    ``tries`` how many rates the search could choose among.
    """

    rate_hz: float
    size_pa: float
    size_sd_pa: float
    p_value: float
    baseline_pa: float
    baseline_sd_pa: float
    noise_pa: float
    scale: Scale
    tries: float
    fit: Fit
    by_reference: bool = False


def rates_hz(span_s: float) -> Array:
    """Rates to try: four to each resolvable one."""
    count = max(24, int(np.ceil(4 * (FASTEST_HZ - SLOWEST_HZ) * span_s)))
    return np.linspace(SLOWEST_HZ, FASTEST_HZ, count)


def evidence(hold: Hold, design: Design) -> tuple[Array, tuple[Array, Array], Fit]:
    """Rates (r,), the log likelihood ratios of a pulse at each (of the known shape, of free
    harmonics), and the fit without a pulse.

    Noise is white unless what the clearest pulse leaves is coloured; then its colour is that of
    the fit without a pulse, since colour learnt after taking the clearest rate out makes noise
    look like a pulse ten times too often.
    """
    none = np.empty((len(hold.time_s), 0))
    rates = rates_hz(hold.span_s)
    null = fit(hold, design, none, WHITE)
    gains = _gains(hold, design, null, rates)
    clearest = float(rates[int(np.argmax(gains[1]))])
    best = fit(hold, design, _unsteady(hold, clearest), WHITE)
    if colour_of(best.residual_pa, best.lost).any():
        for _ in range(2):
            null = fit(hold, design, none, colour_of(null.residual_pa, null.lost))
        gains = _gains(hold, design, null, rates)
    return rates, gains, null


def _unsteady(hold: Hold, rate_hz: float) -> Array:
    """Columns of a pulse whose rate and size drift: what hearts do is not the noise's colour."""
    steady = harmonics(hold.time_s, rate_hz, TESTED)
    drift = (hold.time_s - hold.time_s.mean())[:, None] / max(hold.span_s, 1e-9)
    return np.hstack([steady, drift * steady]) if len(hold.time_s) >= 2 * SHORT else steady


def pulse_at(
    hold: Hold, rate_hz: float, p_value: float, scale: Scale, beating_s: Array | None = None
) -> Pulse:
    """The pulse at a known rate.

    Harmonics are shrunk towards the sizes that arterial waves have: a hold shorter than a beat, or
    a slow one in relaxing tissue, would otherwise be explained by huge waves that cancel. The
    noise's level and colour are what the whole wave leaves.
    ``beating_s`` (n,) where time is counted in another way for the harmonics.
    """
    first, _ = described(hold, rate_hz, WHITE, scale, beating_s)
    colour = colour_of(first.residual_pa, first.lost)
    scale = Scale(scale.swing_pa, max(first.noise_pa, MISFIT * scale.swing_pa))
    found, columns = described(hold, rate_hz, colour, scale, beating_s)
    wave = columns @ found.coefficients[2:]
    high, low = int(np.argmax(wave)), int(np.argmin(wave))
    slope = columns[high] - columns[low]
    size_sd = float(np.sqrt(max(slope @ found.covariance[2:, 2:] @ slope, 0.0)))
    unmodelled = max(1.0, scale.noise_pa / max(found.noise_pa, 1e-12))
    return Pulse(
        rate_hz, float(wave[high] - wave[low]), unmodelled * size_sd, p_value,
        float(found.rest_pa.mean()), unmodelled * found.rest_mean_sd_pa, found.noise_pa,
        scale, independent_rates(hold.span_s), found,
    )  # fmt: skip


def described(
    hold: Hold, rate_hz: float, colour: Array, scale: Scale, beating_s: Array | None = None
) -> tuple[Fit, Array]:
    """The fit of a whole wave at a rate, and its columns (n, 2 harmonics)."""
    finest = FINEST * len(hold.time_s) / max(hold.span_s, 1e-9)
    count = int(np.clip(finest // rate_hz, 1, len(SHARES)))
    columns = harmonics(hold.time_s if beating_s is None else beating_s, rate_hz, count)
    ridge = scale.noise_pa / (np.tile(SHARES[:count], 2) * max(scale.swing_pa, 1e-12))
    return fit(hold, design_of(hold), columns, colour, ridge), columns


def scale_of(null: Fit, known: Fit) -> Scale:
    """From the fits without a pulse and with its first harmonics.

    What relaxation and drift cannot explain is at least a third of the pulse.
    """
    left = null.residual_pa
    return Scale(float(SWALLOWED * np.ptp(np.percentile(left, [2, 98]))), known.noise_pa)


def find_pulse(hold: Hold) -> Pulse:
    """The clearest pulse of a hold, whether or not there is one: ``p_value`` says.

    It passes as a wave of the known shape or as any first two harmonics; the chance of either is
    at most twice the smaller one's.
    """
    design = design_of(hold)
    rates, (shaped, free), null = evidence(hold, design)
    n = len(hold.time_s)
    chances = [
        chance(float(gain.max()), columns, null.dof - columns, n, hold.span_s)
        for gain, columns in ((shaped, 2), (free, 2 * TESTED))
    ]
    gain = shaped if chances[0] <= chances[1] else free
    rate = float(rates[int(np.argmax(gain))])
    known = fit(hold, design, harmonics(hold.time_s, rate, TESTED), null.colour)
    p_value = min(1.0, 2 * min(chances))
    return pulse_at(hold, rate, p_value, scale_of(null, known))


def chance(gain: float, columns: int, dof: int, n: int, span_s: float) -> float:
    """How often a hold without a pulse shows a log likelihood ratio of ``gain`` at its best rate.

    F test of ``columns`` unknowns at that rate, times the number of rates that are independent
    (Davies 1987: crossings of the statistic, here about two for each resolvable rate).
    """
    dof = max(dof, 1)
    ratio = np.expm1(2 * gain / n) * dof / columns
    one = min(float(f_distribution.sf(ratio, columns, dof)), 1 - 1e-16)
    return float(-np.expm1(independent_rates(span_s) * np.log1p(-one)))


def independent_rates(span_s: float) -> float:
    """Rates that a hold of ``span_s`` tells apart."""
    return 1 + 2 * (FASTEST_HZ - SLOWEST_HZ) * span_s


def _gains(hold: Hold, design: Design, null: Fit, rates: Array) -> tuple[Array, Array]:
    """Log likelihood ratios (r,) of the known shape and of two free harmonics at each rate, the
    decays held to those that the null fit uses.

    The second free harmonic counts only where it is no larger than a pulse's.
    """
    scale, colour = np.sqrt(hold.weight), null.colour
    used = design.decays[:, null.decays]
    nuisance = whiten(scale_rows(np.hstack([design.drift, used]), scale), colour)
    q, _ = np.linalg.qr(nuisance)
    y = whiten(scale_rows(hold.signal_pa, scale), colour)
    y = y - q @ (q.T @ y)
    count = len(WAVE_MMHG) if len(y) >= SHORT else 1
    columns = np.stack([harmonics(hold.time_s, r, count) for r in rates], axis=1)
    c = np.moveaxis(whiten(columns * scale[:, None, None], colour), 0, 1)  # (r, n, 2 count)
    c = c - q @ (q.T @ c)
    right, gram = np.swapaxes(c, 1, 2) @ y, np.swapaxes(c, 1, 2) @ c
    rss = max(float(y @ y), 1e-300)

    def ratio(drop: Array) -> Array:
        return np.asarray(-0.5 * len(y) * np.log(np.clip(1 - drop / rss, 1e-12, 1.0)))

    finest = FINEST * (len(y) - 1) / max(hold.span_s, 1e-9)
    seen = rates[:, None] * np.arange(1, count + 1) <= finest
    return ratio(_as_wave(right, gram, seen)), ratio(_as_harmonics(right, gram, seen))


def _as_wave(right: Array, gram: Array, seen: NDArray[np.bool_]) -> Array:
    """What the known shape explains (r,) at its best phase, its size positive.

    ``seen`` (r, count): harmonics that the samples can tell from noise near their Nyquist rate.
    """
    count = seen.shape[1]
    order = np.arange(1, count + 1)
    turned = WAVE_RAD[:count] + order * np.linspace(0, 2 * np.pi, PHASES, endpoint=False)[:, None]
    size = WAVE_MMHG[:count] * seen[:, None, :]
    shape = np.concatenate([size * np.cos(turned), -size * np.sin(turned)], axis=2)
    along = np.maximum(np.einsum("rpk,rk->rp", shape, right), 0.0)
    power = ((shape @ gram) * shape).sum(axis=2)
    return np.asarray((along**2 / np.maximum(power, 1e-300)).max(axis=1))


def _as_harmonics(right: Array, gram: Array, seen: NDArray[np.bool_]) -> Array:
    """What the first one or two harmonics explain (r,)."""
    count = seen.shape[1]
    _, one = _explained(right, gram, [0, count])
    if count == 1:
        return one
    a, two = _explained(right, gram, [0, 1, count, count + 1])
    size = np.hypot(a[:, :2], a[:, 2:])
    pulse_like = seen[:, 1] & (size[:, 1] <= MOST_SECOND * size[:, 0])
    return np.asarray(np.where(pulse_like, two, one))


def _explained(right: Array, gram: Array, chosen: list[int]) -> tuple[Array, Array]:
    """Coefficients (r, k) of least squares on the ``chosen`` columns, and what they explain."""
    b, g = right[:, chosen], gram[:, chosen][:, :, chosen]
    ridge = 1e-9 * np.trace(g, axis1=1, axis2=2)[:, None, None] * np.eye(len(chosen))
    solved = np.linalg.solve(g + ridge, b[..., None])[..., 0]
    return solved, (b * solved).sum(axis=1)
