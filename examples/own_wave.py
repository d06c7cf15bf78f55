"""A scene with a pressure wave of your own: a CSV file with one beat.

Run: python examples/own_wave.py
"""

import csv
import math
from pathlib import Path

import palpate

wave = Path("wave.csv").resolve()
with wave.open("w", newline="") as file:
    rows = csv.writer(file)
    rows.writerow(["time_s", "pressure_mmhg"])
    for n in range(101):
        phase = n / 100
        rows.writerow([0.8 * phase, 95 + 20 * math.sin(2 * math.pi * phase) * (1 - phase / 2)])

healthy = palpate.load_scene("TIHA")
pulse = healthy.pulse.model_copy(update={"wave": str(wave), "rate_bpm": 75.0})
scene = healthy.model_copy(update={"name": "own wave", "pulse": pulse})
rig = palpate.default_rig()
with palpate.connect(rig, clock := palpate.SimulatedClock(), scene) as devices:
    plan = palpate.plan_for(rig)
    events: list[object] = []
    ended = palpate.run_scan(
        plan, devices.stage, devices.sensors, clock, events.append, palpate.limits_for(rig, plan)
    )
print(ended.finish, f"{len(events)} events")
