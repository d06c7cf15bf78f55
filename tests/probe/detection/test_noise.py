"""Innovations of the noise's members."""

import numpy as np
import pytest
from scipy.signal import lfilter

from probe.detection.pulse.noise import Noise, family


@pytest.mark.parametrize("shape", [(1,), (3,), (200,), (200, 4), (50, 2, 3)])
def test_innovations_are_those_of_the_recursion(shape):
    samples = np.random.default_rng(0).standard_normal(shape)
    before = samples.copy()
    for member in family(0.02):
        expected = np.asarray(lfilter(member.ahead, member.back, samples, axis=0))
        expected[0] *= member.first
        np.testing.assert_allclose(member.whiten(samples), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(samples, before)


def test_no_columns_have_no_innovations():
    empty = np.empty((10, 0))
    for member in (*family(0.002), Noise("both", (1.0, -0.5), (1.0, -0.9), 0.3)):
        assert member.whiten(empty).shape == (10, 0)


def test_means_of_a_random_walk_are_smoother_than_a_random_walk():
    apart, samples, knee = 64, 20_000, 0.25
    rng = np.random.default_rng(1)
    walk = np.cumsum(rng.standard_normal(apart * samples))
    white = np.sqrt(apart) / (2 * np.pi * knee) * rng.standard_normal(samples)
    means = walk.reshape(samples, apart).mean(axis=1)
    for hold, averaged in ((means, 1.0), (walk[::apart], 0.0)):
        left = {share: walks(knee, share).whiten(hold + white)[10:] for share in (0.0, 1.0)}
        assert left[averaged].var() < left[1.0 - averaged].var()
        beside = np.corrcoef(left[averaged][1:], left[averaged][:-1])[0, 1]
        assert abs(beside) < 4 / np.sqrt(samples)


def walks(knee: float, share: float) -> Noise:
    """The walk and white noise of the highest knee, over the sampling rate, that there is."""
    highest_hz = 8.0
    step_s = knee / highest_hz
    return [m for m in family(step_s, share * step_s) if m.name == "random walk 8 Hz"][-1]


@pytest.mark.parametrize("step_s", [0.02, 0.1])
def test_flicker_falls_as_one_over_the_frequency_up_to_its_knee(step_s: float):
    """Within a decibel of 1 + knee / f, from what a hold of 5 s shows to half of what it can."""
    hz = np.geomspace(0.2, 0.25 / step_s, 40)
    turn = np.exp(-2j * np.pi * hz * step_s)
    members = [m for m in family(step_s) if m.name.startswith("flicker")]
    assert len(members) == (3 if step_s == 0.02 else 2)
    for member in members:
        ahead, back = (np.polyval(p[::-1], turn) for p in (member.ahead, member.back))
        knee_hz = float(member.name.split()[1])
        power = np.abs(back / ahead) ** 2 / (1 + knee_hz / hz)
        assert 10 * np.log10(power.max() / power.min()) < 2.5, member.name
