"""Noise that follows itself in time: intervals hold as often as they say."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from calibration import Fit, fit_compliance, fit_latency, fit_tare
from calibration.fit import BATCHES, correlated, linear_fit

DRAWS = 400
TRAVEL_M = np.linspace(-1e-3, 2e-3, 200)
TIME_S = np.arange(500) / 500
Rng = np.random.Generator


def follows(rng: Rng, count: int, lag: float) -> np.ndarray:
    """An AR(1) process of variance 1."""
    steps = rng.standard_normal(count) * np.sqrt(np.r_[1, np.full(count - 1, 1 - lag**2)])
    return np.asarray(lfilter([1], [1, -lag], steps))


def stiffness(rng: Rng, lag: float) -> tuple[Fit, list[float]]:
    force = 0.03 + 2000 * np.maximum(TRAVEL_M, 0) + 5e-3 * follows(rng, 200, lag)
    return fit_compliance(TRAVEL_M, force).fit, [2000, 0]


def tare(rng: Rng, lag: float) -> tuple[Fit, list[float]]:
    value = 0.3 + 2e-3 * (TIME_S - TIME_S.mean()) + 1e-3 * follows(rng, 500, lag)
    return fit_tare(TIME_S, value).fit, [0.3, 2e-3]


@pytest.mark.parametrize("draw, lag, least, most", [
    (stiffness, 0.0, 0.93, 0.975),
    (stiffness, 0.9, 0.92, 0.98),
    (stiffness, 0.99, 0.85, 0.98),
    (tare, 0.0, 0.93, 0.975),
    (tare, 0.9, 0.92, 0.98),
    (tare, 0.99, 0.85, 0.98),
])  # fmt: skip
def test_intervals_hold_as_often_as_they_say(
    draw: Callable[[Rng, float], tuple[Fit, list[float]]], lag: float, least: float, most: float
) -> None:
    rng, inside = np.random.default_rng(1), []
    for _ in range(DRAWS):
        fit, truth = draw(rng, lag)
        low, high = fit.interval()[:2].T
        inside.append((low <= truth) & (truth <= high))
    share = np.mean(inside, axis=0)
    assert share.min() >= least
    assert share.mean() <= most


def test_a_wander_under_white_noise_counts() -> None:
    """Its readings follow one another by 0.47 only, and their means for a second."""
    rng, design = (
        np.random.default_rng(2),
        np.column_stack([np.ones(1000), np.linspace(-1, 1, 1000)]),
    )
    inside = []
    for _ in range(DRAWS):
        noise = follows(rng, 1000, 0.95) + rng.standard_normal(1000)
        low, high = correlated(linear_fit(design, noise, "ab", ""), design).interval().T
        inside.append((low <= 0) & (high >= 0))
    assert np.mean(inside, axis=0).min() > 0.9


def test_what_moves_fast_is_not_averaged_away() -> None:
    """A chirp of 1 to 20 Hz at 500 Hz: batches of a sixth of a second have nothing of it."""
    t = np.arange(0, 10, 0.002)
    chirp = np.sin(2 * np.pi * (t + 0.95 * t**2))
    late = np.sin(2 * np.pi * ((t - 0.01) + 0.95 * (t - 0.01) ** 2))
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(t))
    found = fit_latency(t, chirp, t, late + noise)
    assert len(t) > 10 * BATCHES
    assert found.fit.sigma[0] < 2e-5


def test_readings_without_noise_keep_their_interval() -> None:
    design = np.column_stack([np.ones(200), np.arange(200.0)])
    fit = linear_fit(design, np.zeros(200), ("bias", "drift"), "")
    assert correlated(fit, design) is fit
