"""A level that drifts through a sensor's steps beats like a pulse, and is none."""

from dataclasses import replace

import numpy as np
import pytest
from known_presses import recording, station

from probe.core.recording import Station
from probe.detection import detect
from probe.detection.pulse.hold_samples import hold_of, quantum_of
from probe.detection.pulse.rounding import unrounded


def stepped(seed: int, sample_hz: float, drift_pa_s: float, pulse_pa: float = 0.0) -> Station:
    """A press in steps of 30 Pa whose level drifts and does not relax."""
    rng = np.random.default_rng(seed)
    one = station(rng, sample_hz=sample_hz, noise_pa=3.0, pulse_pa=pulse_pa, relaxing=0.0)
    drift = drift_pa_s * (one.time_s - one.time_s[0])
    return replace(one, signal_pa=30.0 * np.round((one.signal_pa + drift[:, None]) / 30.0))


@pytest.mark.parametrize("sample_hz", [10.0, 500.0])
def test_a_drift_in_steps_is_no_artery(sample_hz: float) -> None:
    """A step each 0.6 to 1.2 s: up it rises fast and falls slowly, as an artery does."""
    said = [detect(recording([stepped(seed, sample_hz, drift)])).finding
            for seed in range(3) for drift in (25.0, 35.0, 50.0)]  # fmt: skip
    assert "artery" not in said


@pytest.mark.parametrize("sample_hz", [10.0, 500.0])
def test_a_pulse_of_some_steps_is_still_an_artery(sample_hz: float) -> None:
    for seed in range(3):
        found = detect(recording([stepped(seed, sample_hz, 30.0, 120.0)]))
        assert found.finding == "artery"
        assert found.stations[0].pulse_pa == pytest.approx(1.031 * 120.0, rel=0.15)


def pressed(seed: int, step_pa: float, noise_pa: float, pulse_pa: float) -> Station:
    """In steps, with the air and the way down before the hold; it does not relax."""
    one = station(np.random.default_rng(seed), index=seed, x_mm=4.0 * seed, noise_pa=noise_pa,
                  pulse_pa=pulse_pa, relaxing=0.0)  # fmt: skip
    time_s = np.concatenate([np.arange(7.0, 10.0, 2e-3), one.time_s])
    down_pa = 9000.0 * np.clip(time_s - 9.0, 0.0, 1.0)
    down_pa[time_s >= 10.0] = one.signal_pa[:, 0]
    return replace(
        one, time_s=time_s, signal_pa=step_pa * np.round(down_pa / step_pa)[:, None],
        saturated=np.zeros((len(time_s), 1), bool), depth_m=np.full(len(time_s), 2.5e-3),
    )  # fmt: skip


@pytest.mark.parametrize("noise_pa", [0.0, 0.3])
@pytest.mark.parametrize("step_pa", [30.0, 300.0])
@pytest.mark.parametrize("share", [0.0, 0.3])
def test_steps_that_no_noise_reaches_over_are_no_pulse_and_hide_one(
    step_pa: float, noise_pa: float, share: float
) -> None:
    """Each press reads the same throughout its hold, or nearly: nobody knows what beats within."""
    row = [pressed(seed, step_pa, noise_pa, share * step_pa) for seed in range(7)]
    found = detect(recording(row), asked_pa=step_pa)
    assert found.finding in ("cannot see", "undecided")
    assert np.median([one.pulse_sd_pa for one in found.stations]) > step_pa / 5


def test_a_pulse_of_many_steps_without_noise_is_seen() -> None:
    found = detect(recording([pressed(0, 30.0, 0.0, 200.0)]))
    assert found.reason.startswith("it pulses") and "artery" in found.reason
    assert found.stations[0].pulse_pa == pytest.approx(1.031 * 200.0, rel=0.15)


def test_a_drift_in_steps_is_smooth_again() -> None:
    hold = hold_of(stepped(1, 100.0, 35.0))
    line = np.polynomial.Polynomial.fit(hold.time_s, hold.signal_pa, 1)
    off, mended = (np.std(one.signal_pa - line(one.time_s)) for one in (hold, unrounded(hold)))
    assert off > 7.0
    assert mended < 0.5 * off


def test_steps_are_seen_where_noise_does_not_hide_them() -> None:
    rng = np.random.default_rng(2)
    level = 9000.0 + 100.0 * np.linspace(0, 1, 500)
    fine, coarse = 0.3 * rng.standard_normal(500), 20.0 * rng.standard_normal(500)
    assert quantum_of(np.round(level + fine)) == pytest.approx(1.0)
    assert quantum_of(np.round(level + coarse)) == 0.0
    assert quantum_of(level + fine) == 0.0
    assert quantum_of(np.full(500, 9000.0)) == 0.0
