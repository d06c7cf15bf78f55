"""A window of what every channel reads now; Space tares what it shows."""

from time import perf_counter

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QColor, QShortcut
from PySide6.QtWidgets import (
    QHeaderView,
    QPushButton,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from probe.checks.watch import HEAD, Reading, Watch
from probe.gui.style import application, open_at, text, until_closed

FRAME_MS = 100
AROUND_PX, ROW_PX = 150, 30
"""What lies around the rows of the table, and each of them."""
FAULT_INK = "#a40e26"


class WatchWindow(QWidget):
    """``watched`` is asked ten times a second."""

    def __init__(self, watched: Watch, title: str) -> None:
        super().__init__()
        self.setWindowTitle(f"palpate watch: {title}")
        self._watched = watched
        self.last: list[Reading] = watched.readings()
        self.table = QTableWidget(len(self.last), len(HEAD))
        self.table.setHorizontalHeaderLabels(HEAD)
        self.table.verticalHeader().hide()
        self.table.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self.table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.table.horizontalHeader().setStretchLastSection(True)
        self.tare = QPushButton("Tare what is shown (Space)")
        self.tare.clicked.connect(watched.tare)
        QShortcut(Qt.Key.Key_Space, self).activated.connect(watched.tare)
        layout = QVBoxLayout(self)
        if any(one.channel.simulated for one in self.last):
            layout.addWidget(text("SIMULATED channels are among these", "simulated"))
        self.fault = text(look="fault")
        layout.addWidget(self.fault)
        layout.addWidget(self.table)
        layout.addWidget(self.tare)
        open_at(self, 900, AROUND_PX + ROW_PX * len(self.last))
        self.frame()
        self.timer = QTimer(self)
        self.timer.timeout.connect(self.frame)
        self.timer.start(FRAME_MS)

    def frame(self) -> None:
        """Read, and show what was read."""
        self.last = self._watched.readings()
        faults = dict.fromkeys(one.fault for one in self.last if one.fault)
        self.fault.setVisible(bool(faults))
        self.fault.setText("\n".join(faults))
        for row, one in enumerate(self.last):
            for column, words in enumerate(one.row()):
                cell = QTableWidgetItem(words)
                if one.fault or one.clipped:
                    cell.setForeground(QColor(FAULT_INK))
                self.table.setItem(row, column, cell)


def run_watch(watched: Watch, title: str, seconds: float | None) -> list[Reading]:
    """Until the window is closed, or for ``seconds``; the last readings."""
    application()
    window = WatchWindow(watched, title)
    ends_s = None if seconds is None else perf_counter() + seconds

    def over() -> None:
        if ends_s is not None and perf_counter() >= ends_s:
            window.close()

    window.timer.timeout.connect(over)
    until_closed(window)
    return window.last
