"""A stored run again, at any speed; two runs side by side on one colour scale."""

import bisect
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import (
    QComboBox,
    QGridLayout,
    QLabel,
    QPushButton,
    QSlider,
    QVBoxLayout,
    QWidget,
)

from probe.core.events import Event, Samples
from probe.core.finding_words import simulated_words
from probe.gui.controls import SpaceBar
from probe.gui.maps import MapPanel, common_levels
from probe.gui.picture import Picture
from probe.gui.state import ViewState
from probe.gui.style import box, open_at, text
from probe.gui.window import FRAME_MS, Found, RunWindow, judge

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 20.0, 100.0)
SLIDER_STEPS = 1000


class Player:
    """Events on a time axis that starts at 0. Raises `ValueError` for a run without events."""

    def __init__(self, events: Sequence[Event]) -> None:
        if not events:
            raise ValueError("the run holds no events; `palpate verify` says what is in it")
        self._events = events
        self._at_s: list[float] = []
        latest = first = _time(events[0])
        for event in events:
            latest = max(latest, _time(event))
            self._at_s.append(latest - first)
        self.length_s = self._at_s[-1]
        self._next = 0
        self.state = ViewState()

    def seek(self, at_s: float) -> ViewState:
        """The state at ``at_s`` after the start; going back replays from the start."""
        goal = bisect.bisect_right(self._at_s, at_s)
        if goal < self._next:
            self.state, self._next = ViewState(), 0
        for event in self._events[self._next : goal]:
            self.state.update(event)
        self._next = goal
        return self.state


class TimeBar(QWidget):
    """Play, speed and a slider; ``now_s`` advances while it plays, as it does from the start.

    The space bar plays and pauses, whatever has the focus.
    """

    def __init__(self, length_s: float) -> None:
        super().__init__()
        self.length_s, self.now_s, self.playing = length_s, 0.0, True
        self._seen_s: float | None = None  # the first frame may come long after this
        self._space = SpaceBar(self.toggle, self)
        self.play = QPushButton("&Pause")
        self.play.clicked.connect(self.toggle)
        self.speed = QComboBox()
        self.speed.addItems([f"{s:g} x" for s in SPEEDS])
        self.speed.setCurrentIndex(SPEEDS.index(1.0))
        self.speed.setAccessibleName("speed")
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setRange(0, SLIDER_STEPS)
        self.slider.setAccessibleName("time")
        self.slider.valueChanged.connect(self._moved)
        self.clock = QLabel()
        layout = box(self, self.play, self.speed, self.slider, self.clock, across=True)
        layout.setStretchFactor(self.slider, 1)

    def toggle(self) -> None:
        """Play or pause; at the end, play from the start."""
        if not self.playing and self.now_s >= self.length_s:
            self.now_s = 0.0
        self.playing = not self.playing
        self.play.setText("&Pause" if self.playing else "&Play")

    def tick(self) -> float:
        """Advance by the time that passed; returns ``now_s``."""
        seen_s = time.monotonic()
        if self.playing and self._seen_s is not None:
            self.now_s += (seen_s - self._seen_s) * SPEEDS[self.speed.currentIndex()]
            if self.now_s >= self.length_s:
                self.now_s = self.length_s
                self.toggle()
            self.slider.blockSignals(True)
            self.slider.setValue(round(SLIDER_STEPS * self.now_s / max(self.length_s, 1e-9)))
            self.slider.blockSignals(False)
        self._seen_s = seen_s
        self.clock.setText(f"{self.now_s:.1f} s of {self.length_s:.1f} s")
        return self.now_s

    def _moved(self, step: int) -> None:
        self.now_s = self.length_s * (step / SLIDER_STEPS)  # at the last step exactly the end


class ReplayWindow(RunWindow):
    """One run with a time bar below; what the whole of it means is said at its end."""

    def __init__(
        self, run_path: Path, events: Sequence[Event], finding: Found = lambda: None
    ) -> None:
        player = Player(events)
        self.bar = TimeBar(player.length_s)
        super().__init__(run_path, lambda: player.seek(self.bar.tick()), finding)
        self.setWindowTitle(f"palpate replay: {run_path.name}")
        self.column.addWidget(self.bar)

    def said(self, state: ViewState) -> Mapping[str, Any] | None:
        return said_at_the_end(state)


class PairWindow(QWidget):
    """Two runs at the same time after their starts; both maps have the same scale.

    ``found`` are their findings, whose pulses are drawn.
    """

    def __init__(
        self,
        names: tuple[str, str],
        runs: tuple[Sequence[Event], Sequence[Event]],
        found: tuple[Found, Found] = (lambda: None, lambda: None),
    ) -> None:
        super().__init__()
        self.setWindowTitle(f"palpate: {names[0]} beside {names[1]}")
        self.players = tuple(Player(events) for events in runs)
        self.panels = (MapPanel(), MapPanel())
        self.pictures = tuple(Picture("map", panel) for panel in self.panels)
        self.heads = (text(names[0]), text(names[1]))
        self.names, self.found = names, found
        self.bar = TimeBar(max(p.length_s for p in self.players))
        sides = QGridLayout()
        sides.setRowStretch(1, 1)
        for column, (head, picture) in enumerate(zip(self.heads, self.pictures, strict=True)):
            sides.addWidget(head, 0, column)
            sides.addWidget(picture, 1, column)
        layout = QVBoxLayout(self)
        layout.addLayout(sides, 1)
        layout.addWidget(self.bar)
        open_at(self, 1280, 700)
        self.timer = QTimer(self)
        self.timer.timeout.connect(self.frame)
        self.timer.start(FRAME_MS)

    def frame(self) -> None:
        """Draw both runs at the bar's time."""
        now_s = self.bar.tick()
        states = tuple(player.seek(now_s) for player in self.players)
        for state, found in zip(states, self.found, strict=True):
            judge(state, found())
        levels = common_levels(states)
        for name, head, panel, picture, state in zip(
            self.names, self.heads, self.panels, self.pictures, states, strict=True
        ):
            said = name, simulated_words(state.simulated), state.unjudged
            head.setText(" — ".join(filter(None, said)))
            picture.draw(partial(panel.show_state, state, said_at_the_end(state), levels))


def said_at_the_end(state: ViewState) -> Mapping[str, Any] | None:
    """What the whole run means; None before its end."""
    return None if state.finish is None else state.finding


def _time(event: Event) -> float:
    """When an event happened; a block is known at its last sample, an empty one at no time."""
    if isinstance(event, Samples):
        return float(event.block.time_s[-1]) if len(event.block.time_s) else float("-inf")
    return event.time_s
