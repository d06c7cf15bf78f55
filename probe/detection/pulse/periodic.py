"""How likely a hold is if what moves in it repeats at one rate: harmonics, or the mean wave."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from drivers.core.arrays import Array, Bools, Ints
from probe.detection.pulse.beat_train import MEMORIES, Coarse, whiten
from probe.detection.pulse.own_shape import NYQUIST_SHARE, SAMPLES_EACH
from probe.detection.pulse.wave import AMPLITUDES_MMHG, PHASES_RAD

REFINED = 3
"""Rounds of narrowing a rate, each to an eighth: a strong line must be met within its doubt."""
FINER = 17
"""Rates of such a round."""
SHAPE_PHASES = 24


def log_evidence(left: Array, n: int, unknowns: int | Ints) -> Array:
    """Of a linear model by what it leaves of the hold (Schwarz 1978)."""
    return np.asarray(-0.5 * n * np.log(np.maximum(left, 1e-300) / n) - 0.5 * n
                      - 0.5 * (unknowns + 2) * np.log(n))  # fmt: skip


def periodic(hold: Coarse, slowest_hz: float, fastest_hz: float, count: int) -> float:
    """Log evidence of up to ``count`` harmonics at one unknown rate, the first the largest."""
    n = len(hold.signal)
    count = max(1, min(count, int((n / SAMPLES_EACH - 1) / 2)))
    return _at_best_rate(hold, slowest_hz, fastest_hz, lambda rates, memory: _at_rates(
        hold, rates, count, memory
    ))  # fmt: skip


def mean_wave(hold: Coarse, slowest_hz: float, fastest_hz: float) -> float:
    """Log evidence of the brachial wave at one unknown rate: of a faint pulse no more than its
    size and phase can be known, and harmonics of any size cost more than they explain."""
    return _at_best_rate(hold, slowest_hz, fastest_hz, lambda rates, memory: _as_wave(
        hold, rates, memory
    ))  # fmt: skip


def _at_best_rate(
    hold: Coarse, slowest_hz: float, fastest_hz: float, at: Callable[[Array, float], Array]
) -> float:
    """Log evidence of the best rate, in the likeliest noise, less what choosing it costs.

    Each noise finds its own: a loud line between two rates of the grid leaves what looks coloured.
    """
    fastest_hz = min(fastest_hz, NYQUIST_SHARE / hold.step_s)
    independent = 1 + (fastest_hz - slowest_hz) * len(hold.signal) * hold.step_s
    rates = np.linspace(slowest_hz, fastest_hz, int(4 * independent))
    best = -np.inf
    for memory in MEMORIES:
        tried = rates
        for _ in range(1 + REFINED):
            each = at(tried, memory)
            k = int(np.argmax(each))
            best = max(best, float(each[k]))
            tried = np.linspace(tried[max(k - 1, 0)], tried[min(k + 1, len(tried) - 1)], FINER)
    return float(best - np.log(independent))


def _at_rates(hold: Coarse, rates: Array, count: int, memory: float) -> Array:
    """Evidence (r,) of harmonics at each rate; none where the first is not the largest."""
    n = len(hold.signal)
    beside = beside_of(hold, memory)
    y = whiten(hold.signal, memory)
    y = y - beside @ (beside.T @ y)
    c, seen = _waves(n, hold.step_s, tuple(rates.tolist()), count, memory)
    c = c - beside @ (beside.T @ c)
    gram = np.swapaxes(c, 1, 2) @ c + 1e-9 * n * np.eye(2 * count)
    right = np.swapaxes(c, 1, 2) @ y
    size = np.linalg.solve(gram, right[..., None])[..., 0]
    left = float(y @ y) - (right * size).sum(axis=1)
    swing = np.hypot(size[:, :count], size[:, count:])
    unknowns = 2 * seen.sum(axis=1)
    found = log_evidence(left, n - (memory == 1.0), unknowns)
    return np.asarray(np.where(swing.argmax(axis=1) == 0, found, -np.inf))


def _as_wave(hold: Coarse, rates: Array, memory: float) -> Array:
    """Evidence (r,) of the mean wave at each rate, its size and phase the best; none where the
    samples show its first harmonic only, which any line has."""
    n = len(hold.signal)
    beside = beside_of(hold, memory)
    y = whiten(hold.signal, memory)
    y = y - beside @ (beside.T @ y)
    count = len(AMPLITUDES_MMHG)
    c, seen = _waves(n, hold.step_s, tuple(rates.tolist()), count, memory)
    turn = np.linspace(0, 2 * np.pi, SHAPE_PHASES, endpoint=False)[:, None]
    angle = turn * np.arange(1, count + 1) + PHASES_RAD
    shape = np.hstack([AMPLITUDES_MMHG * np.cos(angle), -AMPLITUDES_MMHG * np.sin(angle)]).T
    waves = c @ shape  # harmonics that are not seen are zero
    along = np.maximum(y @ waves, 0.0) ** 2
    power = (waves**2).sum(axis=1) - ((beside.T @ waves) ** 2).sum(axis=1)
    left = float(y @ y) - (along / np.maximum(power, 1e-300)).max(axis=1)
    found = log_evidence(left, n - (memory == 1.0), 2)
    return np.asarray(np.where(seen[:, 1], found, -np.inf))


@lru_cache(maxsize=32)
def _waves(
    n: int, step_s: float, rates: tuple[float, ...], count: int, memory: float
) -> tuple[Array, Bools]:
    """Whitened harmonics (r, n, 2 count) of each rate, and which (r, count) the samples can tell:
    the same for all holds of a scan, but for those of a refined rate."""
    seen = np.outer(rates, np.arange(1, count + 1)) <= max(NYQUIST_SHARE / step_s, rates[0])
    turn = (
        2
        * np.pi
        * (np.arange(n) * step_s)[:, None, None]
        * np.outer(rates, np.arange(1, count + 1))
    )
    waves = np.concatenate([np.cos(turn) * seen, np.sin(turn) * seen], axis=2)
    return np.ascontiguousarray(np.moveaxis(whiten(waves, memory), 0, 1)), seen


def beside_of(hold: Coarse, memory: float) -> Array:
    """An orthonormal basis (n, k) of what relaxation and drift could take, whitened."""
    columns = whiten(hold.nuisance, memory)
    u, size, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u[:, size > 1e-9 * size[0]])
