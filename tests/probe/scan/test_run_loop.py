"""How often the engine looks."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drivers import SimulatedClock
from probe.config.rig import Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.guards.commands import Control
from probe.scan.run_loop import RunLoop


@pytest.mark.parametrize(("threaded", "every_s"), [(True, 0.005), (False, 0.008)])
def test_at_rest_the_engine_keeps_its_pace_with_the_wall_clock(
    threaded: bool, every_s: float
) -> None:
    clock, looks_s, plan = SimulatedClock(), [0.0], plan_for(Rig())
    monitor: Any = SimpleNamespace(
        threaded=threaded, trip=None, jumped=None, step=lambda: None, collect=list,
        engine_heartbeat=lambda: looks_s.append(clock.now()),
    )  # fmt: skip
    stage: Any = SimpleNamespace()
    sensor: Any = SimpleNamespace(name="cell", rate_hz=500.0)
    bus: Any = SimpleNamespace(sink_error=None, samples=lambda _: None)
    loop = RunLoop(plan, stage, [sensor], clock, limits_for(Rig(), plan), monitor, Control(), bus)
    loop.wait_until(0.1)
    assert np.diff(looks_s).max() == pytest.approx(every_s, abs=1e-9)
    assert looks_s[-1] == pytest.approx(0.1, abs=1e-9)
