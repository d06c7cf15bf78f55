"""How fast the windows draw: 64 channels at 1 kHz with a 256 x 256 map, and the phantom's feel.

Run: QT_QPA_PLATFORM=offscreen python benchmarks/live_view.py [PICTURE.png]
Measures frame times, the time from a sample to the picture that shows it, and how long a press of
the phantom takes to the screen. Prints percentiles, and keeps every frame in
`docs/results/windows.csv` (delete it to measure anew).
"""

import os
from collections import deque
from concurrent.futures import Future
from pathlib import Path
from time import perf_counter

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
from kept import ROOT, fill, run

from drivers import Block, Channel
from probe.core.events import Event, Phase, PhaseEntered, RunStarted, Samples, StationStarted
from probe.gui.app import Follower
from probe.gui.feel import MAX_DEPTH_MM, FeelWindow
from probe.gui.style import application
from probe.gui.table import Table, solve
from probe.gui.window import FRAME_MS, RunWindow
from sim_backend import load_scene

OUT = ROOT / "docs" / "results" / "windows.csv"
CHANNELS, RATE_HZ, SIDE, BLOCK_S, SECONDS = 64, 1000.0, 256, 0.02, 12.0


def start() -> list[Event]:
    """A run of 256 x 256 stations with an array of 64 taxels."""
    stations = [[n, n % SIDE, n // SIDE] for n in range(SIDE * SIDE)]
    config = {"plan": {"stations": stations}, "scene": None, "face_mm2": 100.0}
    taxels = tuple(Channel(f"t{n}", "Pa", "taxel") for n in range(CHANNELS))
    return [
        RunStarted(0.0, "2026-01-01T00:00:00", config, {"array": taxels}),
        StationStarted(0.0, 0, 1, 0.0, 0.0),
        PhaseEntered(0.0, Phase.HOLDING, 0),
    ]


def main(picture: str = "") -> None:
    app = application()
    waiting: deque[Event] = deque(start())

    def events():  # type: ignore[no-untyped-def]
        while True:
            yield waiting.popleft() if waiting else None

    follower = Follower(events())
    follower()
    rng = np.random.default_rng(0)
    follower.state.maps.update({n: (float(rng.normal(9e3, 300)), 50.0) for n in range(SIDE * SIDE)})
    follower.state.pressed.extend(reversed(range(SIDE * SIDE)))
    window = RunWindow(Path("benchmark.run"), follower)
    window.timer.stop()
    window.resize(1366, 768)
    window.show()
    frames, latencies = [], []
    began = sent = perf_counter()
    while (now := perf_counter()) - began < SECONDS:
        due = int((now - sent) / BLOCK_S)
        for k in range(due):
            t = sent - began + k * BLOCK_S + np.arange(0, BLOCK_S, 1 / RATE_HZ)
            values = 9e3 + rng.normal(0, 20, (len(t), CHANNELS))
            waiting.append(Samples("array", Block(t, values, np.zeros(values.shape, bool)), 0, 1))
        sent += due * BLOCK_S
        drawing = perf_counter()
        window.frame()
        app.processEvents()
        done = perf_counter()
        frames.append(done - drawing)
        latencies.append(done - began - follower.state.now_s)
        while perf_counter() - drawing < FRAME_MS / 1e3:
            app.processEvents()
    if picture:
        window.grab().save(picture)
    window.close()
    for name, values_s in (
        ("one frame", frames), ("from sample to screen", latencies),
        ("`feel`: from press to picture", feel()),
    ):  # fmt: skip
        p50, p95 = np.percentile(1e3 * np.array(values_s[10:]), (50, 95))
        print(f"{name:30s} p50 {p50:6.1f} ms   p95 {p95:6.1f} ms   n {len(values_s)}")
        keep(name, values_s[10:])


def keep(name: str, values_s: list[float]) -> None:
    """A row for each frame, unless they are kept already."""
    load = f"{os.getloadavg()[0]:.1f}"
    fill(OUT, ("what", "n"), ("ms", "load"), [(name, n) for n in range(len(values_s))],
         lambda _, n: {"ms": f"{1e3 * values_s[n]:.2f}", "load": load})  # fmt: skip


def feel(frames: int = 300) -> list[float]:
    """Seconds for each frame while the finger goes down over an artery that was solved before."""
    scene = load_scene("TIHA")
    place: Future[Table] = Future()
    place.set_result(solve(scene, 32.0, MAX_DEPTH_MM))
    window = FeelWindow(scene, lambda _x_mm: place)
    window.timer.stop()
    window.show()
    app, took = application(), []
    for n in range(frames):
        began = perf_counter()
        window.touch(32.0, MAX_DEPTH_MM * n / frames)
        window.frame()
        app.processEvents()
        took.append(perf_counter() - began)
    return took


if __name__ == "__main__":
    run(main)
