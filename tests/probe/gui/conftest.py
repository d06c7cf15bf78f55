"""Runs to look at, made of events; windows offscreen; screenshots kept under build/screenshots/."""

import gc
import os
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from paths import ROOT
from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QApplication

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")


from drivers import Block, Channel
from probe.core.events import (
    Event,
    Finish,
    Phase,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.gui.style import application
from sim_backend import load_scene

PERIOD_S = 0.825
SCREENSHOTS = ROOT / "build" / "screenshots"


def a_run(rows: int = 1, columns: int = 15, taxels: int = 1) -> list[Event]:
    """A finished scan whose pulse and baseline are strongest at x = 32 mm."""
    places = [(c, r) for r in range(rows) for c in range(columns)]
    xy = [(4.0 * (c + 1), 4.0 * r) for c, r in places]
    channels = {
        "virtual": tuple(Channel(f"force{n}", "N", "force", True) for n in range(taxels)),
        "stage": tuple(Channel(n, "m", simulated=True) for n in "xyz"),
    }
    config = {
        "plan": {"stations": [[n, x, y] for n, (x, y) in enumerate(xy)], "indentation_mm": 2.5},
        "scene": load_scene("TIHA").model_dump(mode="json"),
        "face_mm2": 100.0,
        "versions": {"palpate": "0"},
    }
    events: list[Event] = [RunStarted(0.0, "2026-01-01T00:00:00", config, channels)]
    for n, (x, y) in enumerate(xy):
        events += _press(n, 2.5 * n, x * 1e-3, y * 1e-3, taxels)
    return [*events, RunEnded(2.5 * len(xy), Finish.COMPLETED, "every station is complete")]


def _press(n: int, start: float, x_m: float, y_m: float, taxels: int) -> list[Event]:
    near = float(np.exp(-(((x_m - 0.032) / 0.008) ** 2)))
    marks = {
        0.0: Phase.TRAVELLING, 0.4: Phase.INDENTING, 1.4: Phase.HOLDING,
        1.4 + PERIOD_S: Phase.RETRACTING,
    }  # fmt: skip
    events: list[Event] = [StationStarted(start, n, 1, x_m, y_m)]
    for k in range(25):
        t = 0.1 * k + np.arange(0, 0.1, 0.01)
        events += [
            PhaseEntered(start + at, phase, n)
            for at, phase in marks.items()
            if 0.1 * k <= at < 0.1 * k + 0.1
        ]
        depth = np.interp(t, [0.4, 1.4, 1.4 + PERIOD_S, 2.4], [0, 1, 1, 0])
        beat = np.sin(2 * np.pi * (t - 1.4) / PERIOD_S) * (t >= 1.4) * (depth >= 1)
        force = depth * (0.9 + 0.06 * near) + 0.004 * near * beat
        spread = np.linspace(0.8, 1.2, taxels)
        values = force[:, None] * spread
        events.append(
            Samples("virtual", Block(start + t, values, np.zeros(values.shape, bool)), n, 1)
        )
        pose = np.column_stack([np.full(10, x_m), np.full(10, y_m), 1e-3 - 3.5e-3 * depth])
        events.append(Samples("stage", Block(start + t, pose, np.zeros((10, 3), bool)), n, 1))
    return [*events, StationEnded(start + 2.45, n, 1, True)]


@pytest.fixture(autouse=True)
def _widgets_are_collected_by_their_thread() -> Iterator[None]:
    """Qt ends the process where another thread collects a widget, or its parts in any order."""
    yield
    # pyqtgraph's own menus and panels go with them
    every = QApplication.topLevelWidgets()
    for window in [one for one in every if type(one).__module__.startswith("probe.")]:
        window.deleteLater()
        QApplication.sendPostedEvents(window, QEvent.Type.DeferredDelete.value)
    gc.collect()


@pytest.fixture(autouse=True)
def _plain_size() -> None:
    application()


@pytest.fixture
def make_run() -> Callable[..., list[Event]]:
    return a_run


@pytest.fixture
def shoot() -> Callable[..., None]:
    """Show a window at a size, keep its picture, and check that something is on it."""
    app = application()

    def take(window: Any, name: str, size: tuple[int, int] = (1366, 768)) -> None:
        SCREENSHOTS.mkdir(parents=True, exist_ok=True)
        window.resize(*size)
        window.show()
        for _ in range(3):
            window.frame()
            app.processEvents()
        picture = window.grab()
        assert (picture.width(), picture.height()) == size, "the window does not fit the screen"
        assert picture.save(str(SCREENSHOTS / f"{name}.png"))

    return take
