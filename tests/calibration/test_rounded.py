"""Readings that are rounded more coarsely than their noise: intervals hold nevertheless."""

from collections.abc import Callable

import numpy as np
import pytest

from calibration import fit_force, fit_latency, fit_tare, fit_taxels
from calibration.rounding import rounding_error, step_of, written_step

Rng = np.random.Generator
STEP_N, DELAY_S = 0.05, 0.008


def rounded(values: np.ndarray, step: float) -> np.ndarray:
    return np.round(values / step) * step if step else values


def tare(
    rng: Rng, noise_n: float, count: int, drift_n_s: float = 1e-4, rate_hz: float = 10
) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Interval and estimates of bias and drift, and the true ones."""
    time_s = np.arange(count) / rate_hz
    bias_n = rng.uniform(-1, 1)
    level = bias_n + drift_n_s * (time_s - time_s.mean()) + noise_n * rng.standard_normal(count)
    found = fit_tare(time_s, rounded(level, STEP_N))
    return found.fit.interval(), found.fit.values, [bias_n, drift_n_s]


@pytest.mark.parametrize(("noise_steps", "count"), [(0.1, 600), (0.2, 600), (0.3, 600), (0.3, 40)])
def test_a_tare_of_coarse_steps_holds(noise_steps: float, count: int) -> None:
    """By least squares the bias held in 4 of 45, 10, 31 and 57 of 60."""
    rng, inside = np.random.default_rng(4), []
    while len(inside) < 30:
        level = np.random.default_rng(rng.integers(1 << 30))
        try:
            interval, _, truth = tare(level, noise_steps * STEP_N, count)
        except ValueError:  # readings that never change
            continue
        inside.append((interval[:, 0] <= truth) & (truth <= interval[:, 1]))
    assert np.mean(inside, axis=0).min() >= 0.85


@pytest.mark.parametrize(
    ("noise_steps", "drift_steps_s", "widest_steps"),
    [(0.05, 0.02, 0.6), (0.05, 0.1, 0.15), (0.05, 1, 0.1), (0.05, 3, 0.2), (0.3, 1, 0.1),
     (0.01, 1, 0.1)],
)  # fmt: skip
def test_a_tare_that_drifts_over_steps_holds(
    noise_steps: float, drift_steps_s: float, widest_steps: float
) -> None:
    """As if it stood still over every ten readings, it held in 10 % at a step a second."""
    noise_n, drift_n_s = noise_steps * STEP_N, drift_steps_s * STEP_N
    draws = [tare(np.random.default_rng(n), noise_n, 600, drift_n_s) for n in range(9)]
    inside = [(ends[:, 0] <= truth) & (truth <= ends[:, 1]) for ends, _, truth in draws]
    assert np.sum(inside, axis=0).min() >= 8
    halves = [np.ptp(ends[0]) / 2 for ends, _, _ in draws]
    assert max(halves) < widest_steps * STEP_N


def test_a_long_tare_that_drifts_over_steps_holds() -> None:
    """Least squares say 0.0003 steps in batches of a step each, and are 0.001 off."""
    rng = np.random.default_rng(8)
    for _ in range(5):
        ends, values, truth = tare(rng, 0.05 * STEP_N, 30_000, 2.013 * STEP_N, 1000)
        assert np.all((ends[:, 0] <= truth) & (truth <= ends[:, 1]))
        assert np.ptp(ends[0]) < 0.03 * STEP_N
        assert values[0] == pytest.approx(truth[0], abs=3e-3 * STEP_N)


@pytest.mark.parametrize(
    "codes",
    [np.arange(600) // 10, np.arange(600) // 20, np.arange(600), np.arange(600) == 599],
    ids=["stairs of 10", "stairs of 20", "a step each", "one step at the end"],
)
def test_what_bounds_each_reading_bounds_the_tare(codes: np.ndarray) -> None:
    """Of a step: standard deviations were 6e25, 13,396, 0.04 and 2.3."""
    found = fit_tare(np.arange(600) / 10, codes.astype(float)).fit
    bias, drift = found.sigma
    assert 2e-3 < bias < 0.3
    assert drift < 0.02
    assert found.values == pytest.approx(np.polyfit(np.arange(600) / 10 - 29.95, codes, 1)[::-1],
                                         abs=0.1)  # fmt: skip


def test_a_tare_of_fine_steps_is_as_it_was() -> None:
    time_s = np.arange(600) / 10
    value = 0.02 * np.random.default_rng(5).standard_normal(600)
    fine = fit_tare(time_s, rounded(value, 1e-3)).fit
    assert fine.values == pytest.approx(fit_tare(time_s, value).fit.values, abs=1e-4)
    assert fine.sigma == pytest.approx(fit_tare(time_s, value).fit.sigma, rel=0.01)


def press(
    rng: Rng,
    stage_hz: float,
    noise_n: float,
    step_n: float,
    sensor_hz: float = 500,
    late_s: float = DELAY_S,
) -> tuple[float, float]:
    """Error and half width [s] of the delay, by four presses at 5 N/s to 1.25 N."""
    begin_s = rng.uniform(0, 0.3)

    def place(t: np.ndarray) -> np.ndarray:
        way = 1 - np.abs((t - begin_s) % 2 - 0.9) / 0.5
        return np.asarray(2.5e-3 * np.clip(way, 0, 0.5))

    stage_s, sensor_s = np.arange(0, 8, 1 / stage_hz), np.arange(0, 8, 1 / sensor_hz)
    sensor_s = sensor_s + rng.uniform(0, 1 / sensor_hz)
    force = 1000 * place(sensor_s) + noise_n * rng.standard_normal(len(sensor_s))
    return missed(late_s, stage_s, place(stage_s), sensor_s + late_s, rounded(force, step_n))


def tap(rng: Rng, stage_step_m: float) -> tuple[float, float]:
    """The same by eight taps, of a stage read in steps."""
    sensor_s, begin_s = np.arange(0, 12, 1 / 500), rng.uniform(0, 0.3)

    def place(t: np.ndarray) -> np.ndarray:
        return np.asarray(
            sum(2e-3 * np.exp(-(((t - at) / 0.08) ** 2)) for at in begin_s + np.arange(1, 11, 1.3))
        )

    stage_s = np.arange(0, 12, 1 / 125) + rng.uniform(0, 1 / 125)
    force = 2000 * np.maximum(place(sensor_s) - 0.8e-3, 0) + 5e-3 * rng.standard_normal(6000)
    stage = rounded(place(stage_s), stage_step_m)
    return missed(DELAY_S, stage_s, stage, sensor_s + DELAY_S, force)


def missed(late_s: float, *movement: np.ndarray) -> tuple[float, float]:
    found = fit_latency(*movement)
    low, high = found.fit.interval()[0]
    return abs(found.delay_s - late_s), (high - low) / 2


@pytest.mark.parametrize("draw, widest_s", [
    (lambda rng: press(rng, 125, 1e-3, 0.05), 1e-3),
    (lambda rng: press(rng, 125, 1e-3, 0.02), 1e-3),
    (lambda rng: press(rng, 20, 2e-3, 0), 1.2e-3),
    (lambda rng: tap(rng, 20e-6), 0.15e-3),
])  # fmt: skip
def test_a_delay_holds_where_errors_repeat_from_tap_to_tap(
    draw: Callable[[Rng], tuple[float, float]], widest_s: float
) -> None:
    """By residuals alone in 2, 2, 8 and 8 of 30."""
    draws = [draw(np.random.default_rng(seed)) for seed in range(5)]
    off, half = np.array(draws).T
    assert np.sum(off <= half) >= 4
    assert half.max() < widest_s


def test_a_delay_of_fine_readings_is_as_sharp_as_it_was() -> None:
    off, half = press(np.random.default_rng(3), 125, 2e-3, 0)
    assert off < half < 4e-5


def test_a_delay_of_half_a_slow_sample_is_found() -> None:
    """From a sample of 20 ms the fit ended 10 ms off, sure of it to 0.3 us."""
    off, half = press(np.random.default_rng(7), 125, 5e-3, 0, sensor_hz=50, late_s=0.03)
    assert off < 3e-4
    assert half > 5e-5


def test_the_step_of_readings() -> None:
    codes = np.random.default_rng(6).integers(-40, 40, 300)
    assert step_of(0.3 + 0.05 * codes) == pytest.approx(0.05)
    assert step_of(np.random.default_rng(6).standard_normal(300)) == 0
    assert step_of(np.ones(300)) == 0


@pytest.mark.parametrize("noise", [0.1, 0.2, 0.4])
def test_what_rounding_adds_on_average(noise: float) -> None:
    """Against the mean of rounded normal readings."""
    levels = np.linspace(-0.5, 0.5, 7)
    edges = np.linspace(-8, 8, 40001) * noise
    density = np.exp(-0.5 * (edges / noise) ** 2)
    mean = [np.average(np.round(level + edges), weights=density) for level in levels]
    assert rounding_error(levels, 1.0, noise) == pytest.approx(np.array(mean) - levels, abs=0.02)


@pytest.mark.parametrize("step", [0.05, 0.1, 0.3])
@pytest.mark.parametrize("loads_n", [[0, 1, 2, 3], [0, 1, 2, 3] * 5, [0, 1, 2, 3, 2, 1, 0]])
def test_a_force_that_is_read_in_coarse_steps_holds(loads_n: list[float], step: float) -> None:
    """By scatter alone in 67 to 88 %: what is rounded alike scatters by nothing."""
    load_n, inside = np.array(loads_n, float), []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        truth = np.array([rng.uniform(0, 1), rng.uniform(1, 2)])
        raw = truth[0] + truth[1] * load_n + 0.1 * step * rng.standard_normal(len(load_n))
        interval = fit_force(rounded(raw, step), load_n).fit.interval()
        inside.append((interval[:, 0] <= truth) & (truth <= interval[:, 1]))
    assert np.mean(inside, axis=0).min() > 0.9


@pytest.mark.parametrize("step", [1.0, 2.0])
def test_taxels_of_whole_counts_hold(step: float) -> None:
    """A step of 2 in 20 counts, pressed once each: in 41 to 61 % where repeated."""
    pressure_pa, inside = np.array([0.0, 5e3, 1e4, 2e4]), []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        gain = rng.uniform(0.8, 1.2, 4) * 1e-3
        raw = rounded(10 + np.outer(pressure_pa, gain), step)
        interval = fit_taxels(raw, pressure_pa).fit.interval()[1::2]
        inside.append((interval[:, 0] <= gain) & (gain <= interval[:, 1]))
    assert np.mean(inside) > 0.9


@pytest.mark.parametrize(
    ("readings", "step"),
    [([0.2, 1.5, 2.8, 4.1], 0.1), ([0.3, 1.2, 2.1, 3.3], 0.3), ([0.25, 1.75, 3.0], 0.25),
     ([12.0, 340.0, 567.0], 1.0), ([0.123456789012, 1.1, 2.2], 0.0), ([2.5, 2.5], 2.5)],
)  # fmt: skip
def test_the_step_of_few_readings_is_that_of_their_digits(
    readings: list[float], step: float
) -> None:
    assert written_step(np.array(readings)) == pytest.approx(step)
