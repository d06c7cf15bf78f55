"""The style of all windows: sizes readable at arm's length, plots like the report's figures."""

import gc
import re
import signal
from collections.abc import Callable
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import QEvent, QSize, Qt, QTimer
from PySide6.QtGui import QColor, QFont, QPen
from PySide6.QtWidgets import QApplication, QBoxLayout, QFrame, QLabel, QScrollArea, QWidget

from probe.report.look import HEAT, INK

COLLECT_MS = 5000
SHADE = 50  # of 255
SHEET = """
* { font-size: 11pt; color: #1b1f24; }
QWidget { background: #ffffff; }
QLabel#finding { font-size: 17pt; font-weight: 600; }
QLabel#simulated { color: #8a3b00; background: #fff1e3; font-weight: 600; padding: 4px;
  border: 2px solid #8a3b00; border-radius: 4px; }
QLabel#fault { color: #ffffff; background: #a40e26; font-weight: 600; padding: 6px;
  border-radius: 4px; }
QLabel#empty { font-size: 15pt; color: #57606a; }
QPushButton { padding: 6px 12px; border: 1px solid #8c959f; border-radius: 4px;
  background: #f4f6f8; }
QPushButton:focus, QComboBox:focus, QSlider:focus { border: 2px solid #0072b2; }
QPushButton:disabled { color: #8c959f; }
QPushButton#stop { font-size: 20pt; font-weight: 700; color: #ffffff; background: #a40e26;
  min-height: 64px; border: 3px solid #6d0919; }
"""
PLOT_PX = 210
"""The least height of a plot that can be read, before `scale`."""


def application(enlarge: float | None = None) -> QApplication:
    """The one Qt application, with the look on.

    Text and windows grow with the screen: on a 4K screen that Qt does not scale itself they are
    doubled. ``enlarge`` overrides that.
    """
    existing = QApplication.instance()
    app = existing if isinstance(existing, QApplication) else QApplication(["palpate"])
    fitting = max(1.0, app.primaryScreen().availableGeometry().height() / 1080)
    app.setProperty("enlarge", enlarge or fitting)
    sizes = re.compile(r"(\d+)(pt)")
    app.setStyleSheet(sizes.sub(lambda m: f"{int(m[1]) * scale():.0f}{m[2]}", SHEET))
    pg.setConfigOptions(background="w", foreground=INK, antialias=True)
    return app


def until_closed(window: QWidget) -> int:
    """Show ``window`` until it is closed, or Ctrl-C or SIGTERM ends it; the exit status.

    Python acts on a signal when it runs next, so in the window's next frame. Garbage is collected
    by this thread alone: Qt ends the process where another one, as that of detection, meets a
    widget in it. The window is deleted by Qt, from the inside out: collected in any order, its
    parts crash one time in forty.
    """
    app, collecting = application(), QTimer()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: app.quit())
    collecting.timeout.connect(gc.collect)
    collecting.start(COLLECT_MS)
    gc.disable()
    gc.freeze()  # what is there stays: only what is new takes time to look through
    try:
        window.show()
        return app.exec()
    finally:
        window.close()
        window.deleteLater()
        app.sendPostedEvents(window, QEvent.Type.DeferredDelete.value)
        gc.unfreeze()
        gc.enable()


def scale() -> float:
    """How much larger than designed everything is drawn."""
    app = QApplication.instance()
    return 1.0 if app is None else float(app.property("enlarge") or 1.0)


def open_at(window: QWidget, width: int, height: int) -> None:
    """Let ``window`` open this large [px on a small screen], and never larger than the screen."""
    room = QApplication.primaryScreen().availableGeometry().size()
    window.resize((QSize(width, height) * scale()).boundedTo(room))


def scrolling(inner: QWidget) -> QScrollArea:
    """``inner``, as large as there is room for; where it needs more, it is scrolled."""
    area = QScrollArea()
    area.setWidget(inner)
    area.setWidgetResizable(True)
    area.setFrameShape(QFrame.Shape.NoFrame)
    return area


def box(parent: QWidget, *parts: QWidget, across: bool = False) -> QBoxLayout:
    """``parts`` one below the other in ``parent``, or beside each other, without margins."""
    way = QBoxLayout.Direction.LeftToRight if across else QBoxLayout.Direction.TopToBottom
    layout = QBoxLayout(way, parent)
    layout.setContentsMargins(0, 0, 0, 0)
    for part in parts:
        layout.addWidget(part)
    return layout


def text(words: str = "", look: str = "", *, centred: bool = False) -> QLabel:
    """Words, in as many lines as they need; ``look`` is one of `SHEET`."""
    made = QLabel(words)
    made.setObjectName(look)
    made.setWordWrap(True)
    if centred:
        made.setAlignment(Qt.AlignmentFlag.AlignCenter)
    return made


def heat() -> pg.ColorMap:
    """The colour map of every heat map."""
    return pg.colormap.get(HEAT)


def plot(title: str, x: tuple[str, str], y: tuple[str, str]) -> pg.PlotWidget:
    """An empty plot; ``x`` and ``y`` are (name, unit).

    No grid: pyqtgraph takes longer to draw one than everything else of a frame together.
    """
    widget = pg.PlotWidget()
    only_shows(widget.getPlotItem())
    head(widget.getPlotItem(), title)
    label(widget.getPlotItem(), x, y)
    return widget


def only_shows(area: pg.PlotItem) -> None:
    """No mouse and no menu changes what a plot shows."""
    area.setMouseEnabled(x=False, y=False)
    area.hideButtons()
    area.setMenuEnabled(False)


def head(area: pg.PlotItem, title: str) -> None:
    """The title, in a size that fits the screen."""
    area.setTitle(title, size=f"{11 * scale():.0f}pt")


def label(area: pg.PlotItem, x: tuple[str, str], y: tuple[str, str]) -> None:
    """Name the axes with their units, in sizes that fit the screen."""
    for side, (name, unit) in (("bottom", x), ("left", y)):
        axis = area.getAxis(side)
        axis.enableAutoSIPrefix(False)  # the unit in the label is the one that holds
        axis.setTickFont(QFont(QApplication.font().family(), round(9 * scale())))
        axis.setLabel(f"{name} [{unit}]", **{"font-size": f"{10 * scale():.0f}pt"})


def clicks_on(area: pg.PlotItem, act: Callable[[float, float], object]) -> None:
    """Call ``act`` with the place (x, y) of every click on a plot, in its own units."""

    def clicked(event: Any) -> None:
        if area.vb.sceneBoundingRect().contains(event.scenePos()):
            place = area.vb.mapSceneToView(event.scenePos())
            act(place.x(), place.y())

    area.scene().sigMouseClicked.connect(clicked)


def pen(colour: str, width: float) -> QPen:
    """A pen that grows with the screen; ``width`` is that on a small one."""
    made: QPen = pg.mkPen(colour, width=width * scale())
    return made


def symbol_size() -> float:
    """Of the dots on a curve."""
    return 8.0 * scale()


def shade(colour: str) -> QColor:
    """A colour for filling behind curves, which shine through."""
    tint = QColor(colour)
    tint.setAlpha(SHADE)
    return tint
