"""The running median against scipy's filter."""

import numpy as np
import pytest
from scipy.ndimage import median_filter

from probe.detection.pulse.running_median import running_median


@pytest.mark.parametrize("size", [3, 5])
@pytest.mark.parametrize("shape", [(0, 2), (1,), (2,), (40,), (40, 3)])
def test_running_median(size: int, shape: tuple[int, ...]) -> None:
    signal = np.random.default_rng(2).standard_normal(shape)
    around = (size, *(1 for _ in shape[1:]))
    np.testing.assert_array_equal(
        running_median(signal, size), median_filter(signal, size=around, mode="nearest")
    )


def test_a_number_that_is_missing_costs_its_neighbours_nothing() -> None:
    signal = np.array([1.0, 1.0, np.nan, 1.0, 1.0])
    assert (running_median(signal, 3) == 1.0).all()
