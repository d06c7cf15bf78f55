"""A simulated scan and a rig's run the same guard code: its functions, by name."""

import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import pytest
from springs import LIMIT_N, monitor_of, on_simulated_springs, on_springs, run_springs, spring_rig

from probe.guards.guard_process import Service
from probe.guards.interface import Guards

RULES = {
    "force_limit.check", "sample_times.check", "stuck_sensor.check", "presses.check",
    "press_guard.check", "pose_guard.check", "silence.check", "readings.take", "readings.take_pose",
    "guarded_stage.object", "guarded_stage.move", "safety_monitor._take",
    "safety_monitor._step_sensor", "safety_monitor._step_stage", "safety_monitor._check_silence",
    "retreat.step", "retreat._at_rest", "retreat._rested", "retreat._watch_the_lift",
    "stopping.order", "stopping.worked",
}  # fmt: skip
"""What judges a reading or a pose, stops and lifts."""


def called(act: Callable[[], None]) -> set[str]:
    """The guards' functions that run meanwhile, in any thread that begins meanwhile."""
    names: set[str] = set()

    def profile(frame: FrameType, event: str, _argument: object) -> None:
        file = Path(frame.f_code.co_filename)
        if event == "call" and file.parent.name == "guards" and file.parent.parent.name == "probe":
            names.add(f"{file.stem}.{frame.f_code.co_name}")

    threading.setprofile(profile)
    sys.setprofile(profile)
    try:
        act()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)  # type: ignore[arg-type]
    return names


@pytest.mark.parametrize("springs", [on_simulated_springs, on_springs], ids=["simulated", "wall"])
def test_the_rules_the_stop_and_the_lift_are_the_same_functions(
    springs: Callable[..., tuple[object, object, object]],
) -> None:
    def press() -> None:
        bed, stage, sensor = springs(stiffness_n_m=1000.0)
        rig = spring_rig(scan={"approach_mm_s": 2.0, "ramp_s": 2.5})
        ran = run_springs(bed, stage, [sensor], rig=rig)  # type: ignore[arg-type]
        assert f"limit is {LIMIT_N:g} N" in ran.reason
        assert ran.lifted

    assert called(press) >= RULES


def test_the_other_process_asks_the_monitor_itself() -> None:
    _, stage, sensor = on_springs()
    monitor = monitor_of(stage, sensor, threaded=True)
    members = {name for name in vars(Guards) if not name.startswith("_")}
    assert {"move", "pose", "levels", "leave", "look"} < members
    for name in members:
        assert hasattr(monitor, name)
        assert not hasattr(Service, name)
    assert Service(stage, monitor).answer("pose", (), {}) == stage.pose()
    assert stage.orders == []
