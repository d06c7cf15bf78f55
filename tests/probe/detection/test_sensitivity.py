"""What a sensor can see."""

import re

import numpy as np
import pytest
from known_presses import recording, station

from probe.detection import detect
from probe.detection.sensitivity import in_words, smallest_n, visibility


def pulse_shows(pulse_pa: float, noise_pa: float, hold_s: float, seed: int) -> bool:
    """Whether something is found in one press with a pulse of some rate and phase."""
    rng = np.random.default_rng(seed)
    beat_hz = float(rng.choice([0.9, 1.1, 1.2, 1.4]))
    press = station(rng, pulse_pa=pulse_pa, noise_pa=noise_pa, hold_s=hold_s, sample_hz=100.0,
                    rate_hz=beat_hz, relaxing=0.0)  # fmt: skip
    return bool(detect(recording([press])).objects)


@pytest.mark.parametrize("hold_s", [1.7, 2.5])
def test_what_a_plan_says_to_show_nine_of_ten_presses_show(hold_s: float) -> None:
    """A bound that detection does not reach said "yes" where 4 of 24 scans found something."""
    noise_pa, face_m2 = 200.0, 1e-4
    least_pa = smallest_n(noise_pa * face_m2, 100.0, hold_s) / face_m2
    assert sum(pulse_shows(least_pa, noise_pa, hold_s, seed) for seed in range(20)) >= 16
    assert sum(pulse_shows(0.4 * least_pa, noise_pa, hold_s, seed) for seed in range(10)) <= 5


def test_it_is_what_detection_says_after_the_scan() -> None:
    press = station(np.random.default_rng(4), noise_pa=200.0, hold_s=2.5, sample_hz=100.0,
                    relaxing=0.0)  # fmt: skip
    said_pa = detect(recording([press])).needed_pa
    assert smallest_n(0.02, 100.0, 2.5) / 1e-4 == pytest.approx(said_pa, rel=0.25)


def test_more_presses_need_a_larger_pulse_and_more_samples_a_smaller_one() -> None:
    one = smallest_n(0.02, 100.0, 2.5)
    assert one < smallest_n(0.02, 100.0, 2.5, 15) < 1.5 * one
    assert smallest_n(0.02, 400.0, 2.5) == pytest.approx(one / 2, rel=0.1)
    assert smallest_n(0.02, 100.0, 40.0) == pytest.approx(smallest_n(0.02, 100.0, 10.0) / 2)


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
