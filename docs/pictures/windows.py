"""Draws the windows' pictures from scans of the phantom: `python docs/pictures/windows.py`."""

import os
import tempfile
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from time import perf_counter

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from PySide6.QtWidgets import QWidget

import palpate
from probe.gui.feel import HISTORY_S, MAX_DEPTH_MM, FeelWindow
from probe.gui.replay import PairWindow
from probe.gui.state import ViewState
from probe.gui.style import application
from probe.gui.table import Table, solve
from probe.gui.window import RunWindow

HERE = Path(__file__).parent
SEEN, HELD = 10, 350
"""Stations that the first picture has seen, and samples of the last one's hold."""


def save(window: QWidget, name: str) -> None:
    """The window as it is, in a file of this folder."""
    window.resize(1280, 720)
    window.show()
    window.frame()  # type: ignore[attr-defined]
    application().processEvents()
    window.grab().save(str(HERE / name))
    window.close()


def main() -> None:
    """A running scan, two runs side by side, and the phantom pressed by hand."""
    application()
    with tempfile.TemporaryDirectory() as folder:
        runs = [palpate.open_run(palpate.scan(scene=name, out=Path(folder), seed=1).path)
                for name in ("TIHA", "TISA")]  # fmt: skip
        events = [list(run.events()) for run in runs]
        recording = runs[0].recording()
    state = ViewState()
    for event in events[0]:
        state.update(event)
        if state.station == SEEN - 1 and len(state.hold()[0]) > HELD:
            break
    found = palpate.detect(
        replace(recording, stations=recording.stations[: SEEN - 1], finish="faulted")
    ).as_json()
    save(RunWindow(runs[0].path, lambda: state, lambda: found, lambda _: None), "window-scan.png")
    pair = PairWindow(("healthy: TIHA", "stenotic: TISA"), (events[0], events[1]))
    pair.bar.slider.setValue(pair.bar.slider.maximum())
    save(pair, "window-pair.png")
    place: Future[Table] = Future()
    place.set_result(solve(palpate.load_scene("TIHA"), 32.0, MAX_DEPTH_MM))
    feel = FeelWindow(palpate.load_scene("TIHA"), lambda _: place)
    began_s = perf_counter()
    while (gone_s := perf_counter() - began_s) < HISTORY_S - 0.5:  # a press, then beats held
        feel.touch(32.0, min(2.2 * gone_s, 2.2))
        feel.frame()
        application().thread().msleep(16)
    save(feel, "window-feel.png")


if __name__ == "__main__":
    main()
