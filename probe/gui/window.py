"""The window on one run: map, section, traces and the side column, redrawn 30 times a second."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QSplitter, QStackedWidget, QVBoxLayout, QWidget

from probe.gui.body import BodyPanel
from probe.gui.controls import Ask, SidePanel
from probe.gui.maps import MapPanel
from probe.gui.picture import Picture
from probe.gui.state import ViewState
from probe.gui.style import PLOT_PX, open_at, scale, scrolling, text
from probe.gui.traces import TracePanel

FRAME_MS = 33
NARROW_PX = 1000
"""Of a window below which plots have less than their titles beside each other."""
PLOTS = 5
"""One below the other, and what each needs for its axes and a curve."""

MAP_TITLE = "Tactile map (click a place)"

Found = Callable[[], Mapping[str, Any] | str | None]
"""The latest JSON of a run's detection, or why there is none; None until detection has ended."""


def judge(state: ViewState, finding: Mapping[str, Any] | str | None) -> None:
    """Let ``state`` know a new ``finding``, or why there is none."""
    if isinstance(finding, str):
        state.unjudged = finding
    elif finding is not None and finding is not state.finding:
        state.judge(finding)


class RunWindow(QWidget):
    """Shows ``state()``; ``finding()`` is the latest JSON of detection, or None.

    ``state`` is called once a frame, on the window's thread, and may update itself.
    """

    def __init__(
        self,
        run_path: Path,
        state: Callable[[], ViewState],
        finding: Found = lambda: None,
        ask: Ask | None = None,
    ) -> None:
        super().__init__()
        self.setWindowTitle(f"palpate: {run_path.name}")
        self.state, self.finding = state, finding
        self._drawn: tuple[int, int] | None = None
        self.maps, self.body, self.traces = MapPanel(MAP_TITLE), BodyPanel(), TracePanel()
        self.maps.setToolTip("Click a place to see its signal; click it again for the latest.")
        self.maps.choice.connect(self._redraw)
        self.side = SidePanel(ask)
        self.empty = text(
            f"Waiting for {run_path}\n\nStart a scan with  palpate scan --live\n"
            "or open a finished run with  palpate replay RUN --live",
            "empty",
            centred=True,
        )
        self.pages = QStackedWidget()
        self.pages.addWidget(self.empty)
        self.pages.addWidget(self._panels())
        self.column = QVBoxLayout(self)
        self.column.setContentsMargins(6, 6, 6, 6)
        self.column.addWidget(self.pages, 1)
        open_at(self, 1280, 700)
        self.timer = QTimer(self)
        self.timer.timeout.connect(self.frame)
        self.timer.start(FRAME_MS)

    def _panels(self) -> QSplitter:
        left = QSplitter(Qt.Orientation.Vertical)
        self.pictures = Picture("map", self.maps), Picture("section", self.body)
        for picture in self.pictures:
            left.addWidget(picture)
        left.setSizes([420, 240])  # shares of what the window has
        self.plots = QSplitter(Qt.Orientation.Horizontal)
        self.plots.addWidget(left)
        self.plots.addWidget(self.traces)
        self.plots.setSizes([480, 460])
        whole = QSplitter(Qt.Orientation.Horizontal)
        whole.addWidget(scrolling(self.plots))
        whole.addWidget(self.side)
        whole.setSizes([940, 320])
        whole.setStretchFactor(0, 1)
        whole.setCollapsible(1, False)  # it has the button that stops
        return whole

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Beside each other the plots of a narrow window would be cut: one below the other, they
        are scrolled."""
        super().resizeEvent(event)
        narrow = self.width() < NARROW_PX * scale()
        self.plots.setOrientation(Qt.Orientation.Vertical if narrow else Qt.Orientation.Horizontal)
        self.plots.setMinimumHeight(round(PLOTS * PLOT_PX * scale()) if narrow else 0)

    def said(self, state: ViewState) -> Mapping[str, Any] | None:
        """The finding that is put into words, and drawn."""
        return state.finding

    def frame(self) -> None:
        """Draw what is known now, if it is not what is drawn."""
        state = self.state()
        started = bool(state.started_utc)
        self.pages.setCurrentIndex(int(started))
        if not started:
            if state.trouble:
                self.empty.setText(state.trouble)
            return
        judge(state, self.finding())
        said = self.said(state)
        self.side.show_state(state, said)
        drawn = (id(state), state.seen)
        if drawn == self._drawn:  # an idle window costs next to nothing
            return
        self._drawn = drawn
        maps, body = self.pictures
        maps.draw(lambda: self.maps.show_state(state, said))
        body.draw(lambda: self.body.show_state(state))
        self.traces.chosen = self.maps.chosen
        self.traces.show_state(state)

    def _redraw(self) -> None:
        """At the next frame, though no event has come."""
        self._drawn = None
