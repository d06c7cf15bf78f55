"""The tactile map of one row of stations: levels above, pulses below."""

import math
from typing import NamedTuple

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from probe.gui.state import ViewState
from probe.gui.style import box, clicks_on, pen, plot, symbol_size, text
from probe.report.look import BLUE, INK, VERMILLION


class Levels(NamedTuple):
    """One scale for several runs: the lowest and highest baseline and the highest pulse [Pa]."""

    low_pa: float
    high_pa: float
    pulse_pa: float


PULSE_LEGEND = (
    f"<span style='color:{VERMILLION}'>&#9632;</span> pulse &nbsp; "
    f"<span style='color:{VERMILLION}'>&#9661;</span> not seen: it is below this"
)


class LineMap(QWidget):
    """Baseline above, pulse below, over one row of stations.

    A pulse that was not seen is no 0: a triangle points down from what it is below.
    """

    clicked = Signal(float, float)
    """A place [mm], and the row that it lies in, which is not known here: NaN."""

    def __init__(self, title: str) -> None:
        super().__init__()
        self.base = plot(title, ("x", "mm"), ("baseline", "kPa"))
        self.beat = plot("", ("x", "mm"), ("pulse", "Pa"))
        self.beat.setXLink(self.base)
        self.base_curve = self.base.plot(
            pen=pen(BLUE, 2), symbol="o", symbolSize=symbol_size(), symbolBrush=BLUE
        )
        self.beat_curve = self.beat.plot(
            pen=pen(VERMILLION, 2), symbol="s", symbolSize=symbol_size(), symbolBrush=VERMILLION
        )
        self.unseen = self.beat.plot(
            pen=None, symbol="t", symbolSize=symbol_size(), symbolBrush=None,
            symbolPen=pen(VERMILLION, 1.5),
        )  # fmt: skip
        self.marks = [pg.InfiniteLine(pen=pen(INK, 1)) for _ in range(2)]
        self.meaning = text(PULSE_LEGEND, centred=True)
        box(self, self.base, self.beat, self.meaning)
        for each, mark in zip((self.base, self.beat), self.marks, strict=True):
            each.addItem(mark, ignoreBounds=True)
            clicks_on(each.getPlotItem(), lambda x_mm, _: self.clicked.emit(x_mm, math.nan))

    def show_state(self, state: ViewState, levels: Levels | None, chosen: int | None) -> None:
        rows = [(p.x_mm, *state.maps[p.index]) for p in state.plan if p.index in state.maps]
        ends = [p.x_mm for p in state.plan]
        self.base.setXRange(min(ends), max(ends), padding=0.05)
        x, base, pulse, below = (
            np.array(rows or np.empty((0, 4)))
            .reshape(-1, 4)[np.argsort([row[0] for row in rows]).astype(int)]
            .T
        )
        self.base_curve.setData(x, base / 1e3)
        seen, unseen = np.isfinite(pulse), np.isfinite(below)
        self.beat_curve.setData(x[seen], pulse[seen])
        self.unseen.setData(x[unseen], below[unseen])
        self.meaning.setVisible(bool(unseen.any()))
        if levels is not None:
            self.base.setYRange(levels.low_pa / 1e3, levels.high_pa / 1e3)
            highest_pa = levels.pulse_pa
        else:
            highest_pa = max(pulse[seen].max(initial=0.0), below[unseen].max(initial=0.0))
        if highest_pa > 0:  # from 0, or noise would fill the plot
            self.beat.setYRange(0.0, highest_pa)
        at_mm = next((p.x_mm for p in state.plan if p.index == chosen), None)
        for mark in self.marks:
            mark.setVisible(at_mm is not None)
            mark.setValue(at_mm or 0.0)
