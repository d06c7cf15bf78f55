"""How often the interval of a heart's rate holds it in rows of holds of 0.8 to 1.8 s.

    python benchmarks/heart_rates.py [ROWS]

Each row is drawn: seven presses over a vessel, 0.8 to 2.2 beats of the paper's wave or a brachial
one in a hold, tissue that relaxes by a power law or a stretched exponential, which no few decays
are, or not at all. Goes on where docs/results/heart-rates.csv ends.
"""

import numpy as np
import pandas as pd
from kept import ROOT, Row, exact, fill, run
from short_holds import LEVEL_PA, SWING_PA, WAVES

from palpate import Recording, Station, detect
from sim_backend.scene.waves import load_wave

OUT = ROOT / "docs" / "results" / "heart-rates.csv"
PULSE_PA, NOISE_PA, SAMPLE_HZ = 250.0, 5.0, 250.0
DEPTH_M = 2.5e-3


def judge(seed: int) -> Row | None:
    """One row; None where its heart would beat slower than 42 or faster than 170 a minute."""
    rng = np.random.default_rng([13, seed])
    hold_s, beats = float(rng.choice([0.8, 1.0, 1.2, 1.5, 1.8])), float(rng.uniform(0.8, 2.2))
    relaxing, wave = str(rng.choice(["power", "stretched", "none"])), WAVES[int(rng.integers(2))]
    rate_bpm = 60 * beats / hold_s
    if not 42 < rate_bpm < 170:
        return None
    t = np.arange(int(hold_s * SAMPLE_HZ)) / SAMPLE_HZ
    level = {"power": 1 + 0.06 * (1 + t / 0.15) ** -0.3, "none": np.ones(len(t)),
             "stretched": 1 + 0.06 * np.exp(-((t / 1.5) ** 0.5))}[relaxing]  # fmt: skip
    stations = []
    for n, x_m in enumerate(4e-3 * np.arange(1, 8)):
        near = float(np.exp(-np.log(2) * ((x_m - 16e-3) / 6e-3) ** 2))
        pressure_pa = load_wave(wave).pressure_pa(beats * t / hold_s + rng.uniform())
        signal = LEVEL_PA * (1 + 0.1 * near) * level + PULSE_PA * near / SWING_PA * pressure_pa
        signal = signal + NOISE_PA * rng.standard_normal(len(t))
        stations.append(Station(
            n, float(x_m), 0.0, t + 10, signal[:, None], np.zeros((len(t), 1), dtype=bool), 9.0,
            10.0, 10 + t[-1], np.full(len(t), DEPTH_M),
        ))  # fmt: skip
    said = detect(Recording(tuple(stations), ("force",), (), 1e-4)).heart_rate_bpm
    if said is None:
        return {"relaxing": relaxing, "found": "no pulse"}
    rate, low, high = said
    return {"wave": wave.wave, "relaxing": relaxing, "hold_s": hold_s, "beats": f"{beats:.3f}",
            "beats_found": f"{rate * hold_s / 60:.3f}", "low_bpm": f"{low:.1f}",
            "high_bpm": f"{high:.1f}", "rate_bpm": f"{rate_bpm:.1f}",
            "found": "in the interval" if low <= rate_bpm <= high else "outside"}  # fmt: skip


def main(rows: int = 600) -> None:
    """Judge, tell."""
    answers = ("wave", "relaxing", "hold_s", "beats", "beats_found", "low_bpm", "high_bpm",
               "rate_bpm", "found")  # fmt: skip
    fill(OUT, ("seed",), answers, [(seed,) for seed in range(rows)], judge)
    table = pd.read_csv(OUT)
    table = table[table.found.isin(["in the interval", "outside"])]
    for few, cells in table.groupby(table.beats_found < 1.2):
        print(f"{'fewer than' if few else 'at least'} 1.2 beats found, true ones "
              f"{cells.beats.min():.2f} to {cells.beats.max():.2f}")  # fmt: skip
        for name, cell in cells.groupby("relaxing"):
            inside = int((cell.found == "in the interval").sum())
            print(f"  relaxing {name}: {exact(inside, len(cell))} % of {len(cell)}")


if __name__ == "__main__":
    run(main)
