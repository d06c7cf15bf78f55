"""Feel the phantom: press with the mouse or the arrow keys and see what the probe would feel."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from time import perf_counter

import numpy as np
from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QKeyEvent, QMouseEvent, QPainter
from PySide6.QtWidgets import QHBoxLayout, QVBoxLayout, QWidget

from drivers.core.processes import Workers
from probe.gui.body import draw_scene, finger_outline, frame_scene
from probe.gui.heat_map import HeatMap
from probe.gui.style import application, label, open_at, pen, plot, text, until_closed
from probe.gui.table import Table, solve
from probe.report.look import BLUE, GREEN, VERMILLION
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG, load_wave

FRAME_MS = 16
PLACE_MM = 2.0  # places are solved on this grid; the probe snaps to it
MAX_DEPTH_MM, MAX_SHARE = 2.5, 0.5  # the deepest press, and of a thin block's height
LIFTED_MM = -2.0
KEY_DEPTH_MM = 0.1
HISTORY_S = 6.0
SAMPLE_S = 0.02  # between points of the curves, however long a frame takes

Prepare = Callable[[float], "Future[Table]"]
"""Begins to solve the place at x [mm]."""


class FeelWindow(QWidget):
    """``prepare`` is asked once for each place; until it answers the window says so."""

    def __init__(self, scene: Scene, prepare: Prepare) -> None:
        super().__init__()
        self.setWindowTitle(f"palpate feel: {scene.name}")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.scene, self._prepare = scene, prepare
        self._wave = load_wave(scene.pulse)
        self._places: dict[float, Future[Table]] = {}
        middle = scene.inclusion[0].x_mm if scene.inclusion else 32.0
        width = scene.tissue.width_mm if scene.tissue is not None else 2 * middle
        self._reach_mm = (PLACE_MM, width - PLACE_MM)
        self.x_mm = self._snap(middle)
        self.depth_mm = LIFTED_MM
        self._began_s = perf_counter()
        self._before = (0.0, self.x_mm, LIFTED_MM)  # time, place and depth of the last frame
        self.history: deque[tuple[float, float, float]] = deque()
        self._build(scene)
        open_at(self, 1280, 700)
        self.timer = QTimer(self)
        self.timer.timeout.connect(self.frame)
        self.timer.start(FRAME_MS)

    def _build(self, scene: Scene) -> None:
        head = text("SIMULATED: the phantom " + scene.name, "simulated")
        help_text = text(
            "Hold the left mouse button and drag over the section, or use the arrow keys: "
            "left and right move, down presses, up lifts."
        )
        self.readout, self.status = text(look="finding"), text()
        self.section = HeatMap("", "von Mises [kPa]")
        self.section.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        label(self.section.plot, ("x", "mm"), ("height", "mm"))
        draw_scene(self.section.plot, scene)
        frame_scene(self.section.plot, scene)
        self.finger = self.section.plot.plot([], [], pen=pen(GREEN, 3))
        self.contact = self.section.plot.plot([], [], pen=pen(VERMILLION, 5))
        self.section.scene().installEventFilter(self)
        self.section.viewport().installEventFilter(self)
        self.force = plot("", ("time before now", "s"), ("force", "N"))
        self.force_curve = self.force.plot(pen=pen(BLUE, 2))
        self.pulse = plot("", ("time before now", "s"), ("lumen pressure", "mmHg"))
        self.pulse_curve = self.pulse.plot(pen=pen(VERMILLION, 2))
        self.force.setXRange(-HISTORY_S, 0, padding=0)
        self.pulse.setXLink(self.force)
        pulse = scene.pulse
        self.pulse.setYRange(pulse.diastolic_mmhg, pulse.systolic_mmhg)
        curves = QVBoxLayout()
        curves.addWidget(self.force, 3)
        curves.addWidget(self.pulse, 2)
        middle = QHBoxLayout()
        middle.addWidget(self.section, 3)
        middle.addLayout(curves, 2)
        layout = QVBoxLayout(self)
        layout.addWidget(head)
        layout.addWidget(help_text)
        layout.addLayout(middle, 1)
        layout.addWidget(self.readout)
        layout.addWidget(self.status)

    def touch(self, x_mm: float, depth_mm: float) -> None:
        """Put the probe over ``x_mm`` at ``depth_mm``, both clamped to what can be reached."""
        self.x_mm = self._snap(x_mm)
        self.depth_mm = float(np.clip(depth_mm, LIFTED_MM, deepest_mm(self.scene)))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if watched is self.section.viewport() and isinstance(event, QMouseEvent):
            if event.type() is QEvent.Type.MouseButtonRelease:
                self.touch(self.x_mm, LIFTED_MM)
                return True
            if event.buttons() & Qt.MouseButton.LeftButton:
                on_scene = self.section.mapToScene(event.position().toPoint())
                at = self.section.plot.vb.mapSceneToView(on_scene)
                self.touch(at.x(), self.scene.surface_mm - at.y())
                return True
        return super().eventFilter(watched, event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        step = {
            Qt.Key.Key_Left: (-PLACE_MM, 0.0),
            Qt.Key.Key_Right: (PLACE_MM, 0.0),
            Qt.Key.Key_Down: (0.0, KEY_DEPTH_MM),
            Qt.Key.Key_Up: (0.0, -KEY_DEPTH_MM),
        }.get(Qt.Key(event.key()))
        if step is None:
            super().keyPressEvent(event)
        else:
            self.touch(self.x_mm + step[0], self.depth_mm + step[1])

    def frame(self) -> None:
        """Draw the present press; never waits for a solution."""
        now_s = perf_counter() - self._began_s
        pressure_pa = float(self._wave.pressure_pa(np.array([now_s]))[0])
        x, y = finger_outline(self.scene.indenter)
        self.finger.setData(x + self.x_mm, y + self.scene.surface_mm - self.depth_mm)
        table = self._table()
        if table is None:
            self.section.image.clear()
            self.contact.setData([], [])
            self._before = (now_s, self.x_mm, LIFTED_MM)
            return
        state = table.press(max(self.depth_mm, 0.0) * 1e-3, pressure_pa)
        dx, dy = table.x_mm[1] - table.x_mm[0], table.y_mm[1] - table.y_mm[0]
        box = (table.x_mm[0] - dx / 2, table.y_mm[0] - dy / 2,
               dx * len(table.x_mm), dy * len(table.y_mm))  # fmt: skip
        self.section.show_table(table.picture(state) / 1e3, box, (0.0, table.highest_pa / 1e3))
        self._curves(now_s, table)
        self._numbers(state.force_n, state.contact_mm)

    def _curves(self, now_s: float, table: Table) -> None:
        """Force and pressure up to now; since the last frame the probe went down evenly."""
        last_s, x_mm, last_mm = self._before
        last_s = max(last_s, now_s - HISTORY_S)
        last_mm = last_mm if x_mm == self.x_mm else self.depth_mm
        self._before = (now_s, self.x_mm, self.depth_mm)
        part = np.linspace(0, 1, 1 + max(1, round((now_s - last_s) / SAMPLE_S)))[1:]
        t = last_s + part * (now_s - last_s)
        depth_m = 1e-3 * (last_mm + part * (self.depth_mm - last_mm))
        pressure_pa = self._wave.pressure_pa(t)
        force_n = np.where(depth_m > 0, table.force_n(depth_m, pressure_pa), 0.0)
        self.history.extend(zip(t, force_n, pressure_pa / PA_PER_MMHG, strict=True))
        while self.history[0][0] < now_s - HISTORY_S:
            self.history.popleft()
        t, force_n, pressure_mmhg = np.array(self.history).T
        self.force_curve.setData(t - now_s, force_n)
        self.pulse_curve.setData(t - now_s, pressure_mmhg)

    def _numbers(self, force_n: float, contact_mm: tuple[float, float]) -> None:
        pressing = self.depth_mm > 0
        force_n = force_n if pressing else 0.0
        wide = contact_mm[1] - contact_mm[0] if pressing else 0.0
        height = self.scene.surface_mm - self.depth_mm
        self.contact.setData(contact_mm if pressing else [], [height] * 2 if pressing else [])
        self.readout.setText(
            f"x {self.x_mm:.0f} mm   depth {max(self.depth_mm, 0):.2f} mm   force {force_n:.3f} N"
            f"   stress {force_n / self.scene.face_mm2 * 1e3:.2f} kPa   contact {wide:.1f} mm"
        )

    def _table(self) -> Table | None:
        if self.x_mm not in self._places:
            self._places[self.x_mm] = self._prepare(self.x_mm)
        place = self._places[self.x_mm]
        if not place.done():
            self.status.setText(f"Solving x = {self.x_mm:.0f} mm; other places stay ready")
            return None
        error = place.exception()
        if error is not None:
            self.status.setText(f"x = {self.x_mm:.0f} mm: {error}; press elsewhere")
            return None
        self.status.setText("")
        return place.result()

    def _snap(self, x_mm: float) -> float:
        return float(np.clip(PLACE_MM * round(x_mm / PLACE_MM), *self._reach_mm))


def deepest_mm(scene: Scene) -> float:
    """How deep the probe can be pushed."""
    return min(MAX_DEPTH_MM, MAX_SHARE * scene.surface_mm)


def run_feel(scene: Scene) -> int:
    """Feel ``scene`` until the window is closed; the exit status.

    Solving runs in a process of its own, so that no frame waits for it.
    """
    application()
    with Workers(1) as solver:

        def prepare(x_mm: float) -> "Future[Table]":
            return solver.submit(solve, scene, x_mm, deepest_mm(scene))

        window = FeelWindow(scene, prepare)
        status = until_closed(window)
        solver.shutdown(wait=False, cancel_futures=True)
    return status
