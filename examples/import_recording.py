"""A recording made elsewhere becomes a run: forces of one press, and what detection says of it.

Run: python examples/import_recording.py
"""

import csv
from pathlib import Path

import numpy as np

import palpate

rng = np.random.default_rng(1)
time_s = np.arange(0.0, 8.0, 0.01)
ramp = np.clip(time_s, 0.0, 1.0)
# 72 beats a minute, not quite even; each rises fast and decays, with a second crest.
beats_s = np.cumsum(rng.normal(0.83, 0.03, 12))
since_s = time_s[:, None] - beats_s
beat = (since_s > 0) * (
    np.exp(-(((since_s - 0.12) / 0.07) ** 2)) + 0.4 * np.exp(-(((since_s - 0.38) / 0.11) ** 2))
)
force_n = 0.8 * ramp + 0.02 * beat.sum(axis=1) + 1e-3 * rng.standard_normal(len(time_s))
with Path("press.csv").open("w", newline="") as file:
    rows = csv.writer(file)
    rows.writerow(["time_s", "force_n"])
    rows.writerows(zip(time_s, force_n, strict=True))

imported = palpate.import_csv("press.csv", "press.run", face_mm2=100.0)
finding = palpate.detect(palpate.open_run(imported.path).recording())
print(finding.finding, finding.reason)
