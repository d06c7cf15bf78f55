"""A scan under a planner: what it asks for is made within the plan's limits, or nothing is."""

import math
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers import SimulatedClock, WallClock
from probe.config.devices import connect
from probe.config.rig import Rig, RigError
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.config.scan_planner import planner_for
from probe.config.snapshot import run_config
from probe.core.events import (
    Event,
    Finish,
    Note,
    Phase,
    PhaseEntered,
    RunEnded,
    StationEnded,
)
from probe.core.recording import Recording
from probe.guards.commands import Control
from probe.planning.plan import Place, Plan
from probe.planning.planner import Done, Planner, Press, whole_press
from probe.scan.engine import run_scan
from probe.scan.resume import resume
from probe.scan.session import scan
from probe.storage.run import open_run
from probe.storage.verify import verify
from sim_backend.scene.scene_file import load_scene

RIG = Rig.model_validate({"scan": {"start_mm": 28, "stations": 3, "hold_s": 0.8}})
PLAN = plan_for(RIG)
SCENE = load_scene("TIHA")


class Listed:
    """Asks for what it was given, and keeps what it is told."""

    def __init__(self, *choices: Any, enough: Any = False) -> None:
        self.choices, self._enough = list(choices), enough
        self.told: list[Recording] = []
        self.judged: list[Recording] = []

    def ask(self) -> Any:
        choice = self.choices.pop(0) if self.choices else Done("that is all")
        return choice() if callable(choice) else choice

    def tell(self, reading: Recording) -> None:
        self.told.append(reading)

    def enough(self, reading: Recording) -> bool:
        self.judged.append(reading)
        return bool(self._enough() if callable(self._enough) else self._enough)


def press(station: int, **changes: Any) -> Press:
    return replace(whole_press(PLAN, PLAN.places[station]), **changes)


def made(
    planner: Planner, winkler: Any, *, hook: Callable[[Event, Control], None] | None = None,
    wall: bool = False,
) -> tuple[RunEnded, list[Event], float]:  # fmt: skip
    """The end of a scan, its events, and how high the probe stands after it [m]."""
    clock = WallClock() if wall else SimulatedClock()
    control, events = Control(), []

    def sink(event: Event) -> None:
        events.append(event)
        if hook is not None:
            hook(event, control)

    with connect(RIG, clock, SCENE, seed=5, respond=winkler) as devices:
        ended = run_scan(
            PLAN, devices.stage, devices.sensors, clock, sink, limits_for(RIG, PLAN),
            control=control, planner=planner, config=run_config(RIG, SCENE, PLAN, 5),
        )  # fmt: skip
        return ended, events, devices.stage.pose().z


def complete(events: list[Event]) -> list[int]:
    return [e.station for e in events if isinstance(e, StationEnded) and e.complete]


def holds_s(events: list[Event]) -> list[float]:
    at = {
        phase: [e.time_s for e in events if isinstance(e, PhaseEntered) and e.phase is phase]
        for phase in (Phase.HOLDING, Phase.RETRACTING)
    }
    return [up - down for down, up in zip(*at.values(), strict=True)]


def test_it_chooses_the_order_and_the_end(winkler: Any) -> None:
    planner = Listed(press(2), press(0), Done("two are enough"))
    ended, events, _ = made(planner, winkler)
    assert (ended.finish, ended.reason) == (Finish.COMPLETED, "two are enough")
    assert complete(events) == [2, 0]
    told = [reading.stations for reading in planner.told]
    assert [(s.index, s.x_m) for (s,) in told] == [(n, PLAN.places[n].x_m) for n in (2, 0)]
    assert planner.told[0].stations[0].hold_level_pa > 1000


def test_it_presses_less_deep(winkler: Any) -> None:
    planner = Listed(press(1, depth_m=1e-3), press(2))
    made(planner, winkler)
    shallow, deep = (reading.stations[0] for reading in planner.told)
    assert shallow.hold_depth_m == pytest.approx(1e-3, abs=2e-5)
    assert shallow.hold_level_pa < 0.6 * deep.hold_level_pa


