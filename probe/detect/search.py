"""The search for a pulse in a hold: how well one explains it at each rate that hearts have."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
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
SWING_MMHG = 40.0
"""The whole wave's, from trough to crest."""
PHASES = 24
CHOICE = 0.66
"""What choosing the best of all phases adds to a chi-square of two degrees, on average; its spread
stays (400,000 holds of white noise)."""
FINEST = 0.4
"""Harmonics above this share of the sampling rate are not looked at: mains hum folds there."""
SHORT = 20
"""Samples below which only the fundamental is looked for."""


@dataclass(frozen=True)
class Search:
    """What a hold says of a pulse at ``rates_hz`` (r,).

    A pulse of the known shape, ``size`` [Pa] from trough to crest, has the log likelihood ratio
    ``size * along - size**2 * power / 2`` at each rate and phase (r, PHASES). ``clear`` (r,) is how
    far its best size and phase explain the hold, as a chi-square of two degrees in a hold without
    a pulse. ``p_value`` is the chance of one as clear at any rate and of any shape, ``rate_hz`` the
    clearest. ``gain`` (r,) is how far any two harmonics explain the hold in white noise, as a log
    likelihood ratio: a loud pulse is no noise's colour.
    """

    rates_hz: Array
    along: Array
    power: Array
    clear: Array
    gain: Array
    rate_hz: float
    p_value: float
    span_s: float


def search(hold: Hold) -> tuple[Search, Fit]:
    """Look for a pulse, and the fit without one.

    It passes as a wave of the known shape or as any first two harmonics; the chance of either is
    at most twice the smaller one's. Noise is white unless what the clearest pulse leaves is
    coloured; then its colour is that of the fit without a pulse, since colour learnt after taking
    the clearest rate out makes noise look like a pulse ten times too often.
    """
    design, none = design_of(hold), np.empty((len(hold.time_s), 0))
    rates = rates_hz(hold.span_s)
    null = fit(hold, design, none, WHITE)
    seen = _look(hold, design, null, rates)
    white = seen.free
    best = fit(hold, design, _unsteady(hold, float(rates[int(np.argmax(seen.free))])), WHITE)
    if colour_of(best.residual_pa, best.lost).any():
        for _ in range(2):
            null = fit(hold, design, none, colour_of(null.residual_pa, null.lost))
        seen = _look(hold, design, null, rates)
    n, lost = len(hold.time_s), 2 * TESTED
    shaped, free = _single(seen.shaped, 2, null.dof - 2, n), _single(seen.free, lost,
                                                                    null.dof - lost, n)  # fmt: skip
    one, gain = (shaped, seen.shaped) if shaped.min() <= free.min() else (free, seen.free)
    p_value = min(1.0, 2 * anywhere(float(one.min()), hold.span_s))
    return Search(
        rates, seen.along, seen.power,
        np.maximum(chi2.isf(np.maximum(shaped, 1e-300), 2) - CHOICE * (n >= SHORT), 0.0), white,
        float(rates[int(np.argmax(gain))]), p_value, hold.span_s,  # chances may all be 0.0
    ), null  # fmt: skip


def rates_hz(span_s: float) -> Array:
    """Rates to try: four to each resolvable one."""
    count = max(24, int(np.ceil(4 * (FASTEST_HZ - SLOWEST_HZ) * span_s)))
    return np.linspace(SLOWEST_HZ, FASTEST_HZ, count)


def anywhere(one: float, span_s: float) -> float:
    """How often a hold without a pulse shows at its best rate what has the chance ``one`` at a
    given rate: the number of rates that are independent (Davies 1987: crossings of the statistic,
    here about two for each resolvable rate)."""
    return float(-np.expm1(independent_rates(span_s) * np.log1p(-min(one, 1 - 1e-16))))


def independent_rates(span_s: float) -> float:
    """Rates that a hold of ``span_s`` tells apart."""
    return 1 + 2 * (FASTEST_HZ - SLOWEST_HZ) * span_s


@dataclass(frozen=True)
class _Seen:
    """Log likelihood ratios (r,) of the known shape and of two free harmonics; see `Search`."""

    shaped: Array
    free: Array
    along: Array
    power: Array


def _single(gain: Array, columns: int, dof: int, n: int) -> Array:
    """Chance at each rate of a log likelihood ratio ``gain`` (r,): F test of ``columns``."""
    dof = max(dof, 1)
    ratio = np.expm1(2 * gain / n) * dof / columns
    return np.asarray(f_distribution.sf(ratio, columns, dof))


def _unsteady(hold: Hold, rate_hz: float) -> Array:
    """Columns of a pulse whose rate and size drift: what hearts do is not the noise's colour."""
    steady = harmonics(hold.time_s, rate_hz, TESTED)
    drift = (hold.time_s - hold.time_s.mean())[:, None] / max(hold.span_s, 1e-9)
    return np.hstack([steady, drift * steady]) if len(hold.time_s) >= 2 * SHORT else steady


def _look(hold: Hold, design: Design, null: Fit, rates: Array) -> _Seen:
    """The hold at each rate, its decays held to those that the null fit uses.

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
    along, power = _as_wave(right, gram, seen)
    drop = (np.maximum(along, 0.0) ** 2 / np.maximum(power, 1e-300)).max(axis=1)
    size, variance = SWING_MMHG, rss / max(null.dof, 1)
    return _Seen(ratio(drop), ratio(_as_harmonics(right, gram, seen)),
                 along / (size * variance), power / (size**2 * variance))  # fmt: skip


def _as_wave(right: Array, gram: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """The hold along the known shape [mmHg], and the shape's own square, both (r, PHASES).

    ``seen`` (r, count): harmonics that the samples can tell from noise near their Nyquist rate.
    """
    count = seen.shape[1]
    order = np.arange(1, count + 1)
    turned = WAVE_RAD[:count] + order * np.linspace(0, 2 * np.pi, PHASES, endpoint=False)[:, None]
    size = WAVE_MMHG[:count] * seen[:, None, :]
    shape = np.concatenate([size * np.cos(turned), -size * np.sin(turned)], axis=2)
    along = np.einsum("rpk,rk->rp", shape, right)
    return np.asarray(along), np.asarray(((shape @ gram) * shape).sum(axis=2))


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
