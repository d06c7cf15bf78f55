"""Every control is clicked, every state is drawn; the pictures are kept to be looked at."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPointF, QRect, QSize, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLabel

from drivers import Channel
from probe.core.events import (
    Event,
    Finish,
    Note,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
)
from probe.gui.app import Follower
from probe.gui.body import BodyPanel
from probe.gui.controls import progress_line
from probe.gui.maps import MapPanel
from probe.gui.replay import SPEEDS, PairWindow, Player, ReplayWindow, TimeBar
from probe.gui.state import ViewState
from probe.gui.style import application
from probe.gui.window import RunWindow
from probe.report.look import PHASE_COLOURS
from probe.scan.remote import NotRunning

Make = Callable[..., list[Event]]
Shoot = Callable[..., None]
LEFT = Qt.MouseButton.LeftButton
FINDING = {
    "finding": "artery",
    "objects": [
        {"kind": "artery", "position_mm": 32.0, "position_ci_mm": [31.5, 32.5], "confidence": 0.98}
    ],
    "heart_rate_bpm": None,
    "stations": [],
}


@pytest.fixture(autouse=True)
def _plain_size() -> None:
    application()


def window_on(events: list[Event], asked: list[str] | None = None, **kwargs: Any) -> RunWindow:
    state = ViewState()
    for event in events:
        state.update(event)
    ask = None if asked is None else asked.append
    return RunWindow(Path("a.run"), lambda: state, ask=ask, **kwargs)


def measured(count: int) -> list[dict[str, float | None]]:
    one = {"baseline_pa": 1.0, "pulse_pa": 2.0, "pulse_below_pa": None}
    return [{"station": n + 1, **one} for n in range(count)]


def test_each_control_asks_for_its_word(make_run: Make, shoot: Shoot) -> None:
    asked: list[str] = []
    running = [e for e in make_run() if not isinstance(e, RunEnded)]
    window = window_on(running[:500], asked, finding=lambda: FINDING)
    shoot(window, "live_running")
    for word in ("pause", "resume", "abort", "stop"):
        window.frame()
        QTest.mouseClick(window.side.buttons[word], LEFT)
        window.frame()
    assert asked == ["pause", "resume", "abort", "stop"]
    assert "artery at x = 32.00 mm (95 %: 31.50 to 32.50)" in window.side.objects.text()
    assert "SIMULATED" in window.side.simulated.text()


@pytest.mark.parametrize("count", [0, 40, 10**9], ids=["empty", "running", "finished"])
def test_space_stops_in_any_state(count: int, make_run: Make, shoot: Shoot) -> None:
    asked: list[str] = []
    window = window_on(make_run()[:count], asked)
    shoot(window, f"live_space_{count}")
    window.activateWindow()
    for word in ("", "pause", "abort"):  # wherever the focus is
        target = window.side.buttons[word] if word else window
        target.setFocus()
        QTest.keyClick(target, Qt.Key.Key_Space)
    assert asked == ["stop"] * 3


def test_a_scan_that_does_not_answer_is_said(make_run: Make) -> None:
    def deaf(_word: str) -> None:
        raise NotRunning("no scan answers; use the rig's own stop")

    window = window_on(make_run())
    panel = type(window.side)(deaf)
    panel.press("stop")
    assert "rig's own stop" in panel.answer.text()


def test_the_beat_says_at_which_station_and_the_shades_what_they_mean(make_run: Make) -> None:
    window = window_on(make_run())
    window.frame()
    title = window.traces.beat.getPlotItem().titleLabel.text
    last = window.state().station
    assert last is not None
    assert f"at station {last + 1}, folded at" in title
    words = " ".join(label.text() for label in window.traces.findChildren(QLabel))
    for phase, colour in PHASE_COLOURS.items():
        assert (phase in words) == (phase in ("approaching", "indenting", "holding", "retracting"))
        assert (f"color:{colour}" in words) == (phase in words)


def test_before_the_run_the_window_says_what_to_do(shoot: Shoot) -> None:
    window = window_on([])
    shoot(window, "live_empty")
    assert window.pages.currentWidget() is window.empty
    assert "palpate scan" in window.empty.text()


def test_a_lost_device_is_shown_in_words(make_run: Make, shoot: Shoot) -> None:
    lost = [
        Note(5.0, "fault", "virtual", "no samples for 0.5 s: check the cable, then palpate resume"),
        RunEnded(5.1, Finish.FAULTED, "virtual: no samples for 0.5 s"),
    ]
    window = window_on([*make_run()[:200], *lost], [])
    shoot(window, "live_device_lost")
    assert "check the cable" in window.side.fault.text()
    assert "virtual: lost" in window.side.devices.text()


@pytest.mark.parametrize("size", [(1366, 768), (3840, 2160)], ids=["1366x768", "4k"])
def test_a_finished_grid_fits_small_and_large_screens(
    size: tuple[int, int], make_run: Make, shoot: Shoot
) -> None:
    application(size[1] / 1080 if size[1] > 1080 else None)
    window = window_on(make_run(rows=6, columns=15))
    shoot(window, f"live_grid_{size[0]}", size)
    assert window.maps.currentWidget() is window.maps.area
    assert np.nanmax(window.maps.grid_pulse.image.image) > 0
    assert window.maps.grid.image.image.shape == (6, 15)
    assert np.isfinite(window.maps.grid.image.image).all()


@pytest.mark.parametrize("times", [1.0, 2.0])
def test_a_window_opens_as_much_larger_as_its_text(
    times: float, make_run: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a 4K screen it opened as small as on any other, with text of twice the size cut off."""
    application(times)
    wide = SimpleNamespace(availableGeometry=lambda: QRect(0, 0, 3840, 2160))
    monkeypatch.setattr(QApplication, "primaryScreen", lambda: wide)
    assert window_on(make_run(columns=1)).width() == 1280 * times
    pair = PairWindow(("a", "b"), (make_run(columns=1), make_run(columns=1)))
    assert pair.width() == 1280 * times
    wide.availableGeometry = lambda: QRect(0, 0, 1024, 768)
    assert window_on(make_run(columns=1)).size() == QSize(1024, min(700 * round(times), 768))


