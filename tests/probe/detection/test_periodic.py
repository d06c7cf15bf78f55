"""Pulses too faint for any harmonics of their own, against a machine's line as faint."""

import numpy as np
import pytest

from drivers.core.arrays import Array
from probe.detection.pulse.beat_train import Coarse
from probe.detection.pulse.periodic import log_evidence, mean_wave, periodic
from probe.detection.pulse.possible_rates import FASTEST_HZ, SLOWEST_HZ, weights
from probe.detection.pulse.wave import brachial

STEP_S, COUNT, SEEDS = 0.1, 48, 8


def hold(wave: Array, seed: int) -> Coarse:
    t = np.arange(COUNT) * STEP_S
    noise = np.random.default_rng(seed).standard_normal(COUNT)
    return Coarse(wave + noise, STEP_S, np.column_stack([np.ones_like(t), t - t.mean()]))


def turns(rate_hz: float, seed: int) -> Array:
    return np.asarray(rate_hz * np.arange(COUNT) * STEP_S + seed / SEEDS)


def by_wave(one: Coarse) -> float:
    return mean_wave(one, SLOWEST_HZ, FASTEST_HZ)


def by_harmonics(one: Coarse, count: int) -> float:
    return periodic(one, SLOWEST_HZ, FASTEST_HZ, count)


@pytest.mark.parametrize("rate_hz", [0.9, 1.2, 1.7])
def test_a_faint_pulse_is_likelier_as_the_mean_wave(rate_hz: float) -> None:
    """Of a swing of five times the noise: than as one line, and than as any two harmonics."""
    holds = [hold(5.0 * brachial(turns(rate_hz, seed) % 1.0), seed) for seed in range(SEEDS)]
    for count in (1, 2):
        gain = [by_wave(one) - by_harmonics(one, count) for one in holds]
        assert np.median(gain) > 2.0


@pytest.mark.parametrize("rate_hz", [0.9, 1.2, 1.7])
def test_a_faint_line_is_likelier_as_a_line(rate_hz: float) -> None:
    holds = [hold(2.5 * np.cos(2 * np.pi * turns(rate_hz, seed)), seed) for seed in range(SEEDS)]
    gain = [by_wave(one) - by_harmonics(one, 1) for one in holds]
    assert np.median(gain) < -2.0


@pytest.mark.parametrize("rate_hz", [0.75, 1.2, 2.0])
def test_a_wave_is_as_likely_as_hearts_have_its_rate(
    monkeypatch: pytest.MonkeyPatch, rate_hz: float
) -> None:
    one = hold(20.0 * brachial(turns(rate_hz, 2) % 1.0), 2)
    usual = np.log(weights(np.array([rate_hz])))[0]
    harmonics = [periodic(one, SLOWEST_HZ, FASTEST_HZ, 2, way) for way in (weights, np.ones_like)]
    assert harmonics[0] - harmonics[1] == pytest.approx(usual, abs=0.05)
    as_hearts = by_wave(one)
    monkeypatch.setattr("probe.detection.pulse.periodic.weights", np.ones_like)
    assert as_hearts - by_wave(one) == pytest.approx(usual, abs=0.05)


def test_what_lies_beside_the_wave_costs_nothing() -> None:
    pulse = 5.0 * brachial(turns(1.2, 3) % 1.0)
    drift = 40.0 * np.linspace(-1, 1, COUNT)
    assert by_wave(hold(pulse + drift, 3)) == pytest.approx(by_wave(hold(pulse, 3)), abs=1e-6)


def test_a_wave_upside_down_is_none() -> None:
    up, down = (hold(size * brachial(turns(1.2, 1) % 1.0), 1) for size in (8.0, -8.0))
    assert by_wave(up) > by_wave(down) + 10.0


def test_a_slow_wave_that_drift_could_take_is_fitted_beside_it() -> None:
    """Against least squares of both, at the pulse's own rate and phase."""
    slow = turns(0.7, 0)
    wave = brachial(slow % 1.0)
    ramps = np.array([np.interp(slow, np.arange(5), one) for one in np.eye(5)]).T
    one = Coarse(hold(8.0 * wave, 0).signal, STEP_S, ramps)
    columns = np.column_stack([ramps, wave])
    left = one.signal - columns @ np.linalg.lstsq(columns, one.signal, rcond=None)[0]
    rates = 1 + (FASTEST_HZ - SLOWEST_HZ) * COUNT * STEP_S
    plain = float(log_evidence(np.asarray(left @ left), COUNT, 2)) - np.log(rates)
    assert by_wave(one) > plain - 0.5


@pytest.mark.parametrize("rate_hz", [0.75, 1.76, 2.1, 2.43])
def test_a_loud_line_is_met_wherever_it_lies_between_the_rates_tried(rate_hz: float) -> None:
    """Over a wide range and over a narrow one, but for what choosing among more rates costs."""
    step_s, count = 0.04, 125
    t = np.arange(count) * step_s
    noise = np.random.default_rng(4).standard_normal(count)
    line = 100.0 * np.cos(2 * np.pi * rate_hz * t + 0.5)
    one = Coarse(
        line + noise, step_s, np.column_stack([np.ones_like(t), np.exp(-t), np.exp(-3 * t)])
    )
    wide, narrow = periodic(one, 0.3, 5.0, 1), periodic(one, rate_hz - 0.1, rate_hz + 0.1, 1)
    choice = np.log((1 + 4.7 * count * step_s) / (1 + 0.2 * count * step_s))
    assert wide == pytest.approx(narrow - choice, abs=0.5)


def test_samples_that_show_one_harmonic_only_tell_no_wave_from_a_line() -> None:
    one = hold(20.0 * np.cos(2 * np.pi * turns(2.6, 1)), 1)  # at 10 Hz the second folds
    assert mean_wave(one, 2.4, FASTEST_HZ) == -np.inf
    assert np.isfinite(mean_wave(one, SLOWEST_HZ, 2.0))
