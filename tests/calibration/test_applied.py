"""What a calibration says of the use that is made of it."""

import numpy as np
import pytest

from calibration import fit_force, fit_tare, fit_taxels, record, worse_than


def test_a_tare_is_good_until_its_drift_exceeds_what_is_tolerated() -> None:
    """10 mN a minute: 20 mN after two minutes, a little earlier by the drift's own doubt."""
    time_s = np.arange(0, 60, 0.1)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(time_s))
    tare = fit_tare(time_s, (0.3 + 10e-3 / 60 * time_s + noise)[:, None])
    assert 110 < tare.good_for_s(20e-3) <= 121
    assert tare.good_for_s(10e-3) == pytest.approx(tare.good_for_s(20e-3) / 2)


@pytest.mark.parametrize("channels", [1, 6])
def test_a_sensor_that_got_three_times_as_noisy_is_reported(channels: int) -> None:
    """Also by one of several channels: residuals of all were held against one channel's freedom."""
    rng = np.random.default_rng(1)
    loads = rng.uniform(-10, 10, (40, channels))
    ideal = 100 * loads
    found = fit_force(ideal + rng.standard_normal(ideal.shape), loads)
    kept = record(found, "cell", {})
    for noise, reported in ((1.0, False), (3.0, True)):
        new = ideal + noise * rng.standard_normal(ideal.shape)
        assert (worse_than(kept, found.misses(new, loads)) is not None) == reported


def test_an_array_that_lost_its_gain_is_reported() -> None:
    rng = np.random.default_rng(1)
    pressure_pa = np.tile(np.linspace(0, 3e4, 10), 2)
    ideal = 100 + np.outer(pressure_pa, np.full(64, 0.01))
    found = fit_taxels(ideal + rng.standard_normal(ideal.shape), pressure_pa)
    kept = record(found, "array", {})
    for gain, reported in ((1.0, False), (0.97, True)):
        new = 100 + gain * (ideal - 100) + rng.standard_normal(ideal.shape)
        assert (worse_than(kept, found.misses(new, pressure_pa)) is not None) == reported
