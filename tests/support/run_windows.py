"""A window on a run that is made of events."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt

from probe.core.events import Event
from probe.gui.state import ViewState
from probe.gui.window import RunWindow

Make = Callable[..., list[Event]]
Shoot = Callable[..., None]
LEFT = Qt.MouseButton.LeftButton
FINDING = {
    "finding": "artery",
    "objects": [
        {"kind": "artery", "position_mm": 32.0, "position_ci_mm": [31.5, 32.5], "confidence": 0.98}
    ],
    "heart_rate_bpm": None,
    "stations": [],
}


def state_of(events: Iterable[Event]) -> ViewState:
    """What a window knows once it has seen them."""
    state = ViewState()
    for event in events:
        state.update(event)
    return state


def window_on(events: list[Event], asked: list[str] | None = None, **kwargs: Any) -> RunWindow:
    state, ask = state_of(events), None if asked is None else asked.append
    return RunWindow(Path("a.run"), lambda: state, ask=ask, **kwargs)


def measured(count: int) -> list[dict[str, float | None]]:
    one = {"baseline_pa": 1.0, "pulse_pa": 2.0, "pulse_below_pa": None}
    return [{"station": n + 1, **one} for n in range(count)]
