"""Guard latency: from the sample that breaks the force limit to the order to stop.

    python benchmarks/guards.py [TRIALS]

Three conditions: an idle process, a busy Python thread beside the guards (it competes for the
interpreter), and an engine that is blocked. Printed in sensor samples (500 Hz) and milliseconds.
"""

import sys
import threading
import time

import numpy as np

from drivers import Block, Channel, Pose, WallClock
from probe.guards.commands import Control
from probe.guards.safety_monitor import SafetyMonitor
from probe.planning.limits import Limits
from probe.planning.surfaces import flat

RATE_HZ = 500.0
LIMITS = Limits(1.0, 1e-2, ((-1.0, 1.0),) * 3, 1.0)


class StepSensor:
    """Samples at 500 Hz; the force jumps over the limit at sample ``step``."""

    name = "force"
    channels = (Channel("force", "N", "force", simulated=True),)
    rate_hz = RATE_HZ

    def __init__(self, clock: WallClock, step: int) -> None:
        self._clock, self._next = clock, 1
        self.step = step
        self._start_s = clock.now()

    def read(self) -> Block:
        """All samples due."""
        due = int((self._clock.now() - self._start_s) * RATE_HZ)
        index = np.arange(self._next, max(due + 1, self._next))
        self._next = max(due + 1, self._next)
        force = np.where(index >= self.step, 2.0, 0.0)[:, None]
        return Block(self._start_s + index / RATE_HZ, force, np.zeros(force.shape, bool))

    def breaks_s(self) -> float:
        """When the sample over the limit was taken."""
        return self._start_s + self.step / RATE_HZ

    def connect(self) -> None: ...
    def start(self) -> None: ...
    def tare(self) -> None: ...
    def stop(self) -> None: ...
    def close(self) -> None: ...


class StillStage:
    """Stays where it is and remembers when it was first told to stop."""

    name = "still"
    simulated = True

    def __init__(self, clock: WallClock) -> None:
        self._clock = clock
        self.stopped_s = np.nan
        self.stopped = threading.Event()

    def stop(self) -> None:
        """Remember when."""
        if not self.stopped.is_set():
            self.stopped_s = self._clock.now()
            self.stopped.set()

    def pose(self) -> Pose:
        """The origin."""
        return Pose(0.0, 0.0, 0.0)

    def moving(self) -> bool:
        """Never."""
        return False

    def connect(self) -> None: ...
    def move(self, target: Pose, speed_m_s: float) -> None: ...
    def close(self) -> None: ...


def latency_s(rng: np.random.Generator, *, blocked: bool) -> float:
    """One trial; the engine either beats every 5 ms or not at all."""
    clock = WallClock()
    sensor, stage = StepSensor(clock, int(rng.integers(10, 30))), StillStage(clock)
    monitor = SafetyMonitor(stage, [sensor], clock, flat, LIMITS, Control(), threaded=True)
    monitor.start()
    while not stage.stopped.wait(0.5 if blocked else 0.005):
        monitor.engine_heartbeat()
        monitor.collect()
    monitor.finish()
    return stage.stopped_s - sensor.breaks_s()


def main() -> None:
    """Print one row per condition."""
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    rng = np.random.default_rng(0)
    print("| condition | median samples | p99 samples | max samples | median ms | p99 ms |")
    print("|---|---|---|---|---|---|")
    for name, busy, blocked in (
        ("idle", False, False),
        ("busy thread", True, False),
        ("engine blocked", False, True),
        ("busy thread, engine blocked", True, True),
    ):
        end = threading.Event()
        if busy:
            threading.Thread(target=_burn, args=(end,), daemon=True).start()
        late = np.array([latency_s(rng, blocked=blocked) for _ in range(trials)])
        end.set()
        time.sleep(0.01)
        middle, rare = np.percentile(late, [50, 99])
        samples = np.array([middle, rare, late.max()]) * RATE_HZ
        cells = [f"{s:.2f}" for s in samples] + [f"{1e3 * middle:.2f}", f"{1e3 * rare:.2f}"]
        print(f"| {name} | {' | '.join(cells)} |")


def _burn(end: threading.Event) -> None:
    while not end.is_set():
        sum(range(1000))


if __name__ == "__main__":
    main()
