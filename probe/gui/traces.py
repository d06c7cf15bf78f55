"""Live force with its phases shaded, and one mean beat."""

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtWidgets import QWidget

from drivers.core.arrays import Array
from probe.gui.averaged_beat import averaged_beat
from probe.gui.picture import Picture
from probe.gui.press_trace import PressTrace
from probe.gui.state import TRACE_S, ViewState
from probe.gui.style import box, head, label, pen, plot, shade, symbol_size, text
from probe.report.look import BLUE, GREEN, INK, PHASE_COLOURS, PURPLE, SKY, VERMILLION

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
    """The last seconds of the tactile signal, or a chosen station's, and one mean beat of its hold.

    While no heart rate is known, the hold is shown as it is.
    """

    def __init__(self) -> None:
        super().__init__()
        self.chosen: int | None = None
        self.trace = plot("Signal", ("time before now", "s"), ("contact stress", "kPa"))
        self._title: tuple[str, tuple[float, float]] | None = None
        self._shown: tuple[str, ...] | None = None  # the names of the curves
        self.names = self.trace.addLegend(offset=(10, 5), labelTextColor=INK)
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
        self.pictures = Picture("signal", self.trace), Picture("pulse", self.beat)
        signal, pulse = self.pictures
        layout = box(self, signal, text(LEGEND, centred=True), pulse)
        layout.setStretchFactor(signal, 3)
        layout.setStretchFactor(pulse, 2)

    def show_state(self, state: ViewState) -> None:
        """Draw the latest signal, or that of the ``chosen`` station if it was pressed."""
        if not state.signal_device:
            return
        press = None if self.chosen is None else state.presses.get(self.chosen)
        station = state.station if press is None else self.chosen
        held = state.hold() if press is None else press.hold(marked=bool(state.phases))
        signal, pulse = self.pictures
        signal.draw(
            lambda: self._latest(state) if press is None else self._chosen(press, station, state)
        )
        if len(held[0]):
            pulse.draw(lambda: self._beat(*held, station, state))

    def _latest(self, state: ViewState) -> None:
        name = state.signal_device
        time_s, values = state.traces[name].arrays()
        self._head(f"Signal of {name}: {state.phase}", ("time before now", "s"), (-TRACE_S, 0.0))
        if len(time_s):
            step = max(1, len(time_s) // MAX_POINTS)
            stress = state.stress_pa(name, values[::step]) / 1e3
            names = state.taxel_names()
            if stress.shape[1] > MAX_CURVES:  # the taxel image shows each, curves cannot
                stress = np.column_stack([stress.min(1), stress.mean(1), stress.max(1)])
                names = "least taxel", "mean of all taxels", "greatest taxel"
            self._curves(time_s[::step] - state.now_s, stress, names)
        self._shade(state)

    def _chosen(self, press: PressTrace, station: int | None, state: ViewState) -> None:
        """One press, in place of the signal as it comes."""
        time_s, stress_pa = press.whole()
        if not len(time_s):
            return
        at = next((p for p in state.plan if p.index == station), None)
        where = f" at x = {at.x_mm:g} mm" if at is not None and np.isfinite(at.x_mm) else ""
        self._head(
            f"Signal of station {(station or 0) + 1}{where}; click it again for the latest",
            ("time since the hold began", "s"),
            (float(time_s[0]), float(time_s[-1])),
        )
        taxels = len(state.taxel_names())
        names = ("mean of all taxels",) if taxels > 1 else state.taxel_names()
        self._curves(time_s, stress_pa[:, None] / 1e3, names)
        for region in self.shades:
            region.hide()

    def _head(self, title: str, axis: tuple[str, str], span: tuple[float, float]) -> None:
        """Title and axis of the signal, where they are not as they were."""
        if (title, span) != self._title:
            self._title = title, span
            head(self.trace.getPlotItem(), title)
            label(self.trace.getPlotItem(), axis, ("contact stress", "kPa"))
            self.trace.setXRange(*span, padding=0)  # an axis that stands still is drawn once

    def _beat(self, held_s: Array, stress_pa: Array, station: int | None, state: ViewState) -> None:
        period_s = state.period_s
        where = "" if station is None else f" at station {station + 1}"
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

    def _curves(self, time_s: Array, stress: Array, names: Sequence[str]) -> None:
        """Stresses (n, curves) over times (n,), each curve named in the legend if there are more
        than one."""
        if tuple(names) != self._shown:
            self._shown = tuple(names)
            self.names.clear()
            for curve in self.curves:
                self.trace.removeItem(curve)
            self.curves = [
                self.trace.plot(
                    pen=pg.mkPen(BLUE if len(names) == 1 else colour, width=1), antialias=False,
                    name=name if len(names) > 1 else None,
                )
                for name, colour in zip(names, COLOURS, strict=False)
            ]  # fmt: skip
        for curve, channel in zip(self.curves, stress.T, strict=True):
            curve.setData(time_s, channel)

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
