"""A running scan's window: every control is clicked, every state drawn, on any screen."""

import itertools
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import QRect, QSize, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLabel
from run_windows import FINDING, LEFT, Make, Shoot, state_of, window_on

from probe.core.events import Finish, Note, PhaseEntered, RunEnded, RunStarted
from probe.gui.app import Follower
from probe.gui.controls import progress_line
from probe.gui.replay import PairWindow
from probe.gui.style import application
from probe.gui.window import RunWindow
from probe.report.look import PHASE_COLOURS
from probe.scan.remote import NotRunning


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


@pytest.mark.parametrize("times", [1.0, 2.0])
def test_a_window_opens_as_much_larger_as_its_text(
    times: float, make_run: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    application(times)
    wide = SimpleNamespace(availableGeometry=lambda: QRect(0, 0, 3840, 2160))
    monkeypatch.setattr(QApplication, "primaryScreen", lambda: wide)
    assert window_on(make_run(columns=1)).width() == 1280 * times
    pair = PairWindow(("a", "b"), (make_run(columns=1), make_run(columns=1)))
    assert pair.width() == 1280 * times
    wide.availableGeometry = lambda: QRect(0, 0, 1024, 768)
    assert window_on(make_run(columns=1)).size() == QSize(1024, min(700 * round(times), 768))


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
    begun, *events = make_run(columns=2)
    plan = {"stations": [[n, None, None] for n in range(2)]}
    begun = replace(begun, config={"plan": plan, "face_mm2": 100.0})
    window = window_on([begun, *(e for e in events if not isinstance(e, PhaseEntered))])
    shoot(window, "live_without_places")
    assert window.maps.currentWidget() is window.maps.unknown
    assert "unknown" in window.maps.unknown.text()
    assert len(window.traces.curves[0].getData()[0]) > 100
    change_pa = window.traces.beat_curve.getData()[1]
    assert len(change_pa) > 10


def test_each_of_several_curves_is_named(make_run: Make, shoot: Shoot) -> None:
    def names(window: RunWindow) -> list[str]:
        shoot(window, "live_names")
        return [label.text for _, label in window.traces.names.items]

    assert names(window_on(make_run(columns=1))) == []
    assert names(window_on(make_run(columns=1, taxels=3))) == ["force0", "force1", "force2"]
    assert len(names(window_on(make_run(columns=1, taxels=28)))) == 3


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


SMALL = (800, 600)


@pytest.mark.parametrize("rows", [1, 5])
def test_nothing_is_cut_on_a_small_screen(rows: int, make_run: Make, shoot: Shoot) -> None:
    state = state_of(make_run(rows))
    long = FINDING | {"reason": "of two objects " * 40}
    window = RunWindow(Path("a.run"), lambda: state, lambda: long, lambda _: None)
    shoot(window, f"small-{rows}", SMALL)
    area = window.plots.parentWidget()
    assert window.plots.width() <= area.width()
    shown = [one for one in window.plots.findChildren(pg.GraphicsView) if one.isVisible()]
    assert len(shown) >= 4
    for one in shown:
        assert one.width() <= area.width()
        drawn = one.scene().itemsBoundingRect()
        parts = [item for item in one.scene().items() if isinstance(item, pg.PlotItem)]
        for part in parts:
            assert part.sceneBoundingRect().right() <= one.width() + 1, drawn
            assert part.sceneBoundingRect().bottom() <= one.height() + 1, drawn
    for label in (window.side.finding, window.side.objects, window.side.progress):
        assert label.height() >= label.heightForWidth(label.width())
    assert window.side.buttons["stop"].geometry().bottom() < SMALL[1]


def test_a_wide_window_has_its_plots_beside_each_other(make_run: Make, shoot: Shoot) -> None:
    state = state_of(make_run())
    window = RunWindow(Path("a.run"), lambda: state)
    shoot(window, "wide")
    assert window.plots.orientation() is Qt.Orientation.Horizontal
    assert window.plots.height() <= window.plots.parentWidget().height()
