"""The tactile map while it grows: a line for a row, with an array's image below it, or a heat map
for a grid."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QStackedWidget, QWidget

from probe.core.courses import courses_mm
from probe.gui.heat_map import HeatMap
from probe.gui.line_map import Levels, LineMap
from probe.gui.state import Measured, ViewState
from probe.gui.style import box, label, text
from probe.gui.taxel_panel import TaxelPanel

NO_PULSE_PA = 1.0
"""The end of the scale where no pulse is seen."""


class MapPanel(QStackedWidget):
    """Whichever map fits the run; a click on a place chooses its station, a second one none."""

    choice = Signal()
    """Another station is ``chosen``."""

    def __init__(self, title: str = "Tactile map") -> None:
        super().__init__()
        self.chosen: int | None = None
        self._state = ViewState()
        self._known: GridMap | None = None
        self._levels: Levels | None = None
        self._said: Mapping[str, Any] | None = None
        self.line = LineMap(title)
        self.grid = HeatMap(title, "baseline [kPa]")
        self.grid_pulse = HeatMap("", "pulse [Pa]")
        for image in (self.grid, self.grid_pulse):
            label(image.plot, ("x", "mm"), ("y", "mm"))
        unseen = "\N{WHITE DOWN-POINTING TRIANGLE} no pulse seen in this cell"
        self.meaning = text(unseen, centred=True)
        self.taxels = TaxelPanel()
        self.area, self.row = QWidget(), QWidget()
        box(self.area, self.grid, self.grid_pulse, self.meaning)
        box(self.row, self.line, self.taxels)
        nowhere = "The places of this recording are unknown: there is no map."
        self.unknown = text(nowhere, centred=True)
        for each in (self.row, self.area, self.unknown):
            self.addWidget(each)
        for each in (self.line, self.grid, self.grid_pulse):
            each.clicked.connect(self._clicked)

    def _clicked(self, x_mm: float, y_mm: float) -> None:
        """Choose the pressed station nearest to a place; ``y_mm`` is NaN where a row has none."""
        pressed = [p for p in self._state.plan if p.index in self._state.presses]
        away = {p.index: math.hypot(p.x_mm - x_mm, _or_0(p.y_mm - y_mm)) for p in pressed}
        nearest = min(away, key=away.__getitem__, default=None)
        self.chosen = None if nearest == self.chosen else nearest
        self.choice.emit()

    def show_state(
        self,
        state: ViewState,
        said: Mapping[str, Any] | None = None,
        levels: Levels | None = None,
    ) -> None:
        """Draw the run so far, and over a grid the finding that is ``said`` of it.

        ``levels`` [Pa] fix the scale (for two runs side by side).
        """
        self._state = state
        if state.is_grid:
            self.setCurrentWidget(self.area)
            self._show_grid(state, levels)
            if said is not self._said:
                self._said = said
                self.grid_pulse.show_courses(courses_mm(said) if said else ())
        elif len(state.taxel_names()) > 1 and state.images and len(state.plan) < 2:
            self._show_row(state, None)
        elif not np.isfinite([p.x_mm for p in state.plan]).all():
            self.setCurrentWidget(self.unknown)
        elif state.plan:
            self._show_row(state, levels)

    def _show_row(self, state: ViewState, levels: Levels | None) -> None:
        """A press alone has no line, and no array no image."""
        self.setCurrentWidget(self.row)
        self.line.setVisible(len(state.plan) > 1 or not state.images)
        if self.line.isVisibleTo(self.row):
            self.line.show_state(state, levels, self.chosen)
        self.taxels.show_state(state, self.chosen)

    def _show_grid(self, state: ViewState, levels: Levels | None) -> None:
        """Large grids take long to draw: only when something is new."""
        new = self._known is None or self._known.state is not state
        if new:
            self._known = GridMap(state)
        assert self._known is not None
        if self._known.follow() or new or levels != self._levels:
            self._levels = levels
            scale = None if levels is None else (levels.low_pa / 1e3, levels.high_pa / 1e3)
            known = self._known
            self.grid.show_table(known.levels / 1e3, known.box, scale)
            own_pa = float(known.pulses[np.isfinite(known.pulses)].max(initial=0.0))
            most_pa = (own_pa if levels is None else levels.pulse_pa) or NO_PULSE_PA
            self.grid_pulse.show_table(known.pulses, known.box, (0.0, most_pa), known.below)
            self.meaning.setVisible(bool(np.isfinite(known.below).any()))
        at = [(p.x_mm, p.y_mm) for p in state.plan if p.index == self.chosen]
        for image in (self.grid, self.grid_pulse):
            image.mark.setData(pos=np.array(at).reshape(-1, 2))


class GridMap:
    """What was measured of a grid, as tables (rows, columns) [Pa]: ``levels``, ``pulses``, and
    what those that were not seen are ``below``; NaN where nothing is known.

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
        self._tables = np.full((len(Measured._fields), len(ys), len(xs)), np.nan)
        self.levels, self.pulses, self.below = self._tables
        dx = (xs[-1] - xs[0]) / max(1, len(xs) - 1) or 1.0
        dy = (ys[-1] - ys[0]) / max(1, len(ys) - 1) or 1.0
        self.box = (xs[0] - dx / 2, ys[0] - dy / 2, dx * len(xs), dy * len(ys))

    def follow(self) -> bool:
        """Take in what was pressed or measured since the last call; whether there was any."""
        changed = False
        if self.state.finding is not self._finding:
            self._finding, self._read = self.state.finding, 0
        for index in self.state.pressed[max(0, self._read - 1) :]:  # the last may have gone on
            row, column = self._cells[index]
            before = self._tables[:, row, column].copy()
            self._tables[:, row, column] = self.state.maps[index]
            changed |= not np.array_equal(before, self.state.maps[index], equal_nan=True)
        self._read = len(self.state.pressed)
        return bool(changed)


def common_levels(states: tuple[ViewState, ...]) -> Levels | None:
    """One scale for all the runs; None while there is nothing."""
    known = [measured for state in states for measured in state.maps.values()]
    if not known:
        return None
    levels, pulses, _ = np.array(known).T
    seen = pulses[np.isfinite(pulses)]
    return Levels(float(levels.min()), float(levels.max()), float(seen.max(initial=0.0)))


def _or_0(length_mm: float) -> float:
    return 0.0 if math.isnan(length_mm) else length_mm
