"""What a sensor can see."""

import re

import numpy as np
import pytest
from known_presses import recording, row, station

from probe.detection import detect
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.least_pulse import least_pulse_pa
from probe.detection.pulse.search import search
from probe.detection.pulse.shared_noise import noise_priors
from probe.detection.sensitivity import MEAT, in_words, smallest_n, visibility

FACE_M2 = 1e-4


def pulse_shows(pulse_pa: float, noise_pa: float, hold_s: float, relaxing: float, seed: int,
                presses: int) -> bool:  # fmt: skip
    """Whether something pulses in a scan over a pulse of some rate, phase and place."""
    rng = np.random.default_rng(seed)
    rate_hz = float(rng.choice([0.9, 1.1, 1.2, 1.4]))
    held = {"pulse_pa": pulse_pa, "noise_pa": noise_pa, "hold_s": hold_s, "sample_hz": 100.0,
            "rate_hz": rate_hz, "relaxing": relaxing}  # fmt: skip
    centre_mm = rng.uniform(26, 38)
    scan = [station(rng, **held)] if presses == 1 else row(rng, centre_mm=centre_mm, **held)
    return any(not np.isfinite(s.pulse_below_pa) for s in detect(recording(scan)).stations)


@pytest.mark.parametrize("relaxing", [0.0, 1.0])
@pytest.mark.parametrize(("hold_s", "presses"), [(0.825, 15), (1.7, 1), (1.7, 15), (5.0, 1)])
def test_what_a_plan_says_to_show_nine_of_ten_scans_show(
    hold_s: float, presses: int, relaxing: float
) -> None:
    """A bound that detection does not reach said "yes" where 0 of 24 scans found something."""
    noise_pa, count = 200.0, 10 if presses > 1 else 20
    relaxation = MEAT if relaxing else ()
    least_pa = smallest_n(noise_pa * FACE_M2, 100.0, hold_s, presses, relaxation) / FACE_M2
    shown = [
        sum(pulse_shows(share * least_pa, noise_pa, hold_s, relaxing, s, presses) for s in range(n))
        for share, n in ((1.0, count), (0.2, count // 2))
    ]
    assert shown[0] >= 0.7 * count  # where nine of ten show it, 99 of 100 tries reach this
    assert shown[1] <= 0.2 * count


def test_it_is_what_detection_says_after_the_scan() -> None:
    press = station(np.random.default_rng(4), noise_pa=200.0, hold_s=2.5, sample_hz=100.0,
                    relaxing=0.0)  # fmt: skip
    said_pa = detect(recording([press])).needed_pa
    assert smallest_n(0.02, 100.0, 2.5, relaxation=()) / FACE_M2 == pytest.approx(said_pa, rel=0.25)


def test_more_samples_need_a_smaller_pulse_and_relaxing_tissue_a_larger_one() -> None:
    still = smallest_n(0.02, 100.0, 1.7, relaxation=())
    assert smallest_n(0.02, 400.0, 1.7, relaxation=()) == pytest.approx(still / 2, rel=0.1)
    assert 1.1 * still < smallest_n(0.02, 100.0, 1.7) < 2 * still
    held_5_s = smallest_n(0.02, 100.0, 5.0)
    assert smallest_n(0.02, 100.0, 20.0) == pytest.approx(held_5_s / 2)


def test_the_presses_of_a_scan_share_their_noise() -> None:
    """A short hold alone cannot tell a pulse from slow noise; the other presses can."""
    rng = np.random.default_rng(0)
    t = np.arange(0, 1.7, 0.02)
    holds = [Hold(t, rng.standard_normal(len(t)), np.ones(len(t)), 0.0, 0.0) for _ in range(15)]
    alone, shared = ([least_pulse_pa(search(hold, prior)[0], 1e-3)
                      for hold, prior in zip(holds, priors, strict=True)]
                     for priors in ([None] * 15, noise_priors(holds)))  # fmt: skip
    assert np.median(shared) < 0.8 * np.median(alone)


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


def test_a_noise_that_no_other_hold_can_have_is_searched_too() -> None:
    """A hold's calm half may have finer samples than the other holds, which have gaps."""
    rng = np.random.default_rng(2)
    coarse, fine = (
        [Hold(t, rng.standard_normal(len(t)), np.ones(len(t)), 0.0, 0.0) for _ in range(3)]
        for t in (np.arange(0, 4, 0.05), np.arange(0, 4, 0.02))
    )
    found, _ = search(fine[0], noise_priors(coarse)[0])
    assert 0 < found.p_value <= 1
