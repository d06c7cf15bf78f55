"""Recordings of a row and of a grid, strongest at x = 32 mm, and what is found in them."""

import numpy as np

from drivers import Channel
from probe.core.events import RunStarted
from probe.core.recording import Recording, Station

FACE_M2 = 1e-4


def station(index: int, x_m: float, y_m: float = 0.0) -> Station:
    """A press of 1 s and a hold with one beat, strongest at 32 mm."""
    t = np.arange(0, 2.2, 0.01)
    near = np.exp(-(((x_m - 0.032) / 0.008) ** 2))
    ramp = np.clip(t, 0, 1)
    beat = np.where((t > 1) & (t < 1.825), np.sin(2 * np.pi * (t - 1) / 0.825), 0.0)
    signal = 9000 * ramp + near * (600 * ramp + 40 * beat)
    return Station(
        index, x_m, y_m, t + 5, signal[:, None], np.zeros((len(t), 1), bool), 5.0, 6.0, 6.825,
        2.5e-3 * ramp,
    )  # fmt: skip


def row() -> Recording:
    stations = tuple(station(n, 4e-3 * (n + 1)) for n in range(15))
    return Recording(stations, ("virtual.force",), ("virtual.force",), FACE_M2)


def grid() -> Recording:
    stations = tuple(
        station(8 * j + i, 4e-3 * (i + 4), 4e-3 * j) for j in range(5) for i in range(8)
    )
    return Recording(stations, ("virtual.force",), (), FACE_M2)


def finding(recording: Recording) -> dict[str, object]:
    stations = [
        {
            "station": s.index + 1,
            "x_mm": 1e3 * s.x_m,
            "y_mm": 1e3 * s.y_m,
            "baseline_pa": 9000.0,
            "baseline_sd_pa": 2.0,
            "pulse_sd_pa": 5.0,
            "pulse_below_pa": None,
            "pulse_pa": float(np.ptp(s.signal_pa[110:180])),
        }
        for s in recording.stations
    ]
    one = {
        "kind": "artery", "position_mm": 32.0, "position_ci_mm": [31.4, 32.6], "peak_pa": 9600.0,
        "pulse_pa": 80.0, "confidence": 0.99,
    }  # fmt: skip
    return {"finding": "artery", "objects": [one], "stations": stations}


def started() -> RunStarted:
    config = {"scene": None, "plan": {"indentation_mm": 2.5}, "versions": {"palpate": "0.1.0"}}
    force = Channel("force", "N", "force", simulated=True)
    return RunStarted(0.0, "2026-01-01T00:00:00+00:00", config, {"virtual": (force,)})
