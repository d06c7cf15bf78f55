"""Live force with its phases shaded, and one mean beat."""

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QVBoxLayout, QWidget

from drivers.core.arrays import Array
from probe.gui.averaged_beat import averaged_beat
from probe.gui.state import TRACE_S, ViewState
from probe.gui.style import pen, plot, shade, symbol_size
from probe.report.look import BLUE, GREEN, PHASE_COLOURS, PURPLE, SKY, VERMILLION

MAX_POINTS = 3000
MAX_CURVES = 4  # of more channels: the least, the mean and the greatest
COLOURS = (SKY, BLUE, PURPLE, GREEN)
SHADES = 40
NAMED = ("approaching", "indenting", "holding", "retracting")
LEGEND = "&nbsp; ".join(
    f"<span style='color:{PHASE_COLOURS[phase]}'>&#9632;</span> {phase}" for phase in NAMED
)
"""Of the shades: the phases of a press."""


class TracePanel(QWidget):
    """The last seconds of the tactile signal, and one mean beat of the current hold.

    While no heart rate is known, the hold is shown as it is.
    """

    def __init__(self) -> None:
        super().__init__()
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        self.trace = plot("Signal", ("time before now", "s"), ("contact stress", "kPa"))
        shades = QLabel(LEGEND)
        shades.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.trace.setXRange(-TRACE_S, 0, padding=0)  # an axis that stands still is drawn once
        self._title = ""
        self.curves: list[pg.PlotDataItem] = []
        self.shades = [pg.LinearRegionItem(movable=False, pen=(0, 0, 0, 0)) for _ in range(SHADES)]
        for region in self.shades:
            region.setZValue(-10)
            region.hide()
            self.trace.addItem(region, ignoreBounds=True)
        self.beat = plot("Pulse", ("time", "s"), ("change", "Pa"))
        self._beat_title = ""
        self.beat_curve = self.beat.plot(
            pen=pen(VERMILLION, 2), symbol="o", symbolSize=symbol_size(), symbolBrush=VERMILLION
        )
        layout.addWidget(self.trace, 3)
        layout.addWidget(shades)
        layout.addWidget(self.beat, 2)

    def show_state(self, state: ViewState) -> None:
        name = state.signal_device
        if not name:
            return
        time_s, values = state.traces[name].arrays()
        title = f"Signal of {name}: {state.phase}"
        if title != self._title:
            self._title = title
            self.trace.setTitle(title)
        if len(time_s):
            step = max(1, len(time_s) // MAX_POINTS)
            stress = state.stress_pa(name, values[::step]) / 1e3
            if stress.shape[1] > MAX_CURVES:  # the taxel image shows each, curves cannot
                stress = np.column_stack([stress.min(1), stress.mean(1), stress.max(1)])
            self._curves(stress.shape[1])
            for curve, channel in zip(self.curves, stress.T, strict=True):
                curve.setData(time_s[::step] - state.now_s, channel)
        self._shade(state)
        held_s, stress_pa = state.hold()
        if len(held_s):
            self._beat(held_s, stress_pa, state)

    def _beat(self, held_s: Array, stress_pa: Array, state: ViewState) -> None:
        period_s = state.period_s
        where = "" if state.station is None else f" at station {state.station + 1}"
        if period_s is None:
            title = f"Hold{where}: no heart rate is known yet"
            step = max(1, len(held_s) // MAX_POINTS)
            time_s, change_pa = held_s[::step] - held_s[0], stress_pa[::step] - stress_pa.mean()
        else:
            title = f"Pulse{where}, folded at {60 / period_s:.0f} /min"
            phase_s, mean = averaged_beat(held_s, stress_pa, period_s)
            known = np.isfinite(mean)
            time_s, change_pa = phase_s[known], mean[known] - mean[known].mean()
        if title != self._beat_title:
            self._beat_title = title
            self.beat.setTitle(title)
        folded = period_s is not None
        self.beat_curve.setSymbol("o" if folded else None)
        # thousands of noisy points in a wide or smoothed pen take Qt a third of a second a frame
        self.beat_curve.setPen(pen(VERMILLION, 2) if folded else pg.mkPen(VERMILLION, width=1))
        self.beat_curve.setData(time_s, change_pa, antialias=folded)

    def _curves(self, count: int) -> None:
        while len(self.curves) < count:
            colour = BLUE if count == 1 else COLOURS[len(self.curves)]
            self.curves.append(self.trace.plot(pen=pg.mkPen(colour, width=1), antialias=False))

    def _shade(self, state: ViewState) -> None:
        starts = list(state.phases)
        ends = [t for t, _ in starts[1:]] + [state.now_s] * bool(starts)
        seen = [
            (start, end, PHASE_COLOURS[phase])
            for (start, phase), end in zip(starts, ends, strict=True)
            if phase in PHASE_COLOURS and end > state.now_s - TRACE_S
        ][-SHADES:]
        for n, region in enumerate(self.shades):
            region.setVisible(n < len(seen))
            if n < len(seen):
                start, end, colour = seen[n]
                region.setRegion((max(start - state.now_s, -TRACE_S), end - state.now_s))
                region.setBrush(shade(colour))
