"""The column beside the maps: finding, devices, time left, and the controls, space bar to stop."""

from collections.abc import Callable, Mapping
from typing import Any

from PySide6.QtCore import QCoreApplication, QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QGridLayout, QPushButton, QVBoxLayout, QWidget

from probe.core.events import Finish, Phase
from probe.core.finding_words import headline, object_line, remarks, simulated_words
from probe.core.places import presses_all
from probe.gui.state import ViewState
from probe.gui.style import box, scrolling, text
from probe.report.look import GREEN, VERMILLION
from probe.scan.remote import NotRunning

LATE_S = 1.0
"""From here on a window that lags says so: what it shows is no longer what happens now."""

Ask = Callable[[str], None]
"""Passes pause, resume, abort or stop to the scan; raises `NotRunning`."""


class SpaceBar(QObject):
    """Calls ``act`` on every press of the space bar, whatever has the focus.

    A shortcut would not do: a focused button takes the space bar for itself.
    """

    def __init__(self, act: Callable[[], None], parent: QObject) -> None:
        super().__init__(parent)
        self._act = act
        app = QCoreApplication.instance()
        assert app is not None  # a widget cannot exist without one
        app.installEventFilter(self)

    def eventFilter(self, _watched: QObject, event: QEvent) -> bool:
        if event.type() is not QEvent.Type.KeyPress or not isinstance(event, QKeyEvent):
            return False
        if event.key() != Qt.Key.Key_Space or event.isAutoRepeat():
            return False
        self._act()
        return True


class SidePanel(QWidget):
    """Without ``ask`` (a replay) there are no controls."""

    def __init__(self, ask: Ask | None) -> None:
        super().__init__()
        self._ask = ask
        layout = QVBoxLayout(self)
        self.simulated, self.fault = text(look="simulated"), text(look="fault")
        self.finding, self.objects = text(look="finding"), text(look="objects")
        self.progress, self.devices = text(look="progress"), text(look="devices")
        self.answer = text(look="answer")
        for each in (self.simulated, self.fault):  # never scrolled away
            layout.addWidget(each)
        words = QWidget()
        box(words, self.finding, self.objects, self.progress, self.devices).addStretch(1)
        layout.addWidget(scrolling(words), 1)
        layout.addWidget(self.answer)
        self.buttons: dict[str, QPushButton] = {}
        if ask is not None:
            layout.addLayout(self._controls())
        self.simulated.hide()
        self.fault.hide()

    def _controls(self) -> QGridLayout:
        grid = QGridLayout()
        for column, word in enumerate(("pause", "resume", "abort")):
            self._button(word, f"&{word.capitalize()}")
            grid.addWidget(self.buttons[word], 0, column)
        self._button("stop", "STOP  (space bar)")
        grid.addWidget(self.buttons["stop"], 1, 0, 1, 3)
        self._space = SpaceBar(lambda: self.press("stop"), self)
        return grid

    def _button(self, word: str, words: str) -> None:
        button = QPushButton(words)
        button.setObjectName(word)
        button.setAccessibleName(word)
        button.clicked.connect(lambda: self.press(word))
        self.buttons[word] = button

    def press(self, word: str) -> None:
        """Ask the scan, and say whether it heard."""
        if self._ask is None:
            return
        try:
            self._ask(word)
            self.answer.setText(f"asked the scan to {word}")
        except NotRunning as why:
            self.answer.setText(str(why))

    def show_state(self, state: ViewState, finding: Mapping[str, Any] | None) -> None:
        words = simulated_words(state.simulated)
        self.simulated.setVisible(bool(words))
        self.simulated.setText(words)
        failed = state.finish is Finish.FAULTED
        self.fault.setVisible(bool(state.faults) or failed)
        if state.faults:
            self.fault.setText(state.faults[-1].words)
        elif failed:
            self.fault.setText(state.reason)
        found = f"Finding: {headline(finding)}" if finding else "Finding: none yet"
        if state.unjudged:
            found = f"{found}\nNo newer one can be made: {state.unjudged}"
        if state.trouble:
            found = f"{found}\nNothing newer can be read: {state.trouble}"
        self.finding.setText(found)
        objects = [object_line(one) for one in finding["objects"]] if finding else []
        self.objects.setText("\n".join([*objects, *remarks(finding)]) if finding else "")
        self.progress.setText(progress_line(state))
        rows = (
            f"<span style='color:{GREEN if s in ('ok', 'closed') else VERMILLION}'>&#9679;</span> "
            f"{name}: {s}"
            + (f", {state.traces[name].lost} lost" if state.traces[name].lost else "")
            for name, s in state.device_states().items()
        )
        self.devices.setText("<br>".join(rows))
        running = state.finish is None
        for word in ("pause", "resume", "abort"):
            if word in self.buttons:
                self.buttons[word].setEnabled(running)
        if "resume" in self.buttons and running:
            self.buttons["resume"].setEnabled(
                state.phase is Phase.PAUSED or "pause" in self.answer.text()
            )


def progress_line(state: ViewState) -> str:
    """Stations done, phase and time left."""
    at_most = "" if presses_all(state.config) else "at most "
    done = f"{len(state.complete)} of {at_most}{len(state.plan)} stations complete"
    if state.late_s > LATE_S:
        done = f"not the latest: the run is still being read\n{done}"
    if state.finish is not None:
        return f"{done}\n{state.finish}: {state.reason}"
    left = state.time_left_s()
    station = "" if state.station is None else f", station {state.station + 1}"
    time = (
        "time left: known after the first station"
        if left is None
        else f"time left: {at_most}{left:.0f} s"
    )
    return f"{done}\n{state.phase}{station}\n{time}"
