"""What engine and store cost: simulated scans per second, and real time against physical time.

    python benchmarks/overhead.py [STATIONS]

Physical time is what the moves (trapezoids of speed), rests before a tare and holds take; anything
above it is the engine's. The tissue is a bed of springs, so that no finite elements are timed.
Every run is stored; the longest wait of a block to be committed is printed too.
"""

import sys
import time
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

from drivers import Array, Clock, SimulatedClock, WallClock
from probe.config.devices import connect
from probe.config.rig import Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.config.snapshot import run_config
from probe.core.events import Event, Phase, PhaseEntered
from probe.scan.engine import run_scan
from probe.storage.writer import create_store
from sim_backend.scene.scene_file import Scene, load_scene


class Springs:
    """F = 400 N/m x depth."""

    def force_n(self, _x_m: float, depth_m: Array, pressure_pa: Array) -> Array:
        """Force [N], 0 in the air."""
        force: Array = 400.0 * depth_m.clip(0.0) + 0.0 * pressure_pa
        return force

    von_mises_pa = force_n


def scan(clock: Clock, stations: int) -> tuple[float, float, float]:
    """Seconds spent, seconds the physics takes, and the longest wait of an event in the store."""
    rig, scene = Rig.model_validate({"scan": {"stations": stations}}), load_scene("TIHA")
    events: list[Event] = []

    def respond(_scene: Scene, _x_m: float, _depth_m: float) -> Springs:
        return Springs()

    with TemporaryDirectory() as folder, connect(rig, clock, scene, respond=respond) as opened:
        began = time.perf_counter()
        with create_store(Path(folder) / "scan.run") as store:
            ended = run_scan(
                plan_for(rig),
                opened.stage,
                opened.sensors,
                clock,
                store,
                limits_for(rig, plan_for(rig)),
                observers=[events.append],
                config=run_config(rig, scene, plan_for(rig), 0),
            )
        spent_s = time.perf_counter() - began
        assert opened.phantom is not None
        legs = opened.phantom.tip.all_legs()
    assert ended.finish == "completed", ended.reason
    entered = [(e.time_s, e.phase) for e in events if isinstance(e, PhaseEntered)]
    taring = sum(b[0] - a[0] for a, b in pairwise(entered) if a[1] is Phase.TARING)
    moving_s = sum(leg.end_s - leg.start_s for leg in legs)
    rest_s = stations * (rig.scan.hold_s + rig.scan.settle_s)
    assert taring >= stations * rig.scan.settle_s
    return spent_s, moving_s + rest_s, store.slowest_s


def main() -> None:
    """Print both figures."""
    stations = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    spent_s, physical_s, wait_s = scan(SimulatedClock(), 15)
    print(
        f"simulated clock, 15 stations: {spent_s:.2f} s for {physical_s:.1f} s; "
        f"committed within {1e3 * wait_s:.0f} ms"
    )
    spent_s, physical_s, wait_s = scan(WallClock(), stations)
    over = 100 * (spent_s / physical_s - 1)
    print(
        f"wall clock, {stations} stations: {spent_s:.2f} s for {physical_s:.2f} s ({over:+.1f} %); "
        f"committed within {1e3 * wait_s:.0f} ms"
    )


if __name__ == "__main__":
    main()
