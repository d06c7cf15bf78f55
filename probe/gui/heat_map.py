"""A heat map in true proportions: a grid of stations, or an array's taxels."""

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Signal
from PySide6.QtGui import QFont
from PySide6.QtWidgets import QApplication

from drivers.core.arrays import Array
from probe.gui.style import clicks_on, head, heat, only_shows, pen, scale, symbol_size
from probe.report.look import INK, ON_HEAT


class HeatMap(pg.GraphicsLayoutWidget):  # type: ignore[misc]  # pyqtgraph ships no types
    """An image in true proportions with a colour bar; ``y`` upwards.

    A triangle that points down marks a cell whose value was looked for and not seen.
    """

    clicked = Signal(float, float)

    def __init__(self, title: str, unit: str) -> None:
        super().__init__()
        self.plot = self.addPlot()
        only_shows(self.plot)
        head(self.plot, title)
        self.plot.setAspectLocked(True)
        self._box: tuple[float, float, float, float] | None = None
        self.courses: list[pg.PlotDataItem] = []
        self.image = pg.ImageItem(axisOrder="row-major")
        self.plot.addItem(self.image)
        self.unseen = pg.ScatterPlotItem(symbol="t", brush=None, pen=pen(INK, 1))
        self.mark = pg.ScatterPlotItem(
            symbol="s", size=2 * symbol_size(), brush=None, pen=pen(INK, 2)
        )
        for over in (self.unseen, self.mark):
            self.plot.addItem(over, ignoreBounds=True)
        clicks_on(self.plot, self.clicked.emit)
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
        unseen: Array | None = None,
    ) -> None:
        """``table`` (rows, columns) over ``box`` (left, bottom, width, height); NaN is empty.

        ``unseen`` (rows, columns) is finite where a value was looked for and not seen.
        """
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

        left, bottom, width, height = box
        rows, columns = np.nonzero(np.isfinite(unseen)) if unseen is not None else ([], [])
        self.unseen.setData(
            left + (np.array(columns) + 0.5) * width / table.shape[1],
            bottom + (np.array(rows) + 0.5) * height / table.shape[0],
            size=symbol_size(),
        )

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