def test_a_grid_drawn_while_it_grows_ends_as_one_drawn_at_once(make_run: Make) -> None:
    application()
    events = make_run(rows=3, columns=5)
    state, panel = ViewState(), MapPanel()
    for n, event in enumerate(events):
        state.update(event)
        if n % 7 == 0 and state.is_grid:
            panel.show_state(state)
    panel.show_state(state)
    at_once = MapPanel()
    at_once.show_state(state)
    assert np.isfinite(at_once.grid.image.image).all()
    assert np.array_equal(panel.grid.image.image, at_once.grid.image.image)


def test_a_grids_course_is_drawn_over_its_pulses(make_run: Make) -> None:
    application()
    window = window_on(make_run(rows=6, columns=15))
    state = window.state()
    stations = measured(len(state.plan))
    course = [[30.0, 0.0], [32.0, 4.0], [34.0, 8.0]]
    one = {"kind": "artery", "course_mm": course, "stenosed_mm": [4.0, 8.0]}
    state.judge({"objects": [one], "stations": stations, "heart_rate_bpm": None})
    window.maps.show_state(state, state.finding)
    vessel, stenosed = window.maps.grid_pulse.courses
    assert np.column_stack(vessel.getData()).tolist() == course
    assert np.column_stack(stenosed.getData()).tolist() == course[1:]
    state.judge({"objects": [], "stations": stations, "heart_rate_bpm": None})
    window.maps.show_state(state, state.finding)
    assert window.maps.grid_pulse.courses == []
    assert vessel not in window.maps.grid_pulse.plot.items


@pytest.mark.parametrize(("below_pa", "ends"), [(None, (0.0, 2.0)), (9.0, (0.0, 1.0))])
def test_a_grids_pulses_are_on_a_scale_from_0_also_where_none_is_seen(
    below_pa: float | None, ends: tuple[float, float], make_run: Make
) -> None:
    window = window_on(make_run(rows=2, columns=3))
    state = window.state()
    stations = [one | {"pulse_below_pa": below_pa} for one in measured(len(state.plan))]
    state.judge({"objects": [], "stations": stations, "heart_rate_bpm": None})
    window.maps.show_state(state, state.finding)
    assert window.maps.grid_pulse.bar.levels() == ends


