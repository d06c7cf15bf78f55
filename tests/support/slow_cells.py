"""A force cell behind a low pass of its own, and the stage that taps on it."""

import math

import numpy as np

from drivers.core.arrays import Array


def taps(
    filter_s: float, delay_s: float, rate_hz: float, noise_n: float, seed: int
) -> tuple[Array, Array, Array, Array]:
    """Presses of 2 mm on a stiffening spring, in the air between; forces by a fine integration."""
    fine_s, rng = 1e-4, np.random.default_rng(seed)
    t = np.arange(0.0, 12.0, fine_s)
    depth_mm = np.interp(
        t % 2.0, [0.0, 0.4, 0.7, 1.1, 1.4, 2.0], [-0.5, -0.5, 2.0, 2.0, -0.5, -0.5]
    )
    true_n = 0.8 * np.maximum(depth_mm, 0.0) ** 1.5
    read_n = true_n
    if filter_s:
        read_n, now = np.empty_like(true_n), 0.0
        for n, force in enumerate(true_n):
            now += (force - now) * (1 - math.exp(-fine_s / filter_s))
            read_n[n] = now
    stage_s = np.arange(0.0, 12.0, 8e-3)
    sensor_s = np.arange(0.0, 12.0 - 0.1, 1 / rate_hz)
    late = np.interp(sensor_s - delay_s, t, read_n)
    return (
        stage_s,
        np.interp(stage_s, t, depth_mm),
        sensor_s,
        late + noise_n * rng.standard_normal(len(sensor_s)),
    )
