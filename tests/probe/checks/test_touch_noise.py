"""What a sensor's noise lets a touch be."""

import re

import numpy as np
import pytest

from probe.checks.touch_noise import least_touch_n, touch_in_noise, touch_readings


def test_a_touch_beyond_the_noise_passes_whatever_ten_readings_say_of_it() -> None:
    rng = np.random.default_rng(3)
    refused = [
        touch_in_noise("ft300", float(rng.normal(0.0, 0.1, 10).std(ddof=1)), 100.0, touch_n, 10)
        for touch_n in (0.27, 0.09)
        for _ in range(400)
    ]
    assert sum(why is not None for why in refused[:400]) < 0.05 * 400
    assert sum(why is not None for why in refused[400:]) > 0.95 * 400
    assert touch_in_noise("ft300", 0.1, 100.0, 0.26) is not None, (
        "an rms of many readings is believed"
    )


@pytest.mark.parametrize("noise_n", [0.1003, 0.1, 0.0042, 2.31])
@pytest.mark.parametrize("rate_hz", [10.0, 100.0, 500.0])
def test_the_touch_that_is_advised_passes(noise_n: float, rate_hz: float) -> None:
    """0.6 N was refused with "set scan.touch_n to 0.6 or more"."""
    refused = touch_in_noise("ft300", noise_n, rate_hz, 0.5 * noise_n)
    assert refused is not None
    advised = re.search(r"set scan.touch_n to (\S+) or more", refused)
    assert advised is not None
    assert touch_in_noise("ft300", noise_n, rate_hz, float(advised[1])) is None


@pytest.mark.parametrize(("touch_n", "readings"), [(0.27, 10), (0.3, 7), (0.45, 3), (0.65, 1)])
def test_no_more_readings_are_averaged_than_the_touch_needs(touch_n: float, readings: int) -> None:
    assert touch_readings(0.1, 100.0, touch_n) == readings
    assert touch_readings(0.0, 100.0, touch_n) == 1


def test_a_mean_in_the_air_is_a_touch_as_seldom_as_is_said() -> None:
    """Beyond three of its six standard errors: 1.3 in a thousand, of the zero's noise too."""
    rng = np.random.default_rng(8)
    readings, zero = rng.normal(0.0, 0.1, (20_000, 7)), rng.normal(0.0, 0.1, (20_000, 10))
    off_n = readings.mean(axis=1) - zero.mean(axis=1)
    share = float((off_n > 0.5 * least_touch_n(0.1, 100.0, 7)).mean())
    assert share == pytest.approx(1.35e-3, abs=0.8e-3)
