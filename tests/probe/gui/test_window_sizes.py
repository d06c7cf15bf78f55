"""Windows on screens that are small or wide: nothing is cut, nothing is hidden."""

from pathlib import Path

import pyqtgraph as pg
import pytest
from PySide6.QtCore import Qt
from run_windows import FINDING, Make, Shoot, state_of

from probe.gui.window import RunWindow

SMALL = (800, 600)


@pytest.mark.parametrize("rows", [1, 5])
def test_nothing_is_cut_on_a_small_screen(rows: int, make_run: Make, shoot: Shoot) -> None:
    """Titles and axes were cut at the right, the finding's words above and below."""
    state = state_of(make_run(rows))
    long = FINDING | {"reason": "of two objects " * 40}
    window = RunWindow(Path("a.run"), lambda: state, lambda: long, lambda _: None)
    shoot(window, f"small-{rows}", SMALL)
    area = window.plots.parentWidget()
    assert window.plots.width() <= area.width()
    shown = [one for one in window.plots.findChildren(pg.GraphicsView) if one.isVisible()]
    assert len(shown) >= 4
    for one in shown:
        assert one.width() <= area.width()
        drawn = one.scene().itemsBoundingRect()
        parts = [item for item in one.scene().items() if isinstance(item, pg.PlotItem)]
        for part in parts:
            assert part.sceneBoundingRect().right() <= one.width() + 1, drawn
            assert part.sceneBoundingRect().bottom() <= one.height() + 1, drawn
    for label in (window.side.finding, window.side.objects, window.side.progress):
        assert label.height() >= label.heightForWidth(label.width())
    assert window.side.buttons["stop"].geometry().bottom() < SMALL[1]


def test_a_wide_window_has_its_plots_beside_each_other(make_run: Make, shoot: Shoot) -> None:
    state = state_of(make_run())
    window = RunWindow(Path("a.run"), lambda: state)
    shoot(window, "wide")
    assert window.plots.orientation() is Qt.Orientation.Horizontal
    assert window.plots.height() <= window.plots.parentWidget().height()
