"""Pressing is interpolation in a solved table: exact where it must be, and quick to draw."""

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest
from changed_scene import changed
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtTest import QTest
from small_solid import small_solid

from probe.gui.feel import LIFTED_MM, MAX_DEPTH_MM, FeelWindow, deepest_mm
from probe.gui.style import application
from probe.gui.table import Table, came_mm, solve
from sim_backend import load_scene
from sim_backend.models import kept_tables

LEFT = Qt.MouseButton.LeftButton
TIHA = load_scene("TIHA")
HEIGHT_MM = 16.83


class Springs:
    """400 N/m, and 2 % more at 120 mmHg than at 80."""

    def force_n(self, depth_m: np.ndarray, pressure_pa: np.ndarray) -> np.ndarray:
        return 400 * depth_m * (1 + 0.02 * (pressure_pa / 133.322 - 80) / 40)

    von_mises_pa = force_n


def table(x0_mm: float = 32.0) -> Table:
    """A dent of Gaussian shape; force in proportion to depth, a little more at high pressure."""
    x, y = np.arange(-3.0, 67.0, 0.35), np.arange(-1.0, 19.0, 0.35)
    xx, yy = np.meshgrid(x, y)
    inside = (xx >= 0) & (xx <= 64) & (yy >= 0) & (yy <= HEIGHT_MM)
    depth = np.linspace(0, 2.5e-3, 6)
    shape = np.exp(-(((xx - x0_mm) / 8) ** 2)) * np.clip(yy / HEIGHT_MM, 0, 1)
    moved = np.zeros((6, 2, *xx.shape, 2))
    moved[..., 1] = -1e3 * depth[:, None, None, None] * shape
    stress = 2e6 * depth[:, None, None, None] * np.stack([shape, 1.1 * shape])
    contact = np.zeros((6, 2, 2)) + x0_mm
    contact[..., 0] -= 1e3 * depth[:, None]
    contact[..., 1] += 1e3 * depth[:, None]
    pressure = np.array([80.0, 120.0]) * 133.322
    came = np.array([[came_mm(one, (x, y)) for one in pair] for pair in moved])
    return Table(x, y, inside, depth, pressure, came, stress, contact, Springs())


def solved(_x_mm: float) -> "Future[Table]":
    place: Future[Table] = Future()
    place.set_result(table(_x_mm))
    return place


def test_force_is_linear_between_states_and_held_beyond_them() -> None:
    one = table()
    assert one.press(1e-3, one.pressure_pa[0]).force_n == pytest.approx(0.4)
    assert one.press(1e-3, one.pressure_pa.mean()).force_n == pytest.approx(0.404)
    assert one.press(9e-3, one.pressure_pa[1]).force_n == pytest.approx(1.02)
    assert one.press(0.0, one.pressure_pa[0]).von_mises_pa.max() == 0


def test_the_picture_shows_the_dent_and_not_the_old_surface() -> None:
    one = table()
    picture = one.picture(one.press(2.5e-3, one.pressure_pa[0]))
    middle = np.argmin(abs(one.x_mm - 32))
    top_mm = one.y_mm[np.isfinite(picture[:, middle])].max()
    assert top_mm == pytest.approx(HEIGHT_MM - 2.5, abs=0.4)  # one cell
    far = np.argmin(abs(one.x_mm - 4))
    assert one.y_mm[np.isfinite(picture[:, far])].max() == pytest.approx(HEIGHT_MM, abs=0.4)


def test_the_mouse_presses_and_letting_go_lifts(shoot: Callable[..., None]) -> None:
    application()
    window = FeelWindow(TIHA, solved)
    shoot(window, "feel_lifted")
    area = window.section.viewport()
    vb = window.section.plot.vb
    at = window.section.mapFromScene(vb.mapViewToScene(QPointF(40.0, HEIGHT_MM - 1.5)))
    QTest.mousePress(area, LEFT, pos=QPoint(at.x(), at.y()))
    shoot(window, "feel_pressed")
    assert window.x_mm == 40
    assert window.depth_mm == pytest.approx(1.5, abs=0.2)
    assert window.history[-1][1] > 0.4
    QTest.mouseRelease(area, LEFT, pos=QPoint(at.x(), at.y()))
    assert window.depth_mm == LIFTED_MM


