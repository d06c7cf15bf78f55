"""What a window says of a run is what the run means now, also when it has just ended."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QWidget
from run_windows import state_of

from probe.config.rig import Rig
from probe.core.errors import RunFileError
from probe.core.events import Event
from probe.gui.app import Detective, Follower, judged, judged_once, run_live, run_replay
from probe.gui.replay import ReplayWindow
from probe.gui.style import application, until_closed
from probe.gui.window import RunWindow
from probe.scan.session import scan
from probe.storage.run import open_run
from probe.storage.writer import create_store


@pytest.fixture
def few(tmp_path: Path, winkler: Any) -> Path:
    """A run of three stations."""
    rig = Rig.model_validate({"scan": {"start_mm": 28, "stations": 3}})
    return scan(rig, "TIHA", tmp_path, seed=1, respond=winkler).path


def said(look: Any) -> Any:
    """What detection says when it has come to its end."""
    look()
    look._worker.join()
    return look()["finding"]


def test_a_finding_is_looked_at_again_when_the_run_has_ended(tmp_path: Path, winkler: Any) -> None:
    whole = scan(Rig.model_validate({}), "TI", tmp_path, seed=1, respond=winkler).path
    *events, end = open_run(whole).events()
    with create_store(tmp_path / "live.run") as store:
        for event in events:
            store(event)
        store.flush()
        state = state_of(events)
        look = Detective(tmp_path / "live.run", state)
        assert said(look) == "undecided"
        store(end)
        store.flush()
        state.update(end)
        assert said(look) == "nothing"


def test_a_window_goes_on_where_its_run_cannot_be_read_and_says_why(
    tmp_path: Path, few: Path
) -> None:
    state, path = state_of(open_run(few).events()), tmp_path / "live.run"
    look = Detective(path, state)
    application()
    window = RunWindow(path, lambda: state, look)
    for content, says in (
        (None, "no such run file"),
        (b"garbled" * 999, "damaged"),
        (few.read_bytes(), ""),
    ):
        if content is not None:
            path.write_bytes(content)
        state.complete.add(-1 if content is None else len(content))  # so it is looked at again
        window.frame()
        look._worker.join()
        window.frame()
        shown = window.side.finding.text()
        assert (says in shown, "No newer one" in shown) == (True, bool(says)), shown
    window.close()


def test_a_run_that_is_garbled_while_it_is_watched_is_said_with_what_was_seen(few: Path) -> None:
    def events() -> Iterator[Event]:
        yield from list(open_run(few).events())[:20]
        raise RunFileError(f"{few}: damaged")

    follower = Follower(events())
    for _ in range(3):
        state = follower()
    assert (state.started_utc != "", state.trouble) == (True, f"{few}: damaged")
    application()
    findings = iter(["no such run file", judged(few), "no such run file"])
    window = RunWindow(few, follower, lambda: next(findings))
    window.timer.stop()
    for unjudged in (True, False, True):  # a finding that ends later hides no trouble of reading
        window.frame()
        shown = window.side.finding.text()
        assert f"Nothing newer can be read: {few}: damaged" in shown
        assert ("No newer one can be made: no such run file" in shown) == unjudged
    window.close()


def test_a_replay_draws_what_was_measured_and_says_the_finding_at_its_end(few: Path) -> None:
    events = list(open_run(few).events())
    application()
    window = ReplayWindow(few, events, judged_once(few))
    while (found := window.finding()) is None:
        pass
    for place, says in ((0.99, False), (1.0, True), (0.99, False)):  # played again from the start
        window.bar.now_s = place * window.bar.length_s
        window.frame()
        assert (window.side.finding.text() != "Finding: none yet") == says
        first = found["stations"][0]
        level_pa, pulse_pa, below_pa = window.state().maps[0]
        assert level_pa == first["baseline_pa"]
        seen = first["pulse_below_pa"] is None
        assert (pulse_pa if seen else below_pa) == first["pulse_pa" if seen else "pulse_below_pa"]
        assert np.isnan(below_pa if seen else pulse_pa)
    window.close()


@pytest.fixture
def _signals_as_they_were() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("_signals_as_they_were")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("entry", [run_live, run_replay])
def test_a_signal_closes_a_window(
    few: Path, monkeypatch: pytest.MonkeyPatch, entry: Callable[[Path], int],
    number: signal.Signals,
) -> None:  # fmt: skip
    monkeypatch.setattr("os.nice", lambda _: 0)  # of a window; this process goes on
    application()
    QTimer.singleShot(300, lambda: os.kill(os.getpid(), number))
    assert entry(few) == 0


@pytest.mark.usefixtures("_signals_as_they_were")
def test_no_other_thread_collects_what_may_be_a_widget(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("probe.gui.style.COLLECT_MS", 20)
    collected_by: list[threading.Thread] = []

    class Cycle:
        def __init__(self) -> None:
            self.own = self

        def __del__(self) -> None:
            collected_by.append(threading.current_thread())

    ended = threading.Event()

    def detect_beside() -> None:
        while not ended.is_set():
            _ = [Cycle() for _ in range(2000)]  # as many as make Python collect

    beside = threading.Thread(target=detect_beside)

    def end() -> None:
        ended.set()
        beside.join()
        application().quit()

    application()
    QTimer.singleShot(50, beside.start)
    QTimer.singleShot(350, end)
    until_closed(QWidget())
    assert set(collected_by) == {threading.main_thread()}
