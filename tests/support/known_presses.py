"""Presses with a known truth: relaxation as measured on meat, drift, a pulse, a sensor's noise."""

import numpy as np

from drivers.core.arrays import Array
from probe.core.recording import Recording, Station

# median fit of 117 real indentation curves: share and time constant of each decay
RELAXATION = ((0.179, 0.281), (0.167, 1.24), (0.277, 8.10))


def wave(phase: Array) -> Array:
    """An arterial wave from trough to crest 1, at phases in beats."""
    amplitudes, angles = (13.94, 7.88, 4.43, 2.55), (-1.727, -2.203, -2.906, -3.057)
    turns = 2 * np.pi * phase[..., None] * np.arange(1, 5)
    raw = (amplitudes * np.cos(turns + np.array(angles))).sum(axis=-1)
    return np.asarray(raw / 41.0)


def station(
    rng: np.random.Generator,
    *,
    index: int = 0,
    x_mm: float = float("nan"),
    y_mm: float = 0.0,
    level_pa: float = 9000.0,
    pulse_pa: float = 0.0,
    rate_hz: float = 1.2,
    hold_s: float = 5.0,
    noise_pa: float = 20.0,
    relaxing: float = 1.0,
    sample_hz: float = 500.0,
    uneven_s: float = 0.0,
) -> Station:
    """One press; the pulse starts at a random phase, its beats' lengths vary by ``uneven_s``."""
    n = int(hold_s * sample_hz)
    t = np.arange(n) / sample_hz
    decay = 1 - relaxing * sum(g * (1 - np.exp(-t / tau)) for g, tau in RELAXATION)
    begun = rng.uniform()
    beats = int(hold_s * rate_hz) + 12
    uneven = uneven_s * rng.standard_normal(beats) if uneven_s else np.zeros(beats)
    lengths = np.maximum(1 / rate_hz + uneven, 0.3)
    phase = np.interp(t, np.concatenate([[0.0], np.cumsum(lengths)]), np.arange(beats + 1.0))
    signal = level_pa * decay + pulse_pa * wave(phase + begun)
    signal = signal + noise_pa * rng.standard_normal(n)
    return Station(
        index, 1e-3 * x_mm, 1e-3 * y_mm, 10.0 + t, signal[:, None], np.zeros((n, 1), dtype=bool),
        9.0, 10.0, 10.0 + t[-1], np.full(n, 2.5e-3),
    )  # fmt: skip


def recording(stations: list[Station]) -> Recording:
    """A scan of them."""
    return Recording(tuple(stations), ("force",), (), 1e-4)


def row(
    rng: np.random.Generator,
    *,
    centre_mm: float = 33.0,
    bump: float = 0.0,
    pulse_pa: float = 0.0,
    y_mm: float = 0.0,
    first: int = 0,
    scatter: float = 0.003,
    tilt: float = 0.05,
    **press: float,
) -> list[Station]:
    """Fifteen presses, 4 mm apart, over something ``centre_mm`` along that is ``bump`` stiffer."""
    x = 4.0 * np.arange(1, 16)
    form = 1 / (1 + ((x - centre_mm) / 5.0) ** 2) ** 1.5
    level = (
        9000.0 * (1 + bump * form + tilt * (x - 32) / 56) * (1 + scatter * rng.standard_normal(15))
    )
    return [
        station(rng, index=first + i, x_mm=x[i], y_mm=y_mm, level_pa=level[i],
                pulse_pa=pulse_pa * form[i], **press)
        for i in range(15)
    ]  # fmt: skip
