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
from probe.guards.interface import Status
from probe.scan.run_loop import RunLoop


@pytest.mark.parametrize(("threaded", "every_s"), [(True, 0.005), (False, 0.008)])
def test_at_rest_the_engine_keeps_its_pace_with_the_wall_clock(
    threaded: bool, every_s: float
) -> None:
    clock, looks_s, plan = SimulatedClock(), [0.0], plan_for(Rig())
    sensor: Any = SimpleNamespace(name="cell", rate_hz=500.0)

    def look() -> Status:
        looks_s.append(clock.now())
        return Status(None, None, clock.now(), 0.0)

    guards: Any = SimpleNamespace(
        threaded=threaded, facts=SimpleNamespace(stage=None, sensors=(sensor,)), collect=list,
        look=look,
    )  # fmt: skip
    bus: Any = SimpleNamespace(sink_error=None, samples=lambda _: None)
    loop = RunLoop(plan, clock, limits_for(Rig(), plan), guards, Control(), bus)
    loop.wait_until(0.1)
    assert np.diff(looks_s).max() == pytest.approx(every_s, abs=1e-9)
    assert looks_s[-1] == pytest.approx(0.1, abs=1e-9)