@pytest.mark.parametrize(("enough", "hold_s"), [(True, 0.3), (False, 0.8)])
def test_a_hold_ends_when_it_has_enough(winkler: Any, enough: bool, hold_s: float) -> None:
    planner = Listed(press(1, holds_s=(0.3, 0.8)), enough=enough)
    _, events, _ = made(planner, winkler)
    assert holds_s(events) == [pytest.approx(hold_s, abs=1e-6)]
    (seen,) = planner.judged
    held_s = seen.stations[0].time_s[-1] - seen.stations[0].hold_s
    assert held_s == pytest.approx(0.3, abs=0.01)


def fails() -> None:
    raise ZeroDivisionError("of its own")


@pytest.mark.parametrize("asked, said", [
    (fails, "ZeroDivisionError: of its own"),
    (None, "asked for None"),
    (press(1, place=Place(1, math.nan, 0.0)), "none of the stations"),
    (press(1, place=Place(1, 0.5, 0.0)), "none of the stations"),
    (press(1, place=Place(7, 0.028, 0.0)), "none of the stations"),
    (press(1, depth_m=2.6e-3), "depth_m = 0.0026"),
    (press(1, depth_m=math.nan), "depth_m = nan"),
    (press(1, depth_m=-1e-3), "depth_m = -0.001"),
    (press(1, depth_m="deep"), "TypeError"),
    (press(1, force_n=0.5), "force_n = 0.5 is not allowed without scan.force_n"),
    (press(1, holds_s=(0.5, 60.0)), "holds_s = (0.5, 60.0)"),
    (press(1, holds_s=(0.8, 0.5)), "holds_s = (0.8, 0.5)"),
    (press(1, holds_s=(math.nan,)), "holds_s = (nan,)"),
    (press(1, holds_s=()), "holds_s = ()"),
])  # fmt: skip
def test_nonsense_ends_the_run_and_what_was_read_stays(winkler: Any, asked: Any, said: str) -> None:
    ended, events, z_m = made(Listed(press(0), asked), winkler)
    assert ended.finish is Finish.FAULTED
    assert ended.reason.startswith("planner Listed ")
    assert said in ended.reason
    assert complete(events) == [0]
    assert len([e for e in events if isinstance(e, StationEnded)]) == 1  # no other was begun
    assert z_m >= PLAN.travel_z_m - 1e-6
    assert [e.text for e in events if isinstance(e, Note) and e.level == "fault"] == [ended.reason]


def test_one_that_fails_in_a_hold_lifts_the_probe(winkler: Any) -> None:
    ended, events, z_m = made(Listed(press(0, holds_s=(0.2, 0.8)), enough=fails), winkler)
    assert ended.finish is Finish.FAULTED
    assert "ZeroDivisionError" in ended.reason
    assert complete(events) == []
    assert z_m >= PLAN.travel_z_m - 1e-6


def test_one_that_asks_for_what_is_complete_is_asked_again_but_not_for_ever(winkler: Any) -> None:
    ended, events, _ = made(Listed(press(0), press(0), press(1)), winkler)
    assert (ended.reason, complete(events)) == ("that is all", [0, 1])
    ended, events, _ = made(Listed(*[press(0)] * 9), winkler)
    assert ended.finish is Finish.FAULTED
    assert "nothing but stations that are complete" in ended.reason
    everything = [press(0), press(1), press(2), *[press(0)] * 9]
    assert made(Listed(*everything), winkler)[0].reason == "every station is complete"


def test_what_breaks_a_press_off_does_not_ask_again(winkler: Any) -> None:
    def pause_once(event: Event, control: Control) -> None:
        if isinstance(event, PhaseEntered) and event.phase is Phase.HOLDING and not pauses:
            pauses.append(event)
            control.pause(now=True)
            threading.Timer(0.2, control.resume).start()

    pauses: list[Event] = []
    ended, events, _ = made(Listed(press(2), press(0)), winkler, hook=pause_once)
    assert ended.reason == "that is all"
    tries = [(e.station, e.attempt, e.complete) for e in events if isinstance(e, StationEnded)]
    assert tries == [(2, 1, False), (2, 2, True), (0, 1, True)]


