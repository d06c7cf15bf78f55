"""The hold-down curve of a press in steps: force and pulse at each depth that was held."""

from dataclasses import replace

import numpy as np

from probe.core.recording import Recording, Station
from probe.detection.finding import StepFinding
from probe.detection.pulse.presses import presses_of

STILL_M = 20e-6
"""Reported poses of a stage at rest jitter by this (`probe.guards.pose_guard`)."""
WHOLE = 0.9
"""Share of a step's time for which it must have been still to be one."""


def hold_down(recording: Recording, false_alarm: float) -> tuple[StepFinding, ...]:
    """Every step of every station, ascending, its last hold included; none without steps.

    Each is judged as a hold of its own, at the heart rate that all share.
    """
    if recording.step_hold_s <= 0:
        return ()
    stations = [
        step
        for station in recording.stations
        for step in (*_steps(station, recording.step_hold_s), station)
    ]
    held = tuple(replace(station, index=n) for n, station in enumerate(stations))
    presses = presses_of(replace(recording, stations=held), false_alarm)
    return tuple(
        StepFinding(
            station=station.index + 1,
            depth_m=_depth_m(station),
            force_n=recording.face_m2 * press.level_pa,
            pulse_n=recording.face_m2 * press.size_pa,
            pulse_sd_n=recording.face_m2 * (press.pulse.size_sd_pa if press.pulse else np.nan),
        )
        for station, press in zip(stations, presses, strict=True)
    )


def _steps(station: Station, hold_s: float) -> list[Station]:
    """Where the way in stood still for ``hold_s``, each as if it were the station's hold."""
    way = (station.time_s >= station.indent_s) & (station.time_s < station.hold_s)
    time_s, depth_m = station.time_s[way], station.depth_m[way]
    steps, first = [], 0
    while first < len(time_s):
        moved = np.abs(depth_m[first:] - depth_m[first]) > STILL_M
        end = first + int(moved.argmax()) if moved.any() else len(time_s)
        if time_s[end - 1] - time_s[first] >= WHOLE * hold_s:
            end_s = float(time_s[end - 1])
            steps.append(replace(station, hold_s=end_s - WHOLE * hold_s, retract_s=end_s))
            first = end
        else:
            first += max((end - first) // 2, 1)
    return steps


def _depth_m(station: Station) -> float:
    held = (station.time_s >= station.hold_s) & (station.time_s < station.retract_s)
    return float(np.median(station.depth_m[held])) if held.any() else float("nan")
