"""The engine with an emulated UR: what its controller does wrong ends well.

A CB3's 125 Hz ask less of a machine that other tests keep busy.
"""

from collections.abc import Sequence

import pytest
from emulated_ur import Arm, connected
from springs import SpringStage, on_springs

from drivers import DeviceFault, Pose
from probe.core.events import Event, Finish, Note, RunEnded
from probe.guards.commands import Control
from probe.guards.prepare import monitor_for
from probe.planning.limits import Limits
from probe.planning.plan import Place, Plan, row
from probe.scan.engine import run_scan
from probe.scan.readiness import planned_poses
from sim_backend.emulators.ur import CB3
from sim_backend.phantom.phantom import Respond

PLAN = Plan(
    places=(Place(0, 0.03, 0.0),), indentation_m=1.5e-3, ramp_s=0.6, hold_s=0.6,
    clearance_m=2e-3, travel_m_s=0.02, approach_m_s=0.01,
)  # fmt: skip
BOX = ((-0.01, 0.07), (-0.01, 0.01), (-0.01, 0.05))
LIMITS = Limits(5.0, 3e-3, BOX, 0.03, silence_s=2.0, late_s=2.0, hardest_n_m=1e3)


def scan(made: Arm) -> tuple[RunEnded, list[Event]]:
    """One press."""
    events: list[Event] = []
    return run_scan(PLAN, made.stage, [made.sensor], made.clock, events.append, LIMITS), events


def test_a_slowed_controller_makes_the_scan_slower_and_says_so(winkler: Respond) -> None:
    with connected(winkler, version=CB3) as made:
        made.fail("slow slider")
        ended, events = scan(made)
        assert ended.finish is Finish.COMPLETED, ended.reason
        reported = " ".join(e.text for e in events if isinstance(e, Note))
        assert "slows every move to 20 %" in reported


def test_a_scan_that_cannot_be_reached_moves_nothing(winkler: Respond) -> None:
    with connected(winkler, version=CB3, reach_mm=400.0) as made:
        before = made.phantom.tip.all_legs()
        ended, _ = scan(made)
        assert ended.finish is Finish.FAULTED
        assert "cannot go to 2 of 2 planned poses" in ended.reason
        assert made.phantom.tip.all_legs() == before


class Arm(SpringStage):
    """One that cannot go below the surface."""

    def unreachable(self, poses: Sequence[Pose]) -> dict[Pose, str]:
        return {pose: "out of reach" for pose in poses if pose.z < 0.0}


def test_the_bottom_of_every_press_is_asked_about_too() -> None:
    bed, _, sensor = on_springs()
    plan = Plan(row(0.0, 4e-3, 2))
    guards = monitor_for(Arm(bed), [sensor], bed.clock, plan, LIMITS, Control())
    said = r"cannot go to 2 of 4 planned poses, such as 0\.0, 0\.0, -2\.5 mm: out of reach"
    with pytest.raises(DeviceFault, match=said):
        guards.ready(planned_poses(plan, turns=False))


def test_a_fault_of_motion_lifts_the_probe(winkler: Respond) -> None:
    with connected(winkler, version=CB3) as made:
        made.robot.floor_m = -0.2e-3
        ended, _ = scan(made)
        assert ended.finish is Finish.FAULTED
        assert "came to rest 1.30 mm from its target" in ended.reason
        assert made.tip_m[2] == pytest.approx(PLAN.travel_z_m, abs=1e-4)