@pytest.mark.parametrize("where", ["ask", "enough"])
def test_one_that_never_answers_is_left_by_an_abort(winkler: Any, where: str) -> None:
    """In a hold it is not waited for: the hold ends when it must."""
    never = threading.Event()
    planner = (
        Listed(never.wait) if where == "ask" else
        Listed(press(0, holds_s=(0.1, 0.3)), enough=never.wait)
    )  # fmt: skip
    begun = threading.Event()

    def abort_soon(event: Event, control: Control) -> None:
        first = "connecting" if where == "ask" else "retracting"
        if isinstance(event, PhaseEntered) and event.phase == first and not begun.is_set():
            begun.set()
            threading.Timer(1.0, control.abort).start()

    try:
        ended, events, z_m = made(planner, winkler, hook=abort_soon, wall=True)
    finally:
        never.set()
    assert (ended.finish, ended.reason) == (Finish.ABORTED, "aborted by the user")
    assert complete(events) == ([0] if where == "enough" else [])
    assert z_m >= PLAN.travel_z_m - 1e-6


EVERY_OTHER = '''
from probe.planning.planner import Done, whole_press

class EveryOther:
    """Presses from the last station on, and says what it was told."""

    def __init__(self, plan, *, step: int = 2):
        self.left, self.plan, self.told = list(plan.places)[::step], plan, []

    def tell(self, reading):
        self.told.append(reading.stations[0].index)
        self.left = [place for place in self.left if place.index not in self.told]

    def ask(self):
        return whole_press(self.plan, self.left[-1]) if self.left else Done(f"told of {self.told}")
'''


@pytest.fixture
def every_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rig:
    """A rig with a planner of another package."""
    (tmp_path / "skipping.py").write_text(EVERY_OTHER, "utf-8")
    info = tmp_path / "skipping-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: skipping\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[palpate.planners]\nevery-other = skipping:EveryOther\nbroken = skipping:Nobody\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    return Rig.model_validate({"scan": {"start_mm": 24, "stations": 5, "planner": "every-other"}})


def test_a_resumed_scan_goes_on_from_what_was_read(
    every_other: Rig, tmp_path: Path, winkler: Any
) -> None:
    control = Control()

    def impatient(event: Event) -> None:
        if isinstance(event, StationEnded) and event.station == 4:
            control.abort()

    begun = scan(every_other, "TIHA", tmp_path, respond=winkler, control=control,
                 observers=[impatient])  # fmt: skip
    assert begun.ended.finish is Finish.ABORTED
    ended = resume(begun.path, respond=winkler).ended
    assert (ended.finish, ended.reason) == (Finish.COMPLETED, "told of [4, 2, 0]")
    assert verify(begun.path).ok
    run = open_run(begun.path)
    assert [station.index for station in run.recording().stations] == [0, 2, 4]
    assert run.recording().ended == "told of [4, 2, 0]"
    with pytest.raises(Exception, match="its planner is done"):
        resume(begun.path, respond=winkler)
    redone = resume(begun.path, respond=winkler, redo=[4]).ended  # which it would not choose
    assert redone.finish is Finish.COMPLETED
    rest = resume(begun.path, respond=winkler, settings={"scan.planner": "raster"}).ended
    assert rest.reason == "every station is complete"
    assert [s.index for s in open_run(begun.path).recording().stations] == [0, 1, 2, 3, 4]
    assert verify(begun.path).ok


@pytest.mark.parametrize("name, keys, said", [
    ("nobody", {}, "scan.planner = 'nobody': no such planner; known: .*every-other"),
    ("broken", {}, "scan.planner = 'broken': the plug-in 'skipping:Nobody' is broken"),
    ("every-other", {"stop": 2}, "planner.*stop"),
    ("every-other", {"step": "two"}, "planner.*step"),
    ("every-other", {"step": 0}, "scan.planner = 'every-other': ValueError"),
    ("raster", {"step": 2}, "planner.*step"),
])  # fmt: skip
def test_one_that_cannot_be_is_named_before_anything_moves(
    every_other: Rig, name: str, keys: dict[str, Any], said: str
) -> None:
    scanned = every_other.scan.model_copy(update={"planner": name})
    rig = every_other.model_copy(update={"scan": scanned, "planner": keys})
    with pytest.raises(RigError, match=said):
        planner_for(rig, PLAN)


def test_its_keys_are_given(every_other: Rig) -> None:
    rig = every_other.model_copy(update={"planner": {"step": 3}})
    planner: Any = planner_for(rig, plan_for(rig))
    assert [place.index for place in planner.left] == [0, 3]
    assert isinstance(planner.plan, Plan)
