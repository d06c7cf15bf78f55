"""A controller that misses cycles loses time; stamps must not."""

import time
from itertools import pairwise

import numpy as np
import pytest
from emulated_ur import connected

from drivers import Block, Pose
from drivers.core.timestamps import DeviceTime
from sim_backend.phantom.phantom import Respond


def test_missed_cycles_are_told_and_times_put_right(winkler: Respond) -> None:
    with connected(winkler) as (made, robot):
        made.stage.enable()
        made.sensor.tare()
        made.sensor.start()
        blocks: list[Block] = []
        for n in range(5):
            robot.fail("missed cycles")
            made.stage.move(Pose(0.03, 0.0, -0.002 if n % 2 else 0.0), 0.02)
            made.arrive()
            end_s = made.clock.now() + 3.0
            while not (found := made.sensor.read()).jumped_s:
                assert made.clock.now() < end_s
                time.sleep(0.02)
            blocks.append(found)
        began_s = made.clock.now()
        made.stage.move(Pose(0.03, 0.0, -0.002), 2e-3)
        made.arrive(5.0)
        time.sleep(0.1)
        last = made.sensor.read()
    # Each stall of 60 ms is told, less what the machine was late; a busy one adds its own.
    assert sum(block.jumped_s for block in blocks) > 0.5 * 5 * 0.06
    ramp = last.time_s > began_s
    true_n = made.phantom.force_n(last.time_s[ramp])
    # 400 N/m at 2 mm/s: 60 ms of error are 48 mN, the 300 of five stalls 0.24 N
    assert np.median(np.abs(last.values[ramp, 0] - true_n)) < 0.03


def stamps(arrivals: list[float], devices: list[float]) -> tuple[list[float], list[float]]:
    clock = DeviceTime(stands_still=True)
    times, jumps = [], []
    for device_s, arrival_s in zip(devices, arrivals, strict=True):
        times.append(clock.stamp(device_s, arrival_s))
        jumps.append(clock.jumped_s)
    return times, jumps


def test_a_clock_that_stood_is_anchored_anew() -> None:
    device = [0.002 * n for n in range(1000)]
    true = [at + (0.06 if n >= 400 else 0.0) for n, at in enumerate(device)]
    times, jumps = stamps(true, device)
    assert sum(jumps) == pytest.approx(0.06, abs=1e-3)
    assert times[-1] == pytest.approx(true[-1], abs=1e-3)
    assert all(b > a for a, b in pairwise(times))


def test_a_machine_that_is_late_itself_moves_no_time() -> None:
    """What waited comes at once, and the next in time."""
    device = [0.002 * n for n in range(1000)]
    late = [max(at, 1.0) if 0.7 < at < 1.0 else at for at in device]
    times, jumps = stamps(late, device)
    assert max(jumps) == 0.0
    assert times == pytest.approx(device, abs=1e-3)


def test_a_machine_that_is_late_for_long_moves_no_time() -> None:
    rng = np.random.default_rng(0)
    device = [0.002 * n for n in range(2000)]
    late = [at + (0.02 + rng.exponential(0.03) if 1.0 < at < 3.0 else 0.0) for at in device]
    late = np.maximum.accumulate(late).tolist()
    times, jumps = stamps(late, device)
    assert max(jumps) == 0.0
    assert times == pytest.approx(device, abs=2e-3)
