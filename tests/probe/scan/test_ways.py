"""Where a scan sends the tip, and what it takes as zero there: on springs and simulated time."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from springs import SOFT_N_M, Bed, SpringSensor, SpringStage, run_springs, spring_rig

from drivers import Block, SimulatedClock
from drivers.core.arrays import Array
from probe.config.rig import Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.core.events import Event, RunEnded, Samples, StationEnded
from probe.planning.plan import Plan
from probe.scan.engine import run_scan
from probe.scan.session import scan


def test_a_tip_that_begins_low_goes_up_before_it_goes_sideways() -> None:
    bed = Bed(SimulatedClock(), home=(20e-3, 0.0, 0.5e-3))
    rig = spring_rig()
    ran = run_springs(bed, SpringStage(bed), [SpringSensor(bed)], rig=rig)
    assert ran.reason == "every station is complete"
    path = np.array([bed.tip.point(t) for t in np.arange(0.0, bed.clock.now(), 1e-3)])
    between = (path[:, 0] > 1e-5) & (path[:, 0] < 20e-3 - 1e-5)
    assert between.sum() > 100
    assert path[between, 2].min() > plan_for(rig).travel_z_m - 1e-6


def pressed(plan: Plan, rig: Rig, stage: SpringStage) -> RunEnded:
    """How a plan ends that is not quite the rig's own."""
    bed = stage.bed
    return run_scan(
        plan, stage, [SpringSensor(bed)], bed.clock, lambda _event: None, limits_for(rig, plan)
    )


def test_a_soft_rig_is_followed_no_further_than_the_plan_allows() -> None:
    """400 N/m at 2.5 mm are 1 N, by which a rig of 2000 N/m yields 0.5 mm."""
    bed, rig = Bed(SimulatedClock()), spring_rig()
    soft = replace(plan_for(rig), compliance_m_per_n=1 / 2000, max_deflection_m=0.1e-3)
    ended = pressed(soft, rig, SpringStage(bed))
    assert ended.reason == "every station is complete"
    height_m, _ = bed.truth()
    assert -2.61e-3 < height_m.min() < -2.55e-3


def test_a_probe_that_cannot_rise_before_its_tare_says_which_key_holds_it_down() -> None:
    bed, rig = Bed(SimulatedClock()), spring_rig()
    low = replace(plan_for(rig), clearance_m=0.3e-3)
    reason = pressed(low, rig, SpringStage(bed)).reason
    assert "safety.retract_mm lets the probe rise 0.3 mm" in reason
    bed, plan = Bed(SimulatedClock(), home=(20e-3, 0.0, 2e-3)), plan_for(rig)
    limits = limits_for(rig, plan)
    roof = replace(limits, workspace_m=(*limits.workspace_m[:2], (-4e-3, 2.2e-3)))
    stage, sensors = SpringStage(bed), [SpringSensor(bed)]
    ended = run_scan(plan, stage, sensors, bed.clock, lambda _event: None, roof)
    assert "safety.workspace_mm.z lets the probe rise 0.2 mm" in ended.reason


def test_the_least_way_up_is_enough_at_any_height(tmp_path: Path, winkler: Any) -> None:
    """0.5 mm above 15.1 mm, and again, are a last digit less."""
    rig = Rig.model_validate({
        "scan": {"start_mm": 28, "stations": 1, "surface_mm": 15.1}, "safety": {"retract_mm": 0.5},
    })  # fmt: skip
    ran = scan(rig, "TIHA", tmp_path, respond=winkler)
    assert ran.ended.reason == "every station is complete"


def test_a_load_that_was_tared_is_no_drift() -> None:
    class Loaded(SpringSensor):
        def raw(self, time_s: float) -> float:
            return super().raw(time_s) + 0.7

    bed = Bed(SimulatedClock())
    rig = spring_rig(scan={"stations": 2})
    ran = run_springs(bed, SpringStage(bed), [Loaded(bed)], rig=rig)
    assert ran.reason == "every station is complete"
    assert not [text for text in ran.notes if "in the air since the last tare" in text]


def test_a_zero_that_moves_in_a_press_is_reported() -> None:
    class Shifts(SpringSensor):
        shift_n = 0.0

        def raw(self, time_s: float) -> float:
            self.shift_n = 0.2 if self.bed.force_n(time_s) > 0.5 else self.shift_n
            return super().raw(time_s) + self.shift_n

    bed = Bed(SimulatedClock())
    ran = run_springs(bed, SpringStage(bed), [Shifts(bed)], rig=spring_rig(scan={"stations": 2}))
    assert ran.reason == "every station is complete"
    (reported,) = [text for text in ran.notes if "in the air since the last tare" in text]
    assert "0.2" in reported


@pytest.mark.parametrize(
    ("times", "reason"),
    [(3, "every station is complete"), (4, "its clock stood still for 60 ms, again and again")],
)
def test_a_press_is_made_again_three_times_for_a_clock_that_stands_still(
    times: int, reason: str
) -> None:
    """At each station anew."""

    class StandsStill(SpringSensor):
        left, armed = times, True

        def block(self, time_s: Array, force: Array) -> Block:
            most_n = float(np.max(force, initial=0.0))
            stood = self.armed and self.left > 0 and most_n > 0.5
            self.left -= stood
            self.armed = (self.armed and not stood) or 0.0 < most_n < 0.1
            return replace(super().block(time_s, force), jumped_s=0.06 * stood)

    def sink(event: Event) -> None:
        if isinstance(event, StationEnded) and event.complete:
            sensor.left = times

    bed = Bed(SimulatedClock())
    sensor = StandsStill(bed)
    rig = spring_rig(scan={"stations": 2})
    ran = run_springs(bed, SpringStage(bed), [sensor], rig=rig, sink=sink)
    assert reason in ran.reason
    tried = [event.complete for event in ran.events if isinstance(event, StationEnded)]
    assert tried == (2 * [False, False, False, True] if times == 3 else 4 * [False])
    assert ran.lifted


def test_a_halt_that_is_not_heard_is_said_again() -> None:
    class Deaf(SpringStage):
        heard = 0

        def stop(self) -> None:
            self.heard += 1
            if self.heard != 1:  # the first is lost on the line
                super().stop()

    bed, rig = Bed(SimulatedClock()), spring_rig(scan={"touch_n": 0.1, "search_mm": 2.0})
    found = replace(plan_for(rig), indentation_m=0.2e-3)
    ended = pressed(found, rig, Deaf(bed))
    assert ended.reason == "every station is complete"
    height_m, _ = bed.truth()
    assert height_m.min() == pytest.approx(-0.1 / SOFT_N_M - 0.2e-3, abs=0.1e-3)


def test_what_was_read_last_is_in_the_run() -> None:
    bed, events = Bed(SimulatedClock()), list[Event]()
    sensor = SpringSensor(bed)
    ran = run_springs(bed, SpringStage(bed), [sensor], sink=events.append)
    assert ran.ended is not None
    times = [e.block.time_s for e in events if isinstance(e, Samples) and e.device == "cell"]
    assert times[-1][-1] > ran.ended.time_s - 3 / sensor.rate_hz
