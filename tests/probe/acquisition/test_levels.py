"""What a sensor's noise lets a touch be."""

import re

import numpy as np
import pytest

from probe.acquisition.levels import touch_in_noise


def test_a_touch_of_six_times_the_noise_passes_whatever_ten_readings_say_of_it() -> None:
    rng = np.random.default_rng(3)
    refused = [
        touch_in_noise("ft300", float(rng.normal(0.0, 0.1, 10).std(ddof=1)), touch_n, 10)
        for touch_n in (0.6, 0.2)
        for _ in range(400)
    ]
    assert sum(why is not None for why in refused[:400]) < 0.05 * 400
    assert sum(why is not None for why in refused[400:]) > 0.95 * 400
    assert touch_in_noise("ft300", 0.1, 0.59) is not None, "an rms of many readings is believed"


@pytest.mark.parametrize("noise_n", [0.1003, 0.1, 0.0042, 2.31])
def test_the_touch_that_is_advised_passes(noise_n: float) -> None:
    """0.6 N was refused with "set scan.touch_n to 0.6 or more"."""
    refused = touch_in_noise("ft300", noise_n, 0.5 * noise_n)
    assert refused is not None
    advised = re.search(r"set scan.touch_n to (\S+) or more", refused)
    assert advised is not None
    assert touch_in_noise("ft300", noise_n, float(advised[1])) is None
