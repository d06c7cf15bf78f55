"""Innovations of the noise's members."""

import numpy as np
import pytest
from scipy.signal import lfilter

from probe.detection.pulse.noise import Noise, family


@pytest.mark.parametrize("shape", [(1,), (3,), (200,), (200, 4), (50, 2, 3)])
def test_innovations_are_those_of_the_recursion(shape):
    samples = np.random.default_rng(0).standard_normal(shape)
    before = samples.copy()
    for member in family(0.002):
        expected = np.asarray(lfilter(member.ahead, member.back, samples, axis=0))
        expected[0] *= member.first
        np.testing.assert_allclose(member.whiten(samples), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(samples, before)


def test_no_columns_have_no_innovations():
    empty = np.empty((10, 0))
    for member in (*family(0.002), Noise("both", (1.0, -0.5), (1.0, -0.9), 0.3)):
        assert member.whiten(empty).shape == (10, 0)
