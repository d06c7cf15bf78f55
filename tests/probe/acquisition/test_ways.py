"""Where a scan sends the tip, and what it takes as zero there: on springs and simulated time."""

from dataclasses import replace

import numpy as np
from springs import Bed, SpringSensor, SpringStage, run_springs, spring_rig

from drivers import SimulatedClock
from probe.acquisition.engine import run_scan
from probe.config.scan_plan import limits_for, plan_for


def test_a_tip_that_begins_low_goes_up_before_it_goes_sideways() -> None:
    bed = Bed(SimulatedClock(), home=(20e-3, 0.0, 0.5e-3))
    rig = spring_rig()
    ran = run_springs(bed, SpringStage(bed), [SpringSensor(bed)], rig=rig)
    assert ran.reason == "every station is complete"
    path = np.array([bed.tip.point(t) for t in np.arange(0.0, bed.clock.now(), 1e-3)])
    between = (path[:, 0] > 1e-5) & (path[:, 0] < 20e-3 - 1e-5)
    assert between.sum() > 100
    assert path[between, 2].min() > plan_for(rig).travel_z_m - 1e-6


def test_a_soft_rig_is_followed_no_further_than_the_plan_allows() -> None:
    """400 N/m at 2.5 mm are 1 N, by which a rig of 2000 N/m yields 0.5 mm."""
    bed, rig = Bed(SimulatedClock()), spring_rig()
    soft = replace(plan_for(rig), compliance_m_per_n=1 / 2000, max_deflection_m=0.1e-3)
    ended = run_scan(
        soft, SpringStage(bed), [SpringSensor(bed)], bed.clock, lambda _event: None,
        limits_for(rig, soft),
    )  # fmt: skip
    assert ended.reason == "every station is complete"
    height_m, _ = bed.truth()
    assert -2.61e-3 < height_m.min() < -2.55e-3


def test_a_load_that_was_tared_is_no_drift() -> None:
    class Loaded(SpringSensor):
        def raw(self, time_s: float) -> float:
            return super().raw(time_s) + 0.7

    bed = Bed(SimulatedClock())
    rig = spring_rig(scan={"stations": 2})
    ran = run_springs(bed, SpringStage(bed), [Loaded(bed)], rig=rig)
    assert ran.reason == "every station is complete"
    assert not [text for text in ran.notes if "in the air since the last tare" in text]