def test_a_replay_draws_what_was_found_at_its_end(make_run: Make) -> None:
    """The course was drawn before the first press, beside the words "none yet"."""
    one = {"kind": "artery", "course_mm": [[30.0, 0.0], [32.0, 4.0]], "position_mm": 31.0}
    found = FINDING | {"objects": [one | {"confidence": 0.9}], "stations": measured(15)}
    window = ReplayWindow(Path("a.run"), make_run(rows=3, columns=5), lambda: found)
    for step, drawn in ((500, 0), (1000, 1), (500, 0)):
        window.bar.slider.setValue(step)
        window.frame()
        assert len(window.maps.grid_pulse.courses) == drawn


def test_the_first_cell_of_a_map_has_a_numbered_scale(make_run: Make) -> None:
    """Between two ends that are all but equal there was no number."""
    window = window_on(make_run(rows=3, columns=5))
    window.maps.grid.show_table(np.array([[6.5]]), (0, 0, 1, 1))
    low, high = window.maps.grid.bar.levels()
    assert low < 6.5 < high and high - low == pytest.approx(1.0)


def test_an_array_shows_its_taxels(make_run: Make, shoot: Shoot) -> None:
    """In the rows and columns of their names (4 x 7 were drawn as 7 x 4), in a line without."""
    events = make_run(columns=1, taxels=28)
    window = window_on(events)
    window.frame()
    assert window.maps.currentWidget() is window.maps.taxels
    assert window.maps.taxels.image.image.shape == (1, 28)
    begun = events[0]
    assert isinstance(begun, RunStarted)
    named = [Channel(f"r{n // 7}c{n % 7}", "N", "taxel", True) for n in range(28)]
    begun = replace(begun, channels={**begun.channels, "virtual": tuple(named)})
    window = window_on([begun, *events[1:]])
    shoot(window, "live_taxels")
    shown = window.maps.taxels.image.image
    assert shown.shape == (4, 7)
    assert shown[3, 6] == pytest.approx(1.5 * shown[0, 0], rel=1e-6)  # as the finger presses them
    assert shown.mean() > 1.0, "the hold is shown, and not the air after it"


def test_one_picture_that_fails_leaves_the_others(
    make_run: Make, shoot: Shoot, monkeypatch: pytest.MonkeyPatch
) -> None:
    window = window_on(make_run())

    def fails(*_: object) -> None:
        raise RuntimeError("Cannot set range [nan, nan]")

    for panel in (window.maps, window.body):
        monkeypatch.setattr(panel, "show_state", fails)
    shoot(window, "live_failing")
    said = [picture.currentWidget() for picture in window.pictures]
    assert [label.text().split(":")[0] for label in said if isinstance(label, QLabel)] == [
        "The map cannot be drawn", "The section cannot be drawn",
    ]  # fmt: skip
    assert len(window.traces.curves[0].getData()[0]) > 100
    assert len(window.traces.beat_curve.getData()[0]) > 10


def test_a_recording_without_places_shows_its_signal_and_its_pulse(
    make_run: Make, shoot: Shoot
) -> None:
    """As an import may be, which knows no phases either: the map ended in a traceback."""
    begun, *events = make_run(columns=2)
    assert isinstance(begun, RunStarted)
    plan = {"stations": [[n, None, None] for n in range(2)]}
    begun = replace(begun, config={"plan": plan, "face_mm2": 100.0})
    window = window_on([begun, *(e for e in events if not isinstance(e, PhaseEntered))])
    shoot(window, "live_without_places")
    assert window.maps.currentWidget() is window.maps.unknown
    assert "unknown" in window.maps.unknown.text()
    assert len(window.traces.curves[0].getData()[0]) > 100
    change_pa = window.traces.beat_curve.getData()[1]
    assert len(change_pa) > 10


def test_a_pulse_that_was_not_seen_is_not_drawn_as_0(make_run: Make, shoot: Shoot) -> None:
    for rows in (1, 2):
        window = window_on(make_run(rows=rows, columns=3))
        state = window.state()
        stations = measured(len(state.plan))
        stations[1]["pulse_below_pa"] = 8.0
        state.judge(FINDING | {"stations": stations})
        window.maps.show_state(state)
        if rows == 1:
            shoot(window, "live_not_seen")
            assert window.maps.line.beat_curve.getData()[0].tolist() == [4.0, 12.0]
            assert np.column_stack(window.maps.line.unseen.getData()).tolist() == [[8.0, 8.0]]
            assert window.maps.line.meaning.isVisible()
        else:
            shoot(window, "live_not_seen_grid")
            assert np.isnan(window.maps.grid_pulse.image.image[0, 1])
            assert np.column_stack(window.maps.grid_pulse.unseen.getData()).tolist() == [[8.0, 0.0]]


