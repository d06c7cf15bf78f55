"""The tactile map while it grows: a line for a row, a heat map for a grid, an image for taxels."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pyqtgraph as pg
from PySide6.QtGui import QFont
from PySide6.QtWidgets import QApplication, QStackedWidget, QVBoxLayout, QWidget

from drivers.core.arrays import Array
from probe.core.courses import courses_mm
from probe.gui.state import ViewState
from probe.gui.style import head, heat, label, pen, plot, scale, symbol_size
from probe.report.look import BLUE, ON_HEAT, VERMILLION


class Levels(NamedTuple):
    """One scale for several runs: the lowest and highest baseline and the highest pulse [Pa]."""

    low_pa: float
    high_pa: float
    pulse_pa: float


class LineMap(QWidget):
    """Baseline above, pulse below, over one row of stations."""

    def __init__(self) -> None:
        super().__init__()
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        self.base = plot("Tactile map", ("x", "mm"), ("baseline", "kPa"))
        self.beat = plot("", ("x", "mm"), ("pulse", "Pa"))
        self.beat.setXLink(self.base)
        self.base_curve = self.base.plot(
            pen=pen(BLUE, 2), symbol="o", symbolSize=symbol_size(), symbolBrush=BLUE
        )
        self.beat_curve = self.beat.plot(
            pen=pen(VERMILLION, 2), symbol="s", symbolSize=symbol_size(), symbolBrush=VERMILLION
        )
        for each in (self.base, self.beat):
            layout.addWidget(each)

    def show_state(self, state: ViewState, levels: Levels | None) -> None:
        rows = [(p.x_mm, *state.maps[p.index]) for p in state.plan if p.index in state.maps]
        if state.plan:
            ends = [p.x_mm for p in state.plan]
            self.base.setXRange(min(ends), max(ends), padding=0.05)
        x, base, beat = np.array(rows or np.empty((0, 3))).reshape(-1, 3).T
        order = np.argsort(x)
        self.base_curve.setData(x[order], base[order] / 1e3)
        order = order[np.isfinite(beat[order])]
        self.beat_curve.setData(x[order], beat[order])
        if levels is not None:
            self.base.setYRange(levels.low_pa / 1e3, levels.high_pa / 1e3)
        highest_pa = levels.pulse_pa if levels is not None else beat[order].max(initial=0.0)
        if highest_pa > 0:  # from 0, or noise would fill the plot
            self.beat.setYRange(0.0, highest_pa)


NO_PULSE_PA = 1.0
"""The end of the scale where no pulse is seen."""


class HeatMap(pg.GraphicsLayoutWidget):  # type: ignore[misc]  # pyqtgraph ships no types
    """An image in true proportions with a colour bar; ``y`` upwards."""

    def __init__(self, title: str, unit: str) -> None:
        super().__init__()
        self.plot = self.addPlot()
        head(self.plot, title)
        self.plot.setAspectLocked(True)
        self.plot.setMouseEnabled(x=False, y=False)
        self.plot.setMenuEnabled(False)
        self.plot.hideButtons()
        self._box: tuple[float, float, float, float] | None = None
        self.courses: list[pg.PlotDataItem] = []
        self.image = pg.ImageItem(axisOrder="row-major")
        self.plot.addItem(self.image)
        self.bar = pg.ColorBarItem(colorMap=heat(), label=unit, interactive=False)
        self.bar.setImageItem(self.image, insert_in=self.plot)
        # a vertical bar has its name on the left and its numbers on the right
        name, numbers = self.bar.getAxis("left"), self.bar.getAxis("right")
        name.setLabel(unit, **{"font-size": f"{10 * scale():.0f}pt"})
        numbers.setTickFont(QFont(QApplication.font().family(), round(9 * scale())))

    def show_table(
        self,
        table: Array,
        box: tuple[float, float, float, float],
        scale: tuple[float, float] | None = None,
    ) -> None:
        """``table`` (rows, columns) over ``box`` (left, bottom, width, height); NaN is empty."""
        known = table[np.isfinite(table)]
        low, high = scale or ((known.min(), known.max()) if len(known) else (0.0, 1.0))
        self.image.setImage(table, autoLevels=False)
        # one value alone is the middle of a scale wide enough to be numbered
        ends = (low, high) if high > low else (low - 0.5, high + 0.5)
        if ends != self.bar.levels():  # setting what is set would redraw the axes
            self.bar.setLevels(ends)
        if box != self._box:
            self._box = box
            self.image.setRect(*box)

    def show_courses(self, courses: Sequence[tuple[str, Array]]) -> None:
        """What was found, over the image: see `probe.core.courses.courses_mm`."""
        for old in self.courses:
            self.plot.removeItem(old)
        line, edge = ON_HEAT
        self.courses = []
        for name, points in courses:
            stenosed = name == "stenosed"
            self.courses.append(
                self.plot.plot(
                    points,
                    pen=pen(line, 1.5) if not stenosed else None,
                    shadowPen=pen(edge, 4),
                    symbol="d" if stenosed else "o",
                    symbolSize=symbol_size() * (1.5 if stenosed else 1),
                    symbolBrush=edge if stenosed else line,
                    symbolPen=pen(line if stenosed else edge, 1),
                )
            )


class MapPanel(QStackedWidget):
    """Whichever map fits the run."""

    def __init__(self) -> None:
        super().__init__()
        self._known: GridMap | None = None
        self._levels: Levels | None = None
        self._said: Mapping[str, Any] | None = None
        self.line = LineMap()
        self.grid = HeatMap("Tactile map", "baseline [kPa]")
        self.grid_pulse = HeatMap("", "pulse [Pa]")
        self.area = QWidget()
        both = QVBoxLayout(self.area)
        both.setContentsMargins(0, 0, 0, 0)
        for image in (self.grid, self.grid_pulse):
            label(image.plot, ("x", "mm"), ("y", "mm"))
            both.addWidget(image)
        self.taxels = HeatMap("Taxels now", "stress [kPa]")
        label(self.taxels.plot, ("taxel column", "number"), ("taxel row", "number"))
        for each in (self.line, self.area, self.taxels):
            self.addWidget(each)

    def show_state(
        self,
        state: ViewState,
        said: Mapping[str, Any] | None = None,
        levels: Levels | None = None,
    ) -> None:
        """Draw the run so far, and over a grid the finding that is ``said`` of it.

        ``levels`` [Pa] fix the scale (for two runs side by side).
        """
        if state.is_grid:
            self.setCurrentWidget(self.area)
            self._show_grid(state, levels)
            if said is not self._said:
                self._said = said
                self.grid_pulse.show_courses(courses_mm(said) if said else ())
        elif len(state.taxels_pa) > 1 and len(state.plan) < 2:
            self.setCurrentWidget(self.taxels)
            table = taxel_table(state.taxels_pa)
            self.taxels.show_table(table / 1e3, (0, 0, table.shape[1], table.shape[0]))
        else:
            self.setCurrentWidget(self.line)
            self.line.show_state(state, levels)

    def _show_grid(self, state: ViewState, levels: Levels | None) -> None:
        """Large grids take long to draw: only when something is new."""
        new = self._known is None or self._known.state is not state
        if new:
            self._known = GridMap(state)
        assert self._known is not None
        if self._known.follow() or new or levels != self._levels:
            self._levels = levels
            scale = None if levels is None else (levels.low_pa / 1e3, levels.high_pa / 1e3)
            self.grid.show_table(self._known.table / 1e3, self._known.box, scale)
            pulses = self._known.pulses
            own_pa = float(pulses[np.isfinite(pulses)].max(initial=0.0))
            most_pa = (own_pa if levels is None else levels.pulse_pa) or NO_PULSE_PA
            self.grid_pulse.show_table(pulses, self._known.box, (0.0, most_pa))


class GridMap:
    """A grid's baselines ``table`` and ``pulses`` (rows, columns) [Pa], NaN where not pressed yet.

    They lie over ``box`` (left, bottom, width, height) [mm].
    """

    def __init__(self, state: ViewState) -> None:
        xs = sorted({round(p.x_mm, 4) for p in state.plan})
        ys = sorted({round(p.y_mm, 4) for p in state.plan})
        column = {x: n for n, x in enumerate(xs)}
        row = {y: n for n, y in enumerate(ys)}
        self._cells = {
            p.index: (row[round(p.y_mm, 4)], column[round(p.x_mm, 4)]) for p in state.plan
        }
        self.state, self._read, self._finding = state, 0, state.finding
        self.table = np.full((len(ys), len(xs)), np.nan)
        self.pulses = np.full((len(ys), len(xs)), np.nan)
        dx = (xs[-1] - xs[0]) / max(1, len(xs) - 1) or 1.0
        dy = (ys[-1] - ys[0]) / max(1, len(ys) - 1) or 1.0
        self.box = (xs[0] - dx / 2, ys[0] - dy / 2, dx * len(xs), dy * len(ys))

    def follow(self) -> bool:
        """Take in what was pressed or measured since the last call; whether there was any."""
        changed = False
        if self.state.finding is not self._finding:
            self._finding, self._read = self.state.finding, 0
        for index in self.state.pressed[max(0, self._read - 1) :]:  # the last may have gone on
            cell, (baseline_pa, pulse_pa) = self._cells[index], self.state.maps[index]
            before = self.table[cell], self.pulses[cell]
            changed |= not np.array_equal(before, (baseline_pa, pulse_pa), equal_nan=True)
            self.table[cell], self.pulses[cell] = baseline_pa, pulse_pa
        self._read = len(self.state.pressed)
        return bool(changed)


def taxel_table(values: Array) -> Array:
    """Taxels (n,) as the most nearly square full table (rows >= columns), row by row."""
    columns = max(d for d in range(1, math.isqrt(len(values)) + 1) if len(values) % d == 0)
    return values.reshape(-1, columns)


def common_levels(states: tuple[ViewState, ...]) -> Levels | None:
    """One scale for all the runs; None while there is nothing."""
    known = [one for state in states for one in state.maps.values()]
    if not known:
        return None
    baselines, pulses = np.array(known).T
    seen = pulses[np.isfinite(pulses)]
    return Levels(float(baselines.min()), float(baselines.max()), float(seen.max(initial=0.0)))
