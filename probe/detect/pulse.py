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
MOST = 6
"""Harmonics that describe one."""
REFINED = 3


@dataclass(frozen=True)
class Pulse:
    """A station's pulse at ``rate_hz``: ``size_pa`` from trough to crest as fitted, its standard
    deviation, and ``p_value`` of one at least as clear in a hold without any, at any rate.

    ``baseline_pa`` is the mean over the hold of all but the pulse, with its standard deviation.
    """

    rate_hz: float
    size_pa: float
    size_sd_pa: float
    p_value: float
    baseline_pa: float
    baseline_sd_pa: float
    noise_pa: float
    fit: Fit


def rates_hz(span_s: float) -> Array:
    """Rates to try: four to each resolvable one."""
    count = max(24, int(np.ceil(4 * (FASTEST_HZ - SLOWEST_HZ) * span_s)))
    return np.linspace(SLOWEST_HZ, FASTEST_HZ, count)


def evidence(hold: Hold, design: Design | None = None) -> tuple[Array, Array, Array]:
    """Rates (r,), the log likelihood ratio of a pulse at each, and the noise's colour."""
    design = design or design_of(hold)
    rates = rates_hz(hold.span_s)
    colour = WHITE
    for _ in range(3):
        null = fit(hold, design, np.empty((len(hold.time_s), 0)), colour)
        gain = _gains(hold, design, null, rates, colour)
        best = rates[int(np.argmax(gain))]
        with_pulse = fit(hold, design, harmonics(hold.time_s, best, TESTED), colour)
        colour = colour_of(with_pulse.residual_pa, len(hold.time_s) - with_pulse.dof)
    return rates, gain, colour


def pulse_at(hold: Hold, rate_hz: float, colour: Array, p_value: float, count: int) -> Pulse:
    """The pulse at a known rate with ``count`` harmonics."""
    design = design_of(hold)
    columns = harmonics(hold.time_s, rate_hz, count)
    found = fit(hold, design, columns, colour)
    wave = columns @ found.coefficients[2:]
    high, low = int(np.argmax(wave)), int(np.argmin(wave))
    slope = columns[high] - columns[low]
    size_sd = float(np.sqrt(max(slope @ found.covariance[2:, 2:] @ slope, 0.0)))
    baseline_sd = float(np.sqrt(max(found.covariance[0, 0], 0.0)))
    return Pulse(
        rate_hz, float(wave[high] - wave[low]), size_sd, p_value,
        float(found.rest_pa.mean()), baseline_sd, found.noise_pa, found,
    )  # fmt: skip


def find_pulse(hold: Hold) -> Pulse:
    """The clearest pulse of a hold, whether or not there is one: ``p_value`` says."""
    design = design_of(hold)
    rates, gain, colour = evidence(hold, design)
    null = fit(hold, design, np.empty((len(hold.time_s), 0)), colour)
    tried = rates[np.argsort(gain)[::-1][:REFINED]]
    p_values = [_tested(hold, design, null, rate, colour) for rate in tried]
    best = int(np.argmin(p_values))
    rate = float(tried[best])
    return pulse_at(hold, rate, colour, p_values[best], described(hold, rate, colour))


def _tested(hold: Hold, design: Design, null: Fit, rate_hz: float, colour: Array) -> float:
    """The chance of this rate's pulse, of two harmonics where they are a pulse's."""
    two = fit(hold, design, harmonics(hold.time_s, rate_hz, TESTED), colour)
    a = np.hypot(*two.coefficients[2:].reshape(2, TESTED))
    if len(hold.time_s) >= 20 and a[1] <= MOST_SECOND * a[0]:
        return chance(null, two, 2 * TESTED, hold.span_s)
    return chance(
        null, fit(hold, design, harmonics(hold.time_s, rate_hz, 1), colour), 2, hold.span_s
    )


def chance(null: Fit, other: Fit, columns: int, span_s: float) -> float:
    """How often a hold without a pulse shows one at least as clear, at the best of all rates.

    F test of the best rate, times the number of rates that are independent (Davies 1987: level
    crossings of the statistic, here about two for each resolvable rate).
    """
    dof = other.dof
    ratio = max(null.rss - other.rss, 0.0) / columns / max(other.rss / dof, 1e-300)
    independent = 1 + 2 * (FASTEST_HZ - SLOWEST_HZ) * span_s
    return float(
        -np.expm1(independent * np.log1p(-min(f_distribution.sf(ratio, columns, dof), 1 - 1e-16)))
    )


def described(hold: Hold, rate_hz: float, colour: Array) -> int:
    """Harmonics worth their cost by the Bayesian information criterion (Schwarz 1978)."""
    design = design_of(hold)
    n = len(hold.time_s)
    finest = 0.4 * n / max(hold.span_s, 1e-9)
    scores = []
    for count in range(1, MOST + 1):
        if count > 1 and count * rate_hz > finest:
            break
        one = fit(hold, design, harmonics(hold.time_s, rate_hz, count), colour)
        scores.append(n * np.log(max(one.rss, 1e-300) / n) + 2 * count * np.log(n))
    return 1 + int(np.argmin(scores))


def _gains(hold: Hold, design: Design, null: Fit, rates: Array, colour: Array) -> Array:
    """Log likelihood ratio at each rate, the decays held to those that the null fit uses.

    Of two harmonics, or of one where the second would be larger than a pulse's.
    """
    scale = np.sqrt(hold.weight)
    used = design.decays[:, null.decays]
    nuisance = whiten(scale_rows(np.hstack([design.drift, used]), scale), colour)
    q, _ = np.linalg.qr(nuisance)
    y = whiten(scale_rows(hold.signal_pa, scale), colour)
    y = y - q @ (q.T @ y)
    columns = np.stack([harmonics(hold.time_s, r, TESTED) for r in rates], axis=1)
    c = np.moveaxis(whiten(columns * scale[:, None, None], colour), 0, 1)  # (r, n, 4)
    c = c - q @ (q.T @ c)
    two, drop_two = _explained(c, y)
    _, drop_one = _explained(c[:, :, [0, TESTED]], y)
    a = np.hypot(two[:, :TESTED], two[:, TESTED:])
    drop = np.where(a[:, 1] <= MOST_SECOND * a[:, 0], drop_two, drop_one)
    rss = max(float(y @ y), 1e-300)
    return np.asarray(-0.5 * len(y) * np.log(np.clip(1 - drop / rss, 1e-12, 1.0)))


def _explained(columns: Array, y: Array) -> tuple[Array, Array]:
    """Coefficients (r, k) of least squares on ``columns`` (r, n, k), and what each explains."""
    right = np.swapaxes(columns, 1, 2) @ y[:, None]
    gram = np.swapaxes(columns, 1, 2) @ columns
    trace = np.trace(gram, axis1=1, axis2=2)[:, None, None]
    solved = np.linalg.solve(gram + 1e-9 * trace * np.eye(gram.shape[1]), right)
    return solved[..., 0], (right * solved).sum(axis=(1, 2))
