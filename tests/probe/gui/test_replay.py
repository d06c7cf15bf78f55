"""Runs that are replayed, one or two beside each other."""

from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QEvent, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication
from run_windows import FINDING, LEFT, Make, Shoot, measured

from probe.core.events import Finish
from probe.gui.replay import SPEEDS, PairWindow, Player, ReplayWindow, TimeBar


def test_a_replay_draws_what_was_found_at_its_end(make_run: Make) -> None:
    one = {"kind": "artery", "course_mm": [[30.0, 0.0], [32.0, 4.0]], "position_mm": 31.0}
    found = FINDING | {"objects": [one | {"confidence": 0.9}], "stations": measured(15)}
    window = ReplayWindow(Path("a.run"), make_run(rows=3, columns=5), lambda: found)
    for step, drawn in ((500, 0), (1000, 1), (500, 0)):
        window.bar.slider.setValue(step)
        window.frame()
        assert len(window.maps.grid_pulse.courses) == drawn


def test_a_replay_plays_when_it_opens_and_space_pauses_it(make_run: Make) -> None:
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
    bar = TimeBar(length_s)
    bar.slider.setValue(bar.slider.maximum())
    assert bar.now_s == length_s


def test_seeking_forwards_and_backwards_gives_the_same(make_run: Make) -> None:
    player = Player(make_run())
    straight = dict(player.seek(10.0).maps)
    assert player.seek(player.length_s).finish is Finish.COMPLETED
    back = player.seek(10.0)
    assert back.maps == straight
    assert back.finish is None


def test_two_runs_share_one_scale(make_run: Make, shoot: Shoot) -> None:
    window = PairWindow(("healthy.run", "stenotic.run"), (make_run(rows=4), make_run(rows=2)))
    window.bar.slider.setValue(1000)
    shoot(window, "replay_pair")
    assert window.panels[0].grid.bar.levels() == window.panels[1].grid.bar.levels()