def test_a_click_on_a_place_shows_its_signal(make_run: Make, shoot: Shoot) -> None:
    """And a second one the latest again; what is shown is that station's, thinned as it may be."""
    window = window_on(make_run())
    shoot(window, "live_not_chosen")
    area = window.maps.line.beat
    spot = area.getPlotItem().vb.mapViewToScene(QPointF(32.4, 1.0))
    title = window.traces.trace.getPlotItem().titleLabel

    def click() -> None:
        QTest.mouseClick(area.viewport(), LEFT, pos=area.mapFromScene(spot))
        QTest.qWait(QApplication.doubleClickInterval() + 50)
        window.frame()

    click()
    shoot(window, "live_chosen")
    assert title.text == "Signal of station 8 at x = 32 mm; click it again for the latest"
    assert "at station 8" in window.traces.beat.getPlotItem().titleLabel.text
    stress_kpa = window.traces.curves[0].getData()[1]
    assert stress_kpa.max() == pytest.approx(7.71, abs=0.01)
    click()
    assert title.text.startswith("Signal of virtual")


def test_each_of_several_curves_is_named(make_run: Make, shoot: Shoot) -> None:
    def names(window: RunWindow) -> list[str]:
        shoot(window, "live_names")
        return [label.text for _, label in window.traces.names.items]

    assert names(window_on(make_run(columns=1))) == []
    assert names(window_on(make_run(columns=1, taxels=3))) == ["force0", "force1", "force2"]
    assert len(names(window_on(make_run(columns=1, taxels=28)))) == 3


def test_a_replay_plays_when_it_opens_and_space_pauses_it(make_run: Make) -> None:
    application()
    events = make_run()
    for opened in (
        lambda: ReplayWindow(Path("a.run"), events),
        lambda: PairWindow(("a", "b"), (events, events)),
    ):
        window: Any = opened()
        window.show()
        window.frame()
        QTest.qWait(100)
        assert 0 < window.bar.now_s < 5
        window.bar.play.setFocus()
        QTest.keyClick(window.bar.play, Qt.Key.Key_Space)
        assert not window.bar.playing
        at_s = window.bar.now_s
        QTest.qWait(100)
        assert window.bar.now_s == at_s
        window.close()
        window.deleteLater()
        QApplication.sendPostedEvents(window, QEvent.Type.DeferredDelete.value)


def test_replay_follows_slider_speed_and_play(make_run: Make, shoot: Shoot) -> None:
    application()
    window = ReplayWindow(Path("a.run"), make_run())
    QTest.mouseClick(window.bar.play, LEFT)
    window.bar.slider.setValue(500)
    shoot(window, "replay")
    half = set(window.state().complete)
    assert 6 <= len(half) <= 8
    window.bar.slider.setValue(100)
    assert window.state().complete < half
    window.bar.speed.setCurrentIndex(SPEEDS.index(100.0))
    QTest.mouseClick(window.bar.play, LEFT)
    assert window.bar.playing
    QTest.qWait(500)
    assert len(window.state().complete) == 15
    assert not window.bar.playing


@pytest.mark.parametrize("length_s", [40.3, 40.2969999999973])
def test_the_slider_at_its_end_is_the_end_of_the_run(length_s: float) -> None:
    application()
    bar = TimeBar(length_s)
    bar.slider.setValue(bar.slider.maximum())
    assert bar.now_s == length_s


@pytest.mark.parametrize("surface_mm", [None, 12.0])
def test_the_finger_is_drawn_over_the_surface_that_the_scan_has(
    surface_mm: float | None, make_run: Make
) -> None:
    """Held 2.5 mm deep, however high the surface lies in the scan's frame."""
    events, state, panel = make_run(columns=1), ViewState(), BodyPanel()
    started = events[0]
    assert isinstance(started, RunStarted)
    if surface_mm is not None:
        started.config["plan"]["surface_mm"] = [surface_mm]
    for event in events:
        if isinstance(event, Samples) and event.device == "stage":
            event.block.values[:, 2] += 1e-3 * (surface_mm or 0.0)
        state.update(event)
        if len(state.hold()[0]) > 50:
            break
    panel.show_state(state)
    assert np.min(panel.finger.getData()[1]) == pytest.approx(16.83 - 2.5)


