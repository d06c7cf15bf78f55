"""A press as an array saw it: the mean of its hold, and how each taxel pulsed."""

import numpy as np
from PySide6.QtWidgets import QWidget

from drivers.core.arrays import Array
from probe.core.taxel_image import taxel_image
from probe.gui.heat_map import HeatMap
from probe.gui.state import ViewState
from probe.gui.style import PLOT_PX, box, head, label, scale


class TaxelPanel(QWidget):
    """Images of the mean of a hold, the latest or that of the station that is chosen; row 0 below,
    and a triangle where no taxel is. The pulse, each taxel's highest less its lowest over a beat,
    is the latest press's, where one is known."""

    def __init__(self) -> None:
        super().__init__()
        self.level = HeatMap("", "stress [kPa]")
        self.pulse = HeatMap("Pulse", "pulse [Pa]")
        self.setMinimumHeight(round(PLOT_PX * scale()))
        box(self, self.level, self.pulse, across=True)

    def show_state(self, state: ViewState, chosen: int | None) -> None:
        """As the array has them, or in a line where its layout is not known."""
        number = state.station if chosen is None else chosen
        values = state.images.get(-1 if number is None else number)
        self.setVisible(values is not None and len(values) > 1)
        if values is None or len(values) < 2:
            return
        many = f", station {number + 1}" if number is not None and len(state.plan) > 1 else ""
        head(self.level.plot, f"Hold{many}")
        _show(self.level, values / 1e3, state)
        period_s = state.period_s
        pulse_pa = np.empty(0)
        if number == state.station and period_s is not None:
            pulse_pa = state.held.pulse_pa(period_s)
        seen = bool(np.isfinite(pulse_pa).any())
        self.pulse.setVisible(seen)
        if seen:
            _show(self.pulse, pulse_pa, state)


def _show(image: HeatMap, values: Array, state: ViewState) -> None:
    table = taxel_image(values, state.taxel_names())
    known = table is not None
    if table is None:
        table = values[None]
    column, row = ("column", "row") if known else ("channel", "layout not known:")
    label(image.plot, (column, "number"), (row, "number" if known else "one row"))
    holes = np.where(np.isnan(table), 0.0, np.nan)
    image.show_table(table, (0, 0, table.shape[1], table.shape[0]), unseen=holes)