def test_the_arrow_keys_press_within_reach() -> None:
    application()
    window = FeelWindow(TIHA, solved)
    for _ in range(100):
        QTest.keyClick(window, Qt.Key.Key_Right)
        QTest.keyClick(window, Qt.Key.Key_Down)
    assert window.x_mm == 62
    assert window.depth_mm == MAX_DEPTH_MM


def test_a_thin_block_is_pressed_less_deep_than_it_is() -> None:
    assert deepest_mm(changed("TI", tissue={"height_mm": 2.0})) == 1.0
    assert deepest_mm(load_scene("TI")) == MAX_DEPTH_MM


def test_while_solving_and_when_it_fails_the_window_says_so(shoot: Callable[..., None]) -> None:
    application()
    place: Future[Table] = Future()
    window = FeelWindow(TIHA, lambda _x: place)
    shoot(window, "feel_solving")
    assert "Solving x = 32 mm" in window.status.text()
    place.set_exception(RuntimeError("the mesh turned inside out"))
    window.frame()
    assert "turned inside out; press elsewhere" in window.status.text()


def test_the_next_frame_shows_the_press_and_waits_for_nothing() -> None:
    application()
    solving: Future[Table] = Future()  # never done: a frame that waited would hang
    window = FeelWindow(TIHA, lambda x_mm: solved(x_mm) if x_mm == 32 else solving)
    window.timer.stop()
    for depth_mm in (0.5, 1.0, 2.5):
        window.touch(32.0, depth_mm)
        window.frame()
        lowest = window.finger.getData()[1].min()
        assert lowest == pytest.approx(HEIGHT_MM - depth_mm, abs=0.01)
        force_n = window.force_curve.getData()[1][-1]
        assert 0.399 * depth_mm <= force_n <= 0.409 * depth_mm  # 0.4 at 80 mmHg, 0.408 at 120
    window.touch(40.0, 1.0)
    window.frame()
    assert "Solving" in window.status.text()


def test_slow_frames_leave_no_corners_in_the_curves(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a second between frames; between them the probe is taken to have gone down evenly."""
    now_s = [100.0]
    monkeypatch.setattr("probe.gui.feel.perf_counter", lambda: now_s[0])
    application()
    window = FeelWindow(TIHA, solved)
    window.timer.stop()
    for depth_mm in (0.0, 1.0, 2.0, 2.0):
        now_s[0] += 0.5
        window.touch(32.0, depth_mm)
        window.frame()
    time_s, force_n = window.force_curve.getData()
    pressure_mmhg = window.pulse_curve.getData()[1]
    assert np.diff(time_s).max() < 0.021
    depth_m = np.interp(time_s, [-1.5, -1.0, -0.5, 0.0], [0.0, 1e-3, 2e-3, 2e-3])
    expected_n = 400 * depth_m * (1 + 0.02 * (pressure_mmhg - 80) / 40)
    assert force_n == pytest.approx(expected_n, rel=1e-6)
    now_s[0] += 60.0  # a window that was hidden
    window.frame()
    assert len(window.history) < 310


def test_a_solid_is_felt_and_its_cut_is_seen(
    shoot: Callable[..., None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(kept_tables.platformdirs, "user_cache_dir", lambda *_: tmp_path)
    scene = small_solid(16.0, 12.0)
    one = solve(scene, 8.0, 0.8)
    state = one.press(0.8e-3, 0.0)
    assert state.contact_mm[0] + state.contact_mm[1] == pytest.approx(16.0, abs=0.2)
    picture = one.picture(state)
    middle = np.argmin(abs(one.x_mm - 8))
    assert one.y_mm[np.isfinite(picture[:, middle])].max() == pytest.approx(7.2, abs=0.3)
    below = np.argmin(abs(one.y_mm - 7.0))
    assert state.came_mm[below, middle] == pytest.approx([0.0, -0.78], abs=0.08)
    assert np.nanmax(picture[:, middle]) > 5 * np.nanmax(picture[:, np.argmin(abs(one.x_mm - 1))])
    place: Future[Table] = Future()
    place.set_result(one)
    application()
    window = FeelWindow(scene, lambda _x: place)
    window.touch(8.0, 0.8)
    window.frame()
    shoot(window, "feel_solid")
    assert window.status.text() == ""
    assert window.force_curve.getData()[1][-1] == pytest.approx(state.force_n, rel=1e-3)
