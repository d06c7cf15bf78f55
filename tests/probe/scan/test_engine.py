import errno
import re
import threading
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from drivers import Block, DeviceFault, Pose, SimulatedClock
from probe.config.devices import Devices, connect
from probe.config.rig import Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.core.events import (
    Event,
    Finish,
    Note,
    Phase,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.core.states import ALLOWED
from probe.guards.commands import Control
from probe.guards.safety_monitor import SafetyMonitor
from probe.scan.engine import run_scan
from probe.scan.run_loop import RunLoop
from sim_backend.scene.scene_file import load_scene

Hook = Callable[[Event, Control, Devices], None]


def scan(
    winkler: Any, *, stations: int = 3, hook: Hook | None = None, tables: Any = None, **more: Any
) -> tuple[RunEnded, list[Event], Devices]:
    """Scan TIHA around its artery; ``hook`` sees every event before it is kept."""
    around = {"start_mm": 28, "stations": stations}
    rig = Rig.model_validate({"scan": around} | (tables or {}))
    clock, control = SimulatedClock(), Control()
    opened = connect(rig, clock, load_scene("TIHA"), seed=5, respond=winkler)
    events: list[Event] = []

    def sink(event: Event) -> None:
        if hook is not None:
            hook(event, control, opened)
        events.append(event)

    plan = plan_for(rig)
    with opened:
        ended = run_scan(
            plan, opened.stage, opened.sensors, clock, sink, limits_for(rig, plan),
            control=control, **more,
        )  # fmt: skip
    check_order(events)
    return ended, events, opened


def check_order(events: list[Event]) -> None:
    """What holds for every run, however it ended."""
    assert isinstance(events[0], RunStarted)
    phases = [Phase.IDLE, *(e.phase for e in events if isinstance(e, PhaseEntered))]
    for now, then in pairwise(phases):
        assert then in ALLOWED[now]
    times: dict[str, float] = {}
    for event in events:
        if isinstance(event, Samples):
            assert event.block.time_s[0] > times.get(event.device, -1.0)
            assert (np.diff(event.block.time_s) > 0).all()
            times[event.device] = float(event.block.time_s[-1])


def of(events: list[Event], device: str, station: int | None = None) -> Block:
    chosen = [
        e.block
        for e in events
        if isinstance(e, Samples) and e.device == device and station in (None, e.station)
    ]
    return Block(
        np.concatenate([b.time_s for b in chosen]),
        np.concatenate([b.values for b in chosen]),
        np.concatenate([b.saturated for b in chosen]),
    )


def entered(events: list[Event], phase: Phase) -> list[float]:
    return [e.time_s for e in events if isinstance(e, PhaseEntered) and e.phase is phase]


def ends(events: list[Event]) -> list[tuple[int, int, bool]]:
    return [(e.station, e.attempt, e.complete) for e in events if isinstance(e, StationEnded)]


def at(phase: Phase, do: Callable[[Control, Devices], object], station: int | None = None) -> Hook:
    """Do something as soon as a phase is entered."""

    def hook(event: Event, control: Control, opened: Devices) -> None:
        entered = isinstance(event, PhaseEntered) and event.phase is phase
        if entered and station in (None, event.station):
            do(control, opened)

    return hook


def test_a_whole_scan(winkler: Any) -> None:
    ended, events, _ = scan(winkler)
    assert ended.finish is Finish.COMPLETED
    assert events[-1] is ended
    assert ends(events) == [(0, 1, True), (1, 1, True), (2, 1, True)]
    for ramp_s, hold_s, up_s in zip(
        *(entered(events, p) for p in (Phase.INDENTING, Phase.HOLDING, Phase.RETRACTING)),
        strict=True,
    ):
        assert hold_s - ramp_s == pytest.approx(1.0025, abs=0.0006)  # 2.5 mm/s up at 1 m/s2
        assert up_s - hold_s == pytest.approx(0.825, abs=1e-9)


def test_guards_look_at_two_samples_on_the_way_down_and_else_every_8_ms(
    winkler: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks_s: list[float] = []

    def noted(monitor: SafetyMonitor) -> None:
        looks_s.append(monitor.seen_s())
        step(monitor)

    step = SafetyMonitor.step
    monkeypatch.setattr(SafetyMonitor, "step", noted)
    _, events, opened = scan(winkler, stations=1)
    phases = (Phase.APPROACHING, Phase.INDENTING, Phase.HOLDING, Phase.RETRACTING, Phase.FINISHED)
    down_s, ramp_s, hold_s, up_s, end_s = (entered(events, phase)[0] for phase in phases)
    every_s, at_s = np.diff(looks_s), np.array(looks_s[1:])
    down = every_s[(at_s > down_s + 0.01) & (at_s < ramp_s)]
    ramp = every_s[(at_s > ramp_s + 0.01) & (at_s < hold_s)]
    rest = every_s[(at_s > hold_s + 0.02) & (at_s < hold_s + 0.8)]
    lift = every_s[(at_s > up_s + 0.01) & (at_s < end_s)]
    assert max(down.max(), ramp.max()) <= 2 / opened.sensors[0].rate_hz + 1e-9
    assert rest.max() == pytest.approx(0.008, abs=1e-9)
    assert np.median(lift) == pytest.approx(0.008, abs=1e-9)


def test_a_stage_that_is_late_is_waited_for_at_the_usual_pace(
    winkler: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was looked at every half millisecond for as long as it took."""
    looks_s: list[float] = []
    look = RunLoop._look_at
    monkeypatch.setattr(
        RunLoop, "_look_at", lambda loop, t: looks_s.append(loop.clock.now()) or look(loop, t)
    )
    slow = {"stage": {"driver": "virtual", "acceleration_mm_s2": 50}}
    _, events, _ = scan(winkler, stations=1, tables=slow)
    ((down_s,), (end_s,)) = (entered(events, p) for p in (Phase.APPROACHING, Phase.INDENTING))
    every_s = np.diff([t for t in looks_s if down_s < t < end_s])
    assert end_s - down_s > 0.4
    assert np.count_nonzero(every_s < 1e-3) <= 1 + 20  # one meets the expected end


def test_every_sample_of_a_press_is_in_and_labelled(winkler: Any) -> None:
    _, events, _ = scan(winkler)
    force = of(events, "force")
    assert np.diff(force.time_s) == pytest.approx(2e-3, abs=1e-9)  # none lost, none twice
    starts = {e.station: e.time_s for e in events if isinstance(e, StationStarted)}
    stops = {e.station: e.time_s for e in events if isinstance(e, StationEnded)}
    for n in starts:
        times = of(events, "force", n).time_s
        begun = force.time_s > starts[n] + 1e-9  # one of that very instant was read before
        assert times.tolist() == force.time_s[begun & (force.time_s < stops[n])].tolist()


def test_too_much_force_stops_and_retracts(winkler: Any) -> None:
    ended, events, opened = scan(winkler, tables={"safety": {"max_force_n": 0.5}})
    assert ended.finish is Finish.FAULTED
    assert "the limit is 0.5 N" in ended.reason
    assert ends(events) == [(0, 1, False)]
    # Two samples at 2.5 mm/s on about 0.45 N/mm, the way to rest, and the sensor's noise.
    assert of(events, "force").values[:, 0].max() < 0.5 + 0.006 + 0.003
    assert opened.stage.pose().z == pytest.approx(2e-3)


def test_a_saturated_sensor_is_not_a_small_force(winkler: Any) -> None:
    tables = {"sensor": [{"driver": "virtual", "full_scale_n": 0.4}]}
    ended, _, opened = scan(winkler, tables=tables)
    assert "saturated" in ended.reason
    assert opened.stage.pose().z > 0


@pytest.mark.parametrize(
    ("pushed_mm", "finish"), [(0.1, "completed"), (0.18, "faulted"), (5.5, "faulted")]
)
def test_a_tip_that_is_pushed_a_little_deeper_holds_no_press(
    winkler: Any, pushed_mm: float, finish: str
) -> None:
    """0.2 mm change the level by a tenth, which a map would take for a lump."""

    def push(_: Control, opened: Devices) -> None:
        x, y, z = opened.stage.pose()[:3]
        opened.stage.move(Pose(x, y, z - 1e-3 * pushed_mm), 2e-3)

    ended, events, _ = scan(winkler, hook=at(Phase.HOLDING, push))
    assert ended.finish.value == finish
    if finish == "faulted":
        assert "mm from where it was commanded to be" in ended.reason
        assert of(events, "stage").values[:, 2].min() > -3.1e-3


@pytest.mark.parametrize(
    "phase", [Phase.TRAVELLING, Phase.TARING, Phase.APPROACHING, Phase.INDENTING, Phase.HOLDING]
)
def test_abort_retracts(winkler: Any, phase: Phase) -> None:
    hook = at(phase, lambda control, _: control.abort(), station=1)
    ended, events, opened = scan(winkler, hook=hook)
    assert (ended.finish, ended.reason) == (Finish.ABORTED, "aborted by the user")
    assert ends(events) == [(0, 1, True), (1, 1, False)]
    assert opened.stage.pose().z == pytest.approx(2e-3)


def test_stop_halts_where_it_is(winkler: Any) -> None:
    hook = at(Phase.HOLDING, lambda control, _: (control.abort(), control.stop()))
    ended, events, opened = scan(winkler, hook=hook)
    assert (ended.finish, ended.reason) == (Finish.ABORTED, "stopped by the user")
    assert opened.stage.pose().z == pytest.approx(-2.5e-3, abs=1e-5)
    assert not entered(events, Phase.RETRACTING)


def test_pause_now_repeats_the_station(winkler: Any) -> None:
    def pause(event: Event, control: Control, _: Devices) -> None:
        if isinstance(event, StationStarted) and (event.station, event.attempt) == (1, 2):
            return
        if isinstance(event, PhaseEntered) and event.phase is Phase.PAUSED:
            threading.Timer(0.05, control.resume).start()
        if isinstance(event, PhaseEntered) and event.phase is Phase.HOLDING and event.station == 1:
            paused.append(1)
            if len(paused) == 1:
                control.pause(now=True)

    paused: list[int] = []
    ended, events, _ = scan(winkler, hook=pause)
    assert ended.finish is Finish.COMPLETED
    assert ends(events) == [(0, 1, True), (1, 1, False), (1, 2, True), (2, 1, True)]


def test_pause_after_the_station_loses_nothing(winkler: Any) -> None:
    def pause(event: Event, control: Control, _: Devices) -> None:
        if isinstance(event, PhaseEntered) and event.phase is Phase.PAUSED:
            threading.Timer(0.05, control.resume).start()
        elif isinstance(event, PhaseEntered) and event.phase is Phase.INDENTING:
            control.pause()

    ended, events, _ = scan(winkler, stations=2, hook=pause)
    assert ended.finish is Finish.COMPLETED
    assert ends(events) == [(0, 1, True), (1, 1, True)]
    assert len(entered(events, Phase.PAUSED)) == 2


def test_a_resumed_run_skips_what_is_complete(winkler: Any) -> None:
    _, events, _ = scan(winkler, completed={0, 2}, attempts={0: 1, 1: 2, 2: 1})
    assert ends(events) == [(1, 3, True)]


def test_a_full_disk_lifts_the_probe(winkler: Any) -> None:
    def full(_: Control, __: Devices) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    seen: list[Event] = []
    ended, events, opened = scan(winkler, hook=at(Phase.HOLDING, full), observers=[seen.append])
    assert ended.finish is Finish.FAULTED
    assert "No space left" in ended.reason
    assert opened.stage.pose().z == pytest.approx(2e-3)
    assert not isinstance(events[-1], RunEnded)  # a broken sink is not asked again
    assert seen[-1] is ended
    ends = [(e.station, e.complete) for e in seen if isinstance(e, StationEnded)]
    assert ends == [(0, False)]  # what cannot be stored is not measured


def test_a_broken_viewer_is_noted_and_left_alone(winkler: Any) -> None:
    calls = []

    def viewer(event: Event) -> None:
        calls.append(event)
        raise ValueError("no display")

    ended, events, _ = scan(winkler, observers=[viewer])
    assert ended.finish is Finish.COMPLETED
    assert len(calls) == 1
    assert [e.text for e in events if isinstance(e, Note)] == ["ValueError: no display"]


def test_a_sensor_that_dies_faults_with_its_own_words(winkler: Any) -> None:
    hook = at(Phase.INDENTING, lambda _, opened: opened.sensors[0].stop())
    ended, _, opened = scan(winkler, hook=hook)
    assert re.search(
        r"force: silent for 0.2. s; allowed: .* s .safety.(late|silence)_s", ended.reason
    )
    assert opened.stage.pose().z == pytest.approx(2e-3)


def test_a_stage_that_is_slower_than_the_usual_lift_is_lifted(winkler: Any) -> None:
    ended, events, opened = scan(
        winkler,
        tables={
            "stage": {"driver": "virtual", "max_speed_mm_s": 10.0},
            "scan": {"start_mm": 28, "stations": 1, "travel_mm_s": 10.0},
            "safety": {"max_speed_mm_s": 100.0, "max_force_n": 0.1},
        },
    )
    assert ended.finish is Finish.FAULTED
    assert not [e.text for e in events if isinstance(e, Note) and "NOT LIFTED" in e.text]
    assert opened.stage.pose().z == pytest.approx(2e-3)


def test_a_lost_stage_is_not_moved_again(winkler: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def stale() -> Pose:
        raise DeviceFault("virtual", "pose is stale")

    hook = at(Phase.INDENTING, lambda _, opened: monkeypatch.setattr(opened.stage, "pose", stale))
    ended, events, _ = scan(winkler, hook=hook)
    assert "pose is stale" in ended.reason
    assert not entered(events, Phase.RETRACTING)


def test_stop_while_an_abort_retracts(winkler: Any) -> None:
    def hook(event: Event, control: Control, _: Devices) -> None:
        if isinstance(event, PhaseEntered) and event.phase is Phase.HOLDING:
            control.abort()
        if isinstance(event, PhaseEntered) and event.phase is Phase.RETRACTING:
            control.stop()

    ended, events, opened = scan(winkler, hook=hook)
    assert (ended.finish, ended.reason) == (Finish.ABORTED, "stopped by the user")
    assert opened.stage.pose().z < -2e-3
    assert not opened.stage.moving()
    assert ends(events) == [(0, 1, False)]


def test_a_retraction_that_fails_ends_at_rest(winkler: Any) -> None:
    def hook(event: Event, control: Control, opened: Devices) -> None:
        if isinstance(event, PhaseEntered) and event.phase is Phase.HOLDING:
            control.abort()
        if isinstance(event, PhaseEntered) and event.phase is Phase.RETRACTING:
            opened.stage.move(Pose(0.028, 0.0, -9e-3), 5e-3)  # someone else moves the stage

    ended, _, opened = scan(winkler, hook=hook)
    assert ended.finish is Finish.FAULTED
    assert "still moving" in ended.reason
    assert not opened.stage.moving()
    assert opened.stage.pose().z > -2.6e-3


def test_a_press_in_which_a_devices_clock_stood_still_is_made_again(winkler: Any) -> None:
    """A controller that missed cycles: what it stamped until that was told is early."""
    reported = [0.06]

    def miss(event: Event, _control: Control, opened: Devices) -> None:
        if not (isinstance(event, PhaseEntered) and event.phase is Phase.HOLDING and reported):
            return
        (sensor,) = opened.sensors
        read = sensor.read

        def jumped() -> Block:
            return replace(read(), jumped_s=reported.pop() if reported else 0.0)

        sensor.read = jumped  # type: ignore[method-assign]

    ended, events, _ = scan(winkler, stations=2, hook=miss)
    assert ended.finish is Finish.COMPLETED
    assert ends(events) == [(0, 1, False), (0, 2, True), (1, 1, True)]
    notes = [e.text for e in events if isinstance(e, Note)]
    assert any("its clock stood still for 60 ms; the press is repeated" in text for text in notes)
