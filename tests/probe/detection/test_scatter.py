"""Noise by the differences of neighbours: neither a drift, a pulse nor outliers count."""

import numpy as np
import pytest

from probe.detection.pulse.scatter import scatter


@pytest.mark.parametrize("sd", [1e-3, 5.0])
def test_it_is_the_noise_s_own_deviation_beside_a_pulse_and_outliers(sd: float) -> None:
    rng, t = np.random.default_rng(3), np.arange(20_000) / 500
    signal = sd * (rng.normal(size=t.size) + 40 * t + 30 * np.sin(2 * np.pi * t))
    signal[::20] += 1e6 * sd
    signal[7::1000] = np.nan
    assert float(scatter(signal)) == pytest.approx(sd, rel=0.2)
    alone = sd * rng.normal(size=(20_000, 2)) * [1.0, 3.0]
    np.testing.assert_allclose(scatter(alone), [sd, 3 * sd], rtol=0.03)
