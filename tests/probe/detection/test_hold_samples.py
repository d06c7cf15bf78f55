"""What a hold is made of does not depend on the zero of the clock nor on its digits."""

from dataclasses import replace

import numpy as np
import pytest
from known_presses import recording, row

from drivers.core.arrays import Array
from probe.core.recording import Station
from probe.detection.pulse.hold_samples import NoHold, hold_of
from probe.detection.pulse.presses import presses_of
from probe.detection.pulse.search import search
from probe.detection.scan import detect

SECONDS_SINCE_1970 = 1.7e9


def relaxing(time_s: Array, noise_pa: float = 5.0) -> Station:
    """Tissue that relaxes by a power law, fast at first, and does not beat."""
    noise = noise_pa * np.random.default_rng(3).standard_normal(len(time_s))
    signal = (1e4 * (time_s + 0.02) ** -0.1 + noise)[:, None]
    return Station(0, np.nan, np.nan, time_s, signal, np.zeros(signal.shape, dtype=bool),
                   np.nan, np.nan, np.nan, np.full(len(time_s), np.nan))  # fmt: skip


@pytest.mark.parametrize("rate_hz", [100.0, 150.0, 250.0, 500.0])
@pytest.mark.parametrize("zero_s", [-100.0, SECONDS_SINCE_1970])
def test_the_clocks_zero_changes_nothing(rate_hz: float, zero_s: float) -> None:
    """Bins of 1, 2 and 3 samples in place of 2 made pulses of a relaxation: p fell by up to
    exp(-106)."""
    time_s = np.arange(0.0, 5.0, 1 / rate_hz)
    station = relaxing(time_s)
    one, other = hold_of(station), hold_of(replace(station, time_s=time_s + zero_s))
    assert np.ptp(other.weight) == np.ptp(one.weight) == 0.0
    assert other.signal_pa == pytest.approx(one.signal_pa, abs=1e-9)
    assert other.time_s == pytest.approx(one.time_s, abs=1e-6)
    assert search(other)[0].p_value == pytest.approx(search(one)[0].p_value, rel=0.02)


def test_jitter_of_the_stamps_puts_as_many_samples_into_each_average() -> None:
    time_s = np.arange(0.0, 5.0, 0.01)
    jitter_s = 1e-4 * np.random.default_rng(1).standard_normal(len(time_s))
    assert np.ptp(hold_of(relaxing(time_s + jitter_s)).weight) == 0.0


def test_missing_samples_are_missing_where_they_were() -> None:
    time_s = np.arange(0.0, 5.0, 0.002)
    kept = np.ones(len(time_s), dtype=bool)
    kept[1000:1025] = kept[1500:1503] = False
    hold = hold_of(relaxing(time_s[kept]))
    every = hold_of(relaxing(time_s))
    at = np.searchsorted(every.time_s, hold.time_s + 5e-3) - 1
    assert hold.time_s == pytest.approx(every.time_s[at], abs=6e-3)
    assert len(every.time_s) - len(hold.time_s) == 2  # the other half averages are kept
    assert hold.weight.min() == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize("count", [0, 1, 100])
def test_a_press_without_a_channel_says_so(count: int) -> None:
    """It ended detection in an error."""
    one = relaxing(0.01 * np.arange(count))
    none = np.empty((count, 0))
    with pytest.raises(NoHold, match="station 1: no channel of a sensor was recorded"):
        hold_of(replace(one, signal_pa=none, saturated=none.astype(bool)))


@pytest.mark.parametrize("jump_s", [100.0, 1e5])
def test_of_a_hold_in_which_the_clock_jumps_the_longer_part_is_judged(jump_s: float) -> None:
    """A gap of minutes made the samples' step a second, and of days took all of the memory."""
    time_s = np.arange(0.0, 4.0, 0.01)
    whole = hold_of(relaxing(time_s[time_s < 2.5]))
    jumped = hold_of(replace(relaxing(time_s), time_s=time_s + jump_s * (time_s >= 2.5)))
    assert jumped.signal_pa == pytest.approx(whole.signal_pa, abs=1e-9)
    assert jumped.lost == pytest.approx(1.5 / 4.0)
    half_way = replace(relaxing(time_s), time_s=time_s + jump_s * (time_s >= 2.0))
    (press,) = presses_of(recording([half_way]), 0.02)
    assert np.isfinite(press.size_pa)


def test_samples_that_come_in_pairs_of_one_time_are_half_as_many() -> None:
    time_s = np.arange(0.0, 4.0, 0.01)
    station = relaxing(time_s)
    paired = hold_of(replace(station, time_s=time_s[np.arange(len(time_s)) // 2 * 2]))
    assert paired.step_s == pytest.approx(0.02, rel=0.01)
    assert len(paired.time_s) == pytest.approx(len(time_s) / 2, abs=2)


def test_a_press_may_be_made_of_lists_and_counts() -> None:
    time_s = np.arange(0.0, 4.0, 0.01)
    station = relaxing(time_s, 50.0)
    counts = np.round(station.signal_pa).astype(int)
    listed = replace(station, time_s=time_s.tolist(), signal_pa=counts,
                     depth_m=len(time_s) * [np.nan])  # fmt: skip
    floats = replace(station, signal_pa=counts.astype(float))
    assert np.array_equal(hold_of(listed).signal_pa, hold_of(floats).signal_pa)


@pytest.mark.parametrize("times", [1e-300, 1e-200, 1e-30, 1e12, 1e160, 1e300])
def test_what_no_sensor_reads_is_noted_and_nothing_is_found(times: float) -> None:
    """Squares of it overflowed, and detection ended with an error."""
    pressed = row(np.random.default_rng(1), pulse_pa=200.0)
    stations = [replace(one, signal_pa=one.signal_pa * times) for one in pressed]
    found = detect(recording(stations))
    assert found.finding == "undecided"
    assert all("which no sensor does" in one.note for one in found.stations)
