"""Device time mapped to scan time: the delay of a line must not become jitter of the samples."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.core.timestamps import DRIFT, DeviceTime, FrameTime


def test_jitter_of_the_line_is_taken_out() -> None:
    rng = np.random.default_rng(1)
    device = np.arange(2000) * 0.002
    arrival = 100.0 + device + 0.003 + rng.exponential(0.004, len(device))
    time = DeviceTime(latency_s=0.003)
    stamped = np.array([time.stamp(d, a) for d, a in zip(device, arrival, strict=True)])
    error = stamped - (100.0 + device)
    assert np.std(arrival - 100.0 - device) > 3e-3
    assert np.abs(error[100:]).max() < 0.3e-3
    assert np.std(error[100:]) < 0.1e-3


def test_a_device_whose_crystal_runs_apart_is_followed() -> None:
    device = np.arange(0, 60, 0.01)
    arrival = 5.0 + device * (1 + 0.8 * DRIFT)
    time = DeviceTime()
    stamped = np.array([time.stamp(d, a) for d, a in zip(device, arrival, strict=True)])
    np.testing.assert_allclose(stamped, arrival, atol=1e-4)
    faster = DeviceTime()
    stamped = np.array([faster.stamp(d, 5.0 + 0.9 * d) for d in device])
    np.testing.assert_allclose(stamped, 5.0 + 0.9 * device, atol=1e-3)


@settings(max_examples=200)
@given(
    st.lists(st.floats(0, 2), min_size=2, max_size=60),
    st.lists(st.integers(0, 3), min_size=60, max_size=60),
)
def test_frames_never_go_back_in_time(delays: list[float], skipped: list[int]) -> None:
    frames, sent, arrived, last = FrameTime(0.01), 0.0, 0.0, -np.inf
    for delay, missing in zip(delays, skipped, strict=False):
        sent += 0.01 * (1 + missing)
        arrived = max(arrived, sent + delay)
        time_s, _ = frames.stamp(arrived, missing)
        assert time_s > last
        assert time_s <= arrived + 1e-4  # nothing is felt before it happened
        last = time_s


def test_frames_that_vanish_unseen_are_counted() -> None:
    frames = FrameTime(0.01)
    lost = [frames.stamp(1 + 0.01 * k)[1] for k in range(50) if not 20 <= k < 23]
    assert sum(lost) == 3
    time_s, _ = frames.stamp(1.5)
    assert abs(time_s - 1.5) < 1e-3


@pytest.mark.parametrize("error", [-0.02, 0.02])
def test_a_device_that_is_not_quite_as_fast_as_its_data_sheet_loses_nothing(error: float) -> None:
    rng = np.random.default_rng(2)
    frames, true = FrameTime(0.01), 0.01 * (1 + error) * np.arange(1000)
    stamped = [frames.stamp(t + rng.exponential(0.001)) for t in true]
    assert sum(lost for _, lost in stamped) == 0
    assert np.abs(np.array([t for t, _ in stamped]) - true)[200:].max() < 2e-3


def test_a_device_that_loses_frames_is_not_taken_for_a_slow_one() -> None:
    """4 % fewer frames than the data sheet says: more than a device's own clock can be off."""
    rng = np.random.default_rng(3)
    frames, true = FrameTime(0.01), 0.01 * 1.04 * np.arange(1500)
    assert sum(frames.stamp(t + rng.exponential(0.001))[1] for t in true) > 20


def test_four_late_reads_in_a_row_are_a_busy_reader_not_lost_frames() -> None:
    frames, late = FrameTime(0.01), 0.0095 * np.isin(np.arange(60), range(20, 24))
    assert sum(frames.stamp(0.01 * k + late[k])[1] for k in range(60)) == 0


def test_reads_that_become_later_by_less_than_a_frame_miss_none() -> None:
    frames, late = FrameTime(0.01), 0.006 * (np.arange(60) >= 20)
    assert sum(frames.stamp(0.01 * k + late[k])[1] for k in range(60)) == 0


def test_a_device_that_starts_anew_is_followed_from_there() -> None:
    time = DeviceTime()
    before = [time.stamp(k * 0.1, 50 + k * 0.1) for k in range(10)]
    after = [time.stamp(k * 0.1, 52 + k * 0.1) for k in range(10)]
    np.testing.assert_allclose(after, 52 + 0.1 * np.arange(10), atol=1e-3)
    assert before[-1] < after[0]


def test_a_burst_after_a_pause_is_late_not_lost() -> None:
    frames = FrameTime(0.01)
    for k in range(20):
        frames.stamp(0.01 * k)
    stamped = [frames.stamp(0.30) for k in range(20, 30)]
    assert sum(lost for _, lost in stamped) == 0
    np.testing.assert_allclose([t for t, _ in stamped], 0.01 * np.arange(20, 30), atol=1e-3)