def test_a_grid_shows_the_section_of_the_row_that_is_pressed(make_run: Make) -> None:
    events = make_run(rows=2, columns=2)  # 4 mm apart
    started = events[0]
    assert isinstance(started, RunStarted)
    started.config["scene"]["inclusion"][0]["path"] = [[0.0, 20.0, 12.66], [4.0, 40.0, 12.66]]
    state, panel, middles = ViewState(), BodyPanel(), []
    for event in events:
        state.update(event)
        if isinstance(event, StationEnded):
            panel.show_state(state)
            vessel = panel.area.getPlotItem().listDataItems()[-1]
            middles.append(float(np.mean([vessel.xData.min(), vessel.xData.max()])))
    assert middles == pytest.approx([20.0, 20.0, 40.0, 40.0], abs=0.01)


def test_where_the_section_is_unknown_the_surface_reaches_under_the_whole_finger(
    make_run: Make,
) -> None:
    events, state, panel = make_run(), ViewState(), BodyPanel()
    started = events[0]
    assert isinstance(started, RunStarted)
    started.config["scene"] = None
    for event in events:
        state.update(event)
        if isinstance(event, StationEnded):
            panel.show_state(state)
            (surface,) = (
                c for c in panel.area.getPlotItem().listDataItems() if c is not panel.finger
            )
            finger_mm = panel.finger.getData()[0]
            assert surface.xData.min() <= finger_mm.min() + 1e-6
            assert surface.xData.max() >= finger_mm.max() - 1e-6


def test_seeking_forwards_and_backwards_gives_the_same(make_run: Make) -> None:
    player = Player(make_run())
    straight = dict(player.seek(10.0).maps)
    assert player.seek(player.length_s).finish is Finish.COMPLETED
    back = player.seek(10.0)
    assert back.maps == straight
    assert back.finish is None


def test_two_runs_share_one_scale(make_run: Make, shoot: Shoot) -> None:
    application()
    window = PairWindow(("healthy.run", "stenotic.run"), (make_run(rows=4), make_run(rows=2)))
    window.bar.slider.setValue(1000)
    shoot(window, "replay_pair")
    assert window.panels[0].grid.bar.levels() == window.panels[1].grid.bar.levels()


def test_a_frame_reads_no_longer_than_its_budget(make_run: Make) -> None:
    endless = (event for _ in iter(int, 1) for event in make_run())
    follower = Follower(endless)
    follower()
    seen = follower.state.now_s
    assert np.isfinite(seen)
    assert Follower(iter([None]))().started_utc == ""


def test_a_window_that_lags_reads_on_and_says_so(
    make_run: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where others have the processor, a frame's time by the clock was over before it had read."""
    clock_s = itertools.count(0.0, 1.0)  # a second passes whenever it is looked at
    monkeypatch.setattr("probe.gui.app.perf_counter", lambda: next(clock_s))
    running = [event for event in make_run() if not isinstance(event, RunEnded)]
    follower = Follower(itertools.chain(running[:10], [None], itertools.cycle(running)))
    assert "not the latest" not in progress_line(follower())
    before = follower().seen
    state = follower()
    assert state.seen > before + 1
    assert "not the latest" in progress_line(state)


def test_a_run_that_has_only_begun_is_drawn() -> None:
    """In real time the first event comes long before the first phase."""
    window = window_on([RunStarted(5.0, "2026-01-01T00:00:00+00:00", {}, {"stage": ()})])
    window.frame()
    assert "0 of 0 stations" in window.side.progress.text()


def test_what_has_not_changed_is_not_drawn_again(
    make_run: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    window, drawn = window_on(make_run()), list[object]()
    monkeypatch.setattr(window.traces, "show_state", drawn.append)
    for _ in range(5):
        window.frame()
    assert len(drawn) == 1
    window.state().update(Note(1.0, "info", "stage", "something new"))
    window.frame()
    assert len(drawn) == 2


def test_a_finished_run_is_looked_at_once_a_second(make_run: Make) -> None:
    asked = 0

    def events() -> Any:
        nonlocal asked
        yield from make_run()
        while True:
            asked += 1
            yield None

    follower = Follower(events())
    while follower().finish is None:
        pass
    before = asked
    for _ in range(50):
        follower()
    assert asked - before <= 1
