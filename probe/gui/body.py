"""What lies under the probe, drawn to scale: outlines of the scene and the rigid finger."""

import numpy as np
import pyqtgraph as pg
from PySide6.QtWidgets import QWidget

from probe.gui.state import ViewState
from probe.gui.style import box, head, pen, plot
from probe.report.look import GREEN, INK, PURPLE, VERMILLION
from sim_backend.scene.inclusion import Artery
from sim_backend.scene.indenter import Cylinder, Indenter
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.slicing import section_at, under_finger

LIFT_MM = 6.0  # room above the surface: a scan's clearance and a little more
CIRCLE = np.linspace(0, 2 * np.pi, 61)


def finger_outline(indenter: Indenter) -> tuple[np.ndarray, np.ndarray]:
    """The finger's underside (x, y) [mm], as it leans, its lowest point at y = 0."""
    x, y = 1e3 * indenter.profile.outline().T
    top = y.max() + 4.0  # the flanks go on
    x, y = np.r_[x[0], x, x[-1]], np.r_[top, y, top]
    lean = np.radians(indenter.leaning_deg)
    x, y = x * np.cos(lean) + y * np.sin(lean), y * np.cos(lean) - x * np.sin(lean)
    return x, y - y.min()


def draw_scene(area: pg.PlotItem, scene: Scene) -> None:
    """Outlines of block, vessels and lumps; heights in mm above the support."""
    top = scene.surface_mm
    if scene.tissue is not None:
        w = scene.tissue.width_mm
        area.plot([0, w, w, 0, 0], [0, 0, top, top, 0], pen=pen(INK, 2))
    for one in under_finger(scene):
        y = top - one.depth_mm if scene.tissue is not None else top / 2
        radii = [one.outer_radius_mm]
        colour = PURPLE
        if isinstance(one, Artery):
            inner = one.inner_diameter_mm / 2
            radii.append(inner)
            if one.stenosis is not None:
                radii.append(inner * (1 - one.stenosis.fraction))
            colour = VERMILLION
        for r in radii:
            area.plot(one.x_mm + r * np.cos(CIRCLE), y + r * np.sin(CIRCLE), pen=pen(colour, 2))


def frame_scene(area: pg.PlotItem, scene: Scene) -> None:
    """Keep the view on ``scene`` with a lifted finger, wherever the finger goes."""
    x, y = finger_outline(scene.indenter)
    if scene.tissue is not None:
        left, right = 0.0, scene.tissue.width_mm
    else:
        ends = [(one.x_mm - one.outer_radius_mm, one.x_mm + one.outer_radius_mm)
                for one in scene.inclusion]  # fmt: skip
        left, right = min(e[0] for e in ends), max(e[1] for e in ends)
    area.setXRange(left + x.min() / 2, right + x.max() / 2, padding=0)
    area.setYRange(-1.0, scene.surface_mm + LIFT_MM + y.max(), padding=0)


class BodyPanel(QWidget):
    """Where the probe is over the section of its row; without a known scene, over the surface."""

    def __init__(self) -> None:
        super().__init__()
        self.area = plot("", ("x", "mm"), ("height", "mm"))
        self.area.setAspectLocked(True)
        box(self, self.area)
        self.finger = self.area.plot([], [], pen=pen(GREEN, 3))
        self._started_utc = ""
        self._scene: Scene | None = None
        self._row_mm: float | None = None
        self._top_mm = 0.0
        self._outline = finger_outline(Cylinder())

    def show_state(self, state: ViewState) -> None:
        if state.started_utc != self._started_utc:
            self._started_utc = state.started_utc
            self._start(state)
        place = state.place()
        if self._scene is not None:
            self._cut(self._scene, 0.0 if place is None else place.y_mm)
        tip = state.tip_m()
        if tip is not None:
            x, y = self._outline
            above_mm = 1e3 * tip[2] - (0.0 if place is None else place.surface_mm)
            self.finger.setData(x + 1e3 * tip[0], y + self._top_mm + above_mm)

    def _start(self, state: ViewState) -> None:
        self._clear()
        written = state.config.get("scene")
        if written:
            self._scene = scene = Scene.model_validate(written)
            head(self.area, f"{scene.name} (known section)")
            frame_scene(self.area.getPlotItem(), scene)
            self._top_mm, self._outline = scene.surface_mm, finger_outline(scene.indenter)
        else:
            head(self.area, "Section unknown: the surface only")
            ends = [p.x_mm for p in state.plan if np.isfinite(p.x_mm)] or [0.0, 1.0]
            left, right = float(self._outline[0].min()), float(self._outline[0].max())
            self.area.plot([min(ends) + left, max(ends) + right], [0, 0], pen=pen(INK, 2))

    def _cut(self, scene: Scene, y_mm: float) -> None:
        """Draw what lies under the row at ``y_mm``, unless it is drawn."""
        if y_mm != self._row_mm:
            self._clear()
            draw_scene(self.area.getPlotItem(), section_at(scene, y_mm))
            self._row_mm = y_mm

    def _clear(self) -> None:
        self._row_mm = None
        for curve in self.area.getPlotItem().listDataItems():
            if curve is not self.finger:
                self.area.removeItem(curve)
