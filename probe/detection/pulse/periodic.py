"""How likely a hold is if what moves in it repeats at one rate: harmonics, or the mean wave."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from drivers.core.arrays import Array, Bools, Ints
from probe.detection.pulse.beat_train import MEMORIES, Coarse, whiten
from probe.detection.pulse.fit import harmonics
from probe.detection.pulse.possible_rates import weights
from probe.detection.pulse.search import PHASES
from probe.detection.pulse.train_evidence import NYQUIST_SHARE, SAMPLES_EACH
from probe.detection.pulse.wave import AMPLITUDES_MMHG, PHASES_RAD

Likely = Callable[[Array], Array]

REFINED = 3
"""Rounds of narrowing a rate, each to an eighth: a strong line must be met within its doubt."""
FINER = 17
"""Rates of such a round."""


def log_evidence(rss: Array, n: int, unknowns: int | Ints) -> Array:
    """Of a linear model by what it leaves of the hold (Schwarz 1978)."""
    return np.asarray(-0.5 * n * np.log(np.maximum(rss, 1e-300) / n) - 0.5 * n
                      - 0.5 * (unknowns + 2) * np.log(n))  # fmt: skip


def periodic(
    hold: Coarse, slowest_hz: float, fastest_hz: float, count: int, likely: Likely = np.ones_like,
    memories: Sequence[float] = MEMORIES,
) -> float:  # fmt: skip
    """Log evidence of up to ``count`` harmonics at one unknown rate, the first the largest.

    ``likely`` states how likely rates (r,) are beforehand, on average 1 (`possible_rates.weights`).
    ``memories`` are those of the noises that there may be.
    """
    count = max(1, min(count, int((len(hold.signal) / SAMPLES_EACH - 1) / 2)))
    return _at_best_rate(hold, slowest_hz, fastest_hz, count, _as_harmonics, likely, memories)


def mean_wave(
    hold: Coarse, slowest_hz: float, fastest_hz: float, memories: Sequence[float] = MEMORIES,
    refined: int = REFINED,
) -> float:  # fmt: skip
    """Log evidence of the brachial wave at a heart's rate, narrowed ``refined`` times: of a faint
    pulse no more than its size and phase can be known, and harmonics of any size cost more than
    they explain. ``memories`` are those of the noises that there may be."""
    count = len(AMPLITUDES_MMHG)
    return _at_best_rate(hold, slowest_hz, fastest_hz, count, _as_wave, weights, memories, refined)


@dataclass(frozen=True)
class _Waves:
    """Whitened harmonics (r, n, 2 count) of each rate, their products (r, 2 count, 2 count), and
    which (r, count) the samples can tell."""

    columns: Array
    gram: Array
    seen: Bools


def _at_best_rate(
    hold: Coarse, slowest_hz: float, fastest_hz: float, count: int,
    evidence: Callable[[Coarse, _Waves, float], Array], likely: Likely,
    memories: Sequence[float], refined: int = REFINED,
) -> float:  # fmt: skip
    """Log evidence of the best rate, in the likeliest noise, less what choosing it costs.

    Each noise finds its own: a loud line between two rates of the grid leaves what looks coloured.
    """
    n = len(hold.signal)
    fastest_hz = min(fastest_hz, NYQUIST_SHARE / hold.step_s)
    independent = 1 + (fastest_hz - slowest_hz) * n * hold.step_s
    rates = np.linspace(slowest_hz, fastest_hz, int(4 * independent))
    best = -np.inf
    for memory in memories:
        tried = rates
        waves = _grid_waves(n, hold.step_s, tuple(rates.tolist()), count, memory)
        for finer in range(1 + refined):
            if finer:
                waves = _waves(n, hold.step_s, tried, count, memory)
            each = evidence(hold, waves, memory) + np.log(likely(tried))
            k = int(np.argmax(each))
            best = max(best, float(each[k]))
            tried = np.linspace(tried[max(k - 1, 0)], tried[min(k + 1, len(tried) - 1)], FINER)
    return float(best - np.log(independent))


def _as_harmonics(hold: Coarse, waves: _Waves, memory: float) -> Array:
    """Evidence (r,) of harmonics at each rate; none where the first is not the largest."""
    n, count = len(hold.signal), waves.seen.shape[1]
    nuisance, y = beside_of(hold, memory)
    along = nuisance.T @ waves.columns
    gram = waves.gram - np.swapaxes(along, 1, 2) @ along + 1e-9 * n * np.eye(2 * count)
    right = y @ waves.columns
    size = np.linalg.solve(gram, right[..., None])[..., 0]
    rss = float(y @ y) - (right * size).sum(axis=1)
    swing = np.hypot(size[:, :count], size[:, count:])
    unknowns = 2 * waves.seen.sum(axis=1)
    evidence = log_evidence(rss, n - (memory == 1.0), unknowns)
    return np.asarray(np.where(swing.argmax(axis=1) == 0, evidence, -np.inf))


def _as_wave(hold: Coarse, waves: _Waves, memory: float) -> Array:
    """Evidence (r,) of the mean wave at each rate, its size and phase the best; none where the
    samples show its first harmonic only, which any line has."""
    n, count = len(hold.signal), waves.seen.shape[1]
    nuisance, y = beside_of(hold, memory)
    turn = np.linspace(0, 2 * np.pi, PHASES, endpoint=False)[:, None]
    angle = turn * np.arange(1, count + 1) + PHASES_RAD
    shape = np.hstack([AMPLITUDES_MMHG * np.cos(angle), -AMPLITUDES_MMHG * np.sin(angle)]).T
    # harmonics that are not seen are zero
    aside = (nuisance.T @ waves.columns) @ shape
    power = (shape * (waves.gram @ shape)).sum(axis=1) - (aside**2).sum(axis=1)
    along = np.maximum((y @ waves.columns) @ shape, 0.0) ** 2
    rss = float(y @ y) - (along / np.maximum(power, 1e-300)).max(axis=1)
    evidence = log_evidence(rss, n - (memory == 1.0), 2)
    return np.asarray(np.where(waves.seen[:, 1], evidence, -np.inf))


def _waves(n: int, step_s: float, rates: Array, count: int, memory: float) -> _Waves:
    seen = np.outer(rates, np.arange(1, count + 1)) <= max(NYQUIST_SHARE / step_s, rates[0])
    turned = harmonics(step_s * np.arange(n, dtype=float), rates, count)
    white = whiten(turned * np.tile(seen, 2), memory)
    columns = np.ascontiguousarray(np.moveaxis(white, 0, 1))
    return _Waves(columns, np.swapaxes(columns, 1, 2) @ columns, seen)


@lru_cache(maxsize=32)
def _grid_waves(
    n: int, step_s: float, rates: tuple[float, ...], count: int, memory: float
) -> _Waves:
    """The same for all holds of a scan."""
    return _waves(n, step_s, np.array(rates), count, memory)


@lru_cache(maxsize=8)
def beside_of(hold: Coarse, memory: float) -> tuple[Array, Array]:
    """An orthonormal basis (n, k) of what relaxation and drift could take, whitened, and the
    whitened signal (n,) beside it."""
    columns = whiten(hold.nuisance, memory)
    u, size, _ = np.linalg.svd(columns, full_matrices=False)
    basis = np.asarray(u[:, size > 1e-9 * size[0]])
    y = whiten(hold.signal, memory)
    return basis, y - basis @ (basis.T @ y)
