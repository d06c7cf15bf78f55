"""A controller that misses cycles loses time; stamps must not."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from drivers import SimulatedClock
from drivers.core.timestamps import LASTING_S, DeviceTime
from drivers.ur import sensor
from drivers.ur.client import State
from sim_backend import load_scene
from sim_backend.emulators.ur import MISSED_S
from sim_backend.emulators.ur.mounting import Mounting
from sim_backend.emulators.ur.robot import Robot
from sim_backend.phantom.phantom import Phantom, Respond

EVERY, AT = 600, 200


class Cycles:
    """A link to the emulated controller's inside, without this machine's time between them.

    Each cycle arrives 0.3 ms after it began, or up to 2 ms later.
    """

    def __init__(self, robot: Robot, clock: SimulatedClock) -> None:
        self.rate_hz = 1 / robot.period_s
        self._robot, self._clock = robot, clock
        self._cycle = 0
        self._rng = np.random.default_rng(0)

    def samples(self, _timeout_s: float) -> list[State]:
        """The next one."""
        self._clock.sleep_until(self._clock.now() + self._robot.until_s(self._cycle))
        reported = self._robot.outputs(self._cycle)
        self._cycle += 1
        arrival_s = self._clock.now() + 3e-4 + min(float(self._rng.exponential(3e-4)), 2e-3)
        return [
            State(
                reported["timestamp"], arrival_s, reported["actual_TCP_pose"],
                reported["actual_TCP_force"], reported["target_TCP_speed"], 1, 7, 2, 1.0,
                busy=False,
            )
        ]  # fmt: skip

    def began_s(self) -> float:
        """When the newest cycle did, in the world."""
        return self._robot.until_s(self._cycle - 1) + self._clock.now()


def test_missed_cycles_are_reported_and_times_put_right(
    winkler: Respond, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SimulatedClock()
    monkeypatch.setattr(sensor.time, "monotonic", clock.now)
    home = (0.03, 0.0, -0.001)
    phantom = Phantom(load_scene("TIHA"), clock, winkler, home=home)
    robot = Robot(phantom, Mounting(), 0.0, 0, 0.002)
    cycles = Cycles(robot, clock)
    source = sensor.WrenchSource(clock, cycles, "tool")  # type: ignore[arg-type]
    off_s, jumps = [], []
    for n in range(5 * EVERY):
        if n % EVERY == AT:
            robot.miss_cycles(MISSED_S)
        (sample,) = source.read()
        off_s.append(sample.time_s - cycles.began_s())
        jumps.append(sample.jumped_s)
    reported = [jump for jump in jumps if jump > 0]
    assert len(reported) == 5
    assert reported == pytest.approx([MISSED_S] * 5, abs=1e-3)
    lasting = round(2 * LASTING_S / robot.period_s)
    right = np.abs([off for n, off in enumerate(off_s) if not AT <= n % EVERY < AT + lasting])
    assert right.max() < 1e-3
    assert min(off_s) == pytest.approx(-MISSED_S, abs=1e-3)  # until it was told


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


@pytest.mark.parametrize("late", [
    lambda at, _: max(at, 1.0) if 0.7 < at < 1.0 else at,  # what waited comes at once
    lambda at, rng: at + (0.02 + rng.exponential(0.03) if 1.0 < at < 3.0 else 0.0),
], ids=["once", "for long"])  # fmt: skip
def test_a_machine_that_is_late_itself_moves_no_time(
    late: Callable[[float, np.random.Generator], float],
) -> None:
    rng, device = np.random.default_rng(0), [0.002 * n for n in range(2000)]
    arrivals = np.maximum.accumulate([late(at, rng) for at in device]).tolist()
    times, jumps = stamps(arrivals, device)
    assert max(jumps) == 0.0
    assert times == pytest.approx(device, abs=2e-3)
