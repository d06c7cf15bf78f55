"""The entries of `palpate live` and `palpate replay`; each call is a process of its own."""

import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from time import perf_counter, thread_time
from typing import Any

from probe.core.errors import RunFileError
from probe.core.events import Event, Finish
from probe.gui.replay import PairWindow, ReplayWindow
from probe.gui.state import ViewState
from probe.gui.style import application, until_closed
from probe.gui.window import Found, RunWindow
from probe.scan.remote import ask

READ_BUDGET_S = 0.015
"""Of the processor, in a frame of 33 ms: by the clock a busy machine would only draw."""
FINISHED_POLL_S = 1.0
"""A finished run is looked at once a second: it may be resumed."""
AFTER_THE_SCAN = 5
"""Nice value of the window: drawing and detection take only what the scan leaves."""


class Follower:
    """Takes events into a state for at most `READ_BUDGET_S` per frame.

    ``events`` yields None whenever nothing new is there yet. Falling behind costs only
    lateness, which the state then says: the events stay in the run file until they are read.
    """

    def __init__(self, events: Iterator[Event | None]) -> None:
        self._events = events
        self._again_s = 0.0
        self._latest_s = perf_counter()  # when the last event was the latest
        self.state = ViewState()

    def __call__(self) -> ViewState:
        now = perf_counter()
        if self.state.finish is not None and now < self._again_s:
            return self.state
        self._again_s = now + FINISHED_POLL_S
        until = thread_time() + READ_BUDGET_S
        while thread_time() < until:
            try:
                event = next(self._events, None)
            except RunFileError as error:  # garbled since it was opened: what was seen stays
                self.state.trouble, event = str(error), None
            if event is None:
                self._latest_s = now
                break
            self.state.update(event)
        self.state.late_s = now - self._latest_s
        return self.state


class Detective:
    """Runs detection beside the window whenever another station is complete, and at the end.

    What an open row may still overturn is undecided until the run has ended.
    """

    def __init__(self, run_path: Path, state: ViewState) -> None:
        self._run_path, self._state = run_path, state
        self._looked_at: tuple[int, Finish | None] = (0, None)
        self._worker: threading.Thread | None = None
        self.latest: Mapping[str, Any] | str | None = None

    def __call__(self) -> Mapping[str, Any] | str | None:
        known = (len(self._state.complete), self._state.finish)
        idle = self._worker is None or not self._worker.is_alive()
        if idle and known[0] and known != self._looked_at:
            self._looked_at = known
            self._worker = threading.Thread(target=self._look, daemon=True)
            self._worker.start()
        return self.latest

    def _look(self) -> None:
        self.latest = judged(self._run_path)


def judged(run_path: Path) -> Mapping[str, Any] | str:
    """The JSON of what a run, as far as it is stored, means, or why that cannot be said."""
    from probe.detection import detect  # here: a window without detection opens faster
    from probe.storage.run import open_run

    try:
        return detect(open_run(run_path).recording()).as_json()
    except RunFileError as error:
        return str(error)
    except Exception as error:  # noqa: BLE001 - the window says it: nobody sees a thread end
        return f"{type(error).__name__}: {error}"


def judged_once(run_path: Path) -> Found:
    """The finding of a stored run, looked for beside the window from now on; None until then."""
    found: list[Mapping[str, Any] | str] = []
    threading.Thread(target=lambda: found.append(judged(run_path)), daemon=True).start()
    return lambda: found[0] if found else None


def run_live(run_path: Path) -> int:
    """Follow a run file, growing or finished, until the window is closed; the exit status."""
    from probe.storage.run import follow

    with suppress(AttributeError):  # not on Windows
        os.nice(AFTER_THE_SCAN)
    application()
    follower = Follower(follow(run_path))
    window = RunWindow(
        run_path,
        follower,
        Detective(run_path, follower.state),
        lambda word: ask(run_path, word),
    )
    return until_closed(window)


def run_replay(run_path: Path, beside: Path | None = None) -> int:
    """Replay one run, or two side by side, until the window is closed; the exit status."""
    from probe.storage.run import open_run

    application()
    events = list(open_run(run_path).events())
    window: ReplayWindow | PairWindow
    if beside is None:
        window = ReplayWindow(run_path, events, judged_once(run_path))
    else:
        other = list(open_run(beside).events())
        found = judged_once(run_path), judged_once(beside)
        window = PairWindow((run_path.name, beside.name), (events, other), found)
    return until_closed(window)
