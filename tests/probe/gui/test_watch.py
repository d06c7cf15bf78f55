"""The window of readings: it shows what the sensors read, and Space tares that."""

import numpy as np
import pytest
from one_sensor import FunctionSensor
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from drivers import Channel, SimulatedClock
from probe.checks.watch import Watch
from probe.gui.watch import WatchWindow

FORCE, PPG = Channel("force", "N", "force", simulated=True), Channel("ppg", "V", "reference")


def test_what_is_read_is_shown_and_space_tares_it(shoot):
    clock = SimulatedClock()
    noise = np.random.default_rng(0)

    def reading(t):
        both = np.column_stack([np.where(t < 2, 0.4, 1.5), np.sin(7 * t)])
        return both + 1e-3 * noise.standard_normal(both.shape)

    gauge = FunctionSensor(clock, reading, channels=(FORCE, PPG))
    lost = FunctionSensor(clock, lambda t: 0 * t, fails_s=1.0)
    lost.name = "cell"
    with Watch([gauge, lost], clock) as watched:
        window = WatchWindow(watched, "rig.toml")
        while clock.now() < 5:
            clock.sleep_until(clock.now() + 0.1)
            window.frame()

        def cell(row, column):
            return window.table.item(row, column).text()

        assert cell(0, 0) == "gauge.force"
        assert float(cell(0, 1)) == pytest.approx(1.5, abs=0.001)
        assert float(cell(0, 2)) == pytest.approx(1.1, abs=0.002)
        assert cell(0, 8) == "SIMULATED"
        assert cell(1, 8) == ""
        assert "unplugged" in cell(2, 8)
        shoot(window, "watch", (1000, 320))
        QTest.keyClick(window, Qt.Key.Key_Space)
        window.frame()
        assert float(cell(0, 2)) == pytest.approx(0.0, abs=0.001)
        window.timer.stop()
        window.close()


def test_every_channel_of_six_axes_is_in_sight() -> None:
    clock = SimulatedClock()
    names = ("force", "fx", "fy", "fz", "mx", "my", "mz")
    channels = tuple(Channel(name, "N", "other", simulated=True) for name in names)
    wrist = FunctionSensor(clock, lambda t: np.zeros((len(t), 7)), channels=channels)
    with Watch([wrist], clock) as watched:
        window = WatchWindow(watched, "rig.toml")
        window.show()
        QTest.qWaitForWindowExposed(window)
        rows = sum(window.table.rowHeight(row) for row in range(7))
        assert window.table.viewport().height() >= rows
        window.timer.stop()
        window.close()
