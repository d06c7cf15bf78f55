"""A pulse in a hold in which something else moved: the other half shows it."""

from dataclasses import replace

import numpy as np
import pytest
from known_presses import recording, station

from probe.core.recording import Station
from probe.detection import detect
from probe.detection.pulse.calm_half import calm_half
from probe.detection.pulse.hold_samples import hold_of
from probe.detection.pulse.presses import presses_of


def shoved(seed: int, pulse_pa: float, sample_hz: float = 500.0, early: bool = True) -> Station:
    """A press of 5 s with one bump of a tenth of its force, in its first or its last part."""
    rng = np.random.default_rng(seed)
    one = station(rng, pulse_pa=pulse_pa, sample_hz=sample_hz, noise_pa=10.0)
    t = one.time_s - one.time_s[0]
    at_s = rng.uniform(0.3, 1.2) if early else rng.uniform(3.6, 4.4)
    bump = 900.0 * np.exp(-0.5 * ((t - at_s) / 0.3) ** 2)
    return replace(one, signal_pa=one.signal_pa + bump[:, None])


@pytest.mark.parametrize("sample_hz", [10.0, 500.0])
@pytest.mark.parametrize("early", [True, False])
def test_a_pulse_beside_a_movement_is_found_where_nothing_else_moves(
    sample_hz: float, early: bool
) -> None:
    """A pulse of 1 % of the force, beside a bump ten times as high."""
    said = [detect(recording([shoved(seed, 90.0, sample_hz, early)])) for seed in range(8)]
    found = [one for one in said if one.finding == "artery"]
    assert len(found) >= 6
    for one in found:
        assert one.heart_rate_bpm is not None
        assert one.heart_rate_bpm[0] == pytest.approx(72.0, abs=4.0)


def test_a_movement_alone_is_no_artery() -> None:
    said = [detect(recording([shoved(seed, 0.0, hz, early)])).finding
            for seed in range(3) for hz in (10.0, 500.0) for early in (True, False)]  # fmt: skip
    assert "artery" not in said


def test_one_swing_in_the_calm_half_is_no_pulse() -> None:
    """A breath's harmonic that swings less than twice in it, beside the breath."""
    for seed in range(4):
        one = shoved(seed, 0.0, 10.0)
        t = one.time_s - one.time_s[0]
        slow = 90.0 * np.cos(2 * np.pi * 0.7 * t) - 60.0 * np.cos(2 * np.pi * 1.4 * t + 1.0)
        moving = replace(one, signal_pa=one.signal_pa + slow[:, None])
        (press,) = presses_of(recording([moving]), 0.01)
        assert "half of its hold" not in press.note


def test_the_calm_half_is_the_one_without_the_movement() -> None:
    early, late = (hold_of(shoved(1, 90.0, early=early)) for early in (True, False))
    second, first = calm_half(early), calm_half(late)
    assert second is not None
    assert first is not None
    assert second.time_s[0] == pytest.approx(2.5, abs=0.05)
    assert first.time_s[-1] == pytest.approx(2.5, abs=0.05)


@pytest.mark.parametrize("pulse_pa", [0.0, 90.0, 900.0])
def test_an_undisturbed_hold_has_no_calm_half(pulse_pa: float) -> None:
    rng = np.random.default_rng(7)
    for sample_hz in (10.0, 500.0):
        one = station(rng, pulse_pa=pulse_pa, sample_hz=sample_hz, uneven_s=0.04)
        assert calm_half(hold_of(one)) is None


def test_halves_too_short_for_a_pulse_are_not_looked_at() -> None:
    rng = np.random.default_rng(8)
    one = station(rng, pulse_pa=90.0, hold_s=3.0)
    t = one.time_s - one.time_s[0]
    moved = replace(
        one, signal_pa=one.signal_pa + 900.0 * np.exp(-0.5 * ((t - 0.5) / 0.1) ** 2)[:, None]
    )
    assert calm_half(hold_of(moved)) is None


def test_the_level_is_the_whole_holds() -> None:
    """Tissue relaxes: the second half alone would stand lower than its neighbours' holds."""
    one = shoved(1, 90.0)
    (press,) = presses_of(recording([one]), 0.01)
    assert "first half" in press.note
    assert press.pulsing
    second = one.signal_pa[len(one.signal_pa) // 2 :].mean()
    assert second < 0.95 * one.signal_pa.mean()
    assert press.level_pa == pytest.approx(one.signal_pa.mean(), rel=0.005)
