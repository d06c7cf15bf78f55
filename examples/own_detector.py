"""A detector of your own on a stored run: the size of the signal at the heart rate, by one sine.

Run: python examples/own_detector.py
"""

import numpy as np

import palpate


def lock_in(station: palpate.Station, rate_hz: float) -> float:
    """Amplitude [Pa] of a sine of known rate in a hold, by least squares beside a straight line."""
    held = (station.time_s >= station.hold_s) & (station.time_s < station.retract_s)
    t, signal = station.time_s[held], station.signal_pa[held].mean(axis=1)
    turn = 2 * np.pi * rate_hz * t
    columns = np.column_stack([np.ones_like(t), t, np.cos(turn), np.sin(turn)])
    weights, *_ = np.linalg.lstsq(columns, signal, rcond=None)
    return float(np.hypot(weights[2], weights[3]))


result = palpate.scan(scene="TIHA", seed=1)
recording = palpate.open_run(result.path).recording()
for station in recording.stations:
    print(f"{1e3 * station.x_m:5.1f} mm  {lock_in(station, 1 / 0.825):7.1f} Pa")
