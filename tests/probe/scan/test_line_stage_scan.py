"""The engine with emulated stages on a line: a scan of one press, and one that is blocked."""

import threading
import time
from dataclasses import replace
from typing import Any

import pytest

from drivers import WallClock
from drivers.core.registry import open_driver
from probe.core.events import Event, Finish, Phase, PhaseEntered, Samples
from probe.planning.limits import Limits
from probe.planning.plan import Place, Plan
from probe.scan.engine import run_scan
from sim_backend import load_scene
from sim_backend.emulators import pi, tmcl, zaber
from sim_backend.phantom.devices import virtual_sensor
from sim_backend.phantom.phantom import Phantom, Respond

PLAN = Plan(
    places=(Place(0, 0.03, 0.0),), indentation_m=1.5e-3, ramp_s=0.4, hold_s=0.3,
    clearance_m=2e-3, travel_m_s=0.02, approach_m_s=0.01,
)  # fmt: skip
BOX = ((-0.01, 0.07), (-0.01, 0.01), (-0.01, 0.05))
LIMITS = Limits(5.0, 3e-3, BOX, 0.03, silence_s=2.0, late_s=2.0)
FAULTS = [(zaber, "stall", "stalled"), (pi, "motion error", "servo"), (tmcl, "drop", "lost|silent")]


def scan(
    emulator: Any, winkler: Respond, fault: str | None = None, force_n: float | None = None
) -> tuple[Phantom, Finish, str, list[Event]]:
    clock = WallClock()
    phantom = Phantom(load_scene("TIHA"), clock, winkler, home=(0.03, 0.0, 0.004))
    name = emulator.__name__.rpartition(".")[2]
    events: list[Event] = []
    with emulator.emulate(phantom, homed=True) as served:

        def sink(event: Event) -> None:
            events.append(event)
            if isinstance(event, PhaseEntered) and event.phase is Phase.INDENTING and fault:
                threading.Thread(target=strike, args=(fault,)).start()

        def strike(fault: str) -> None:
            while phantom.tip.point(clock.now())[2] > -0.2e-3:
                time.sleep(0.005)
            served.fail(fault)

        keys = {"origin_mm": emulator.RIG_ORIGIN_MM, "max_speed_mm_s": 25.0, "silent_s": 2.0,
                "answer_s": 0.5, **emulator.RIG_AXES}  # fmt: skip
        stage = open_driver("stages", name, clock, {"port": served.address, **keys})
        plan = replace(PLAN, ramp_s=2.0) if fault else PLAN  # time to strike in
        plan = replace(plan, force_n=force_n)
        ended = run_scan(plan, stage, [virtual_sensor(clock, phantom=phantom)], clock, sink, LIMITS)
    return phantom, ended.finish, ended.reason, events


@pytest.mark.parametrize("emulator", [zaber, pi, tmcl], ids=["zaber", "pi", "tmcl"])
def test_a_press_is_as_deep_as_planned_and_felt(emulator: Any, winkler: Respond) -> None:
    phantom, finish, reason, events = scan(emulator, winkler)
    assert finish is Finish.COMPLETED, reason
    deepest = min(leg.point(float("inf"))[2] for leg in phantom.tip.all_legs())
    assert deepest == pytest.approx(-PLAN.indentation_m, abs=2e-6)
    felt_n = max(float(e.block.values.max()) for e in events if isinstance(e, Samples)
                 and len(e.block.values))  # fmt: skip
    assert felt_n > 0.3


def test_a_press_to_a_force_ends_at_it(winkler: Respond) -> None:
    phantom, finish, reason, _ = scan(zaber, winkler, force_n=0.4)
    assert finish is Finish.COMPLETED, reason
    deepest = min(leg.point(float("inf"))[2] for leg in phantom.tip.all_legs())
    assert -deepest == pytest.approx(0.4 / 485, rel=0.06)


@pytest.mark.parametrize(("emulator", "fault", "words"), FAULTS, ids=["zaber", "pi", "tmcl"])
def test_a_fault_in_a_press_ends_the_scan_in_its_words(
    emulator: Any, fault: str, words: str, winkler: Respond, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("probe.guards.retreat.PATIENCE_S", 2.0)  # it will never answer
    _, finish, reason, _ = scan(emulator, winkler, fault)
    assert finish is Finish.FAULTED
    assert any(word in reason for word in words.split("|")), reason
