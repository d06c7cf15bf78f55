"""Presses by a skin of taxels of unlike gain, in counts, moved in unlike ways, with no units."""

import numpy as np

from drivers.core.arrays import Array
from probe.core.recording import Recording, Station

TAXELS, SAMPLES = 8, 12
LUMP = np.exp(-0.5 * ((np.arange(TAXELS) - 4.3) / 0.8) ** 2)
SKIN = np.random.default_rng(5).uniform(0.5, 2.0, TAXELS)  # gains


def films(rng: np.random.Generator, count: int, lump: float = 0.0, place: float = 0.0) -> Array:
    """``count`` presses (count, samples, taxels) at one place, which differs from others by
    ``place``: depth and two tilts differ by hundreds of counts from press to press, noise is 10."""
    x = np.linspace(-1, 1, TAXELS)
    motions = 300.0 * rng.standard_normal((count, 3)) @ np.stack([np.ones(TAXELS), x, x**2])
    image = 2000.0 + motions + place * rng.standard_normal(TAXELS) + lump * LUMP
    rising = np.linspace(0.6, 1.0, SAMPLES)[:, None]
    noise = 10.0 * rng.standard_normal((count, SAMPLES, TAXELS))
    return np.asarray(SKIN * (rising * image[:, None, :] + noise))


def recording(presses: Array, place: Array, unit: str = "counts") -> Recording:
    """``presses`` (n, samples, taxels), each at the ``place`` (n,) in cm."""
    time_s, nothing = 0.1 * np.arange(SAMPLES), np.full(SAMPLES, np.nan)
    stations = tuple(
        Station(n, 1e-2 * x, 0.0, time_s, press, np.zeros(press.shape, bool), *nothing[:3], nothing)
        for n, (press, x) in enumerate(zip(presses, place, strict=True))
    )
    return Recording(stations, tuple(f"t{n}" for n in range(TAXELS)), (), 1e-4, unit=unit)
