"""What a sensor can see."""

import re

import numpy as np
import pytest

from probe.detection.sensitivity import bound_n, in_words, visibility


@pytest.mark.parametrize(
    ("noise_n", "rate_hz", "known_phase_n"),
    [(0.1, 100, 0.156), (0.2, 500, 0.139), (3.1e-3, 1000, 1.5e-3)],
)
def test_a_short_hold_needs_more_than_a_known_phase_would(
    noise_n: float, rate_hz: float, known_phase_n: float
) -> None:
    """Of known phase, with nothing else to fit, those sensors show so much in 0.825 s."""
    smallest = 5 * bound_n(noise_n, rate_hz, 0.825, 1.2)
    assert known_phase_n < smallest < 3 * known_phase_n


def test_the_bound_is_reached_by_least_squares() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(500) / 500
    columns = np.column_stack([np.ones(500), t, np.cos(2 * np.pi * 1.2 * t),
                               np.sin(2 * np.pi * 1.2 * t)])  # fmt: skip
    noise = 0.01 * rng.standard_normal((500, 4000))
    found = np.linalg.lstsq(columns, noise, rcond=None)[0][2:]
    rms = 2 * np.sqrt(np.mean(found**2))
    assert bound_n(0.01, 500, 1.0, 1.2) == pytest.approx(rms, rel=0.03)


def test_it_falls_with_the_root_of_time_and_samples() -> None:
    assert bound_n(1, 100, 40, 1.2) == pytest.approx(bound_n(1, 100, 10, 1.2) / 2, rel=0.05)
    assert bound_n(1, 400, 10, 1.2) == pytest.approx(bound_n(1, 100, 10, 1.2) / 2, rel=0.02)


def test_a_tisa_pulse_under_an_ft300_is_not_visible() -> None:
    """22.6 Pa under an 8 mm probe is 1.1 mN."""
    seen = visibility(0.1, 100, 0.825, 1.1e-3, 1.2)
    assert not seen.visible
    assert in_words(seen).startswith("no: expected 1.1 mN")
    assert "quieter sensor" in in_words(seen)
    assert not re.search(r"\de[+-]?\d", in_words(seen, 1e-6))  # 4.63e+03 Pa is for programs
    far = visibility(3e-3, 1000, 0.825, 1.1e-3, 1.2)
    assert not far.visible
    assert far.hold_s < 20
    assert "repeats would show it" in in_words(far)


def test_a_radial_pulse_is() -> None:
    assert visibility(3e-3, 1000, 0.825, 0.5, 1.2).visible
