"""What is said of a pulse's size in holds of 0.8 to 2 s by sensors of 50 to 500 Hz.

    python benchmarks/short_holds.py [HOLDS]

Each hold is drawn: the paper's wave or a brachial one, 50 to 110 beats a minute that begin
anywhere, three sizes and noises, with and without steps of 10 Pa, and tissue that does not relax,
relaxes a tenth as much as real tissue, or as much. Goes on where docs/results/short-holds.csv ends.
"""

import numpy as np
import pandas as pd
from artefacts import RELAXATION
from kept import ROOT, Row, exact, fill, run
from pulses import press

from palpate import Recording, detect
from sim_backend.scene.scene_file import Pulse
from sim_backend.scene.waves import PA_PER_MMHG, load_wave

LEVEL_PA = 9000.0
SWING_PA = 40 * PA_PER_MMHG
WAVES = [Pulse(wave=name, rate_bpm=60) for name in ("paper", "brachial")]
OUT = ROOT / "docs" / "results" / "short-holds.csv"
SEEN = ((1.0, "less than one"), (1.3, "1 to 1.3"), (2.0, "1.3 to 2"), (np.inf, "2 or more"))


def judge(seed: int) -> Row:
    """One hold, and whether what is said of its pulse is true."""
    rng = np.random.default_rng([7, seed])
    sample_hz = float(rng.choice([50, 100, 500]))
    relaxing, pulse_pa = float(rng.choice([0, 0.1, 1])), float(rng.choice([80, 200, 450]))
    noise_pa, step_pa = float(rng.choice([2, 5, 15])), float(rng.choice([0, 10]))
    hold_s = float(rng.choice([0.825, 0.825, 1.0, 1.3, 1.65, 2.0]))
    beat_hz, begun = rng.uniform(50, 110) / 60, rng.uniform()
    t = np.arange(int(hold_s * sample_hz)) / sample_hz
    level = 1 - relaxing * sum(g * (1 - np.exp(-t / tau)) for g, tau in RELAXATION)
    wave = WAVES[int(rng.integers(2))]
    pressure_pa = load_wave(wave).pressure_pa(beat_hz * t + begun)
    signal = LEVEL_PA * level + pulse_pa / SWING_PA * pressure_pa
    signal = signal + noise_pa * rng.standard_normal(len(t))
    if step_pa:
        signal = step_pa * np.round(signal / step_pa)
    (one,) = detect(Recording((press(t, signal),), ("force",), (), 1e-4)).stations
    beats = next(name for most, name in SEEN if hold_s * beat_hz < most)
    if np.isfinite(one.pulse_below_pa):
        said = "bound above it" if one.pulse_below_pa >= pulse_pa else "bound below it"
    else:
        off = abs(one.pulse_pa - pulse_pa) > 1.96 * one.pulse_sd_pa
        said = "outside the interval" if off else "in the interval"
    return {"wave": wave.wave, "sample_hz": sample_hz, "relaxing": relaxing, "noise_pa": noise_pa,
            "hold_s": hold_s, "beats": beats, "found": said, "true_pa": pulse_pa,
            "size_pa": f"{one.pulse_pa:.1f}", "sd_pa": f"{one.pulse_sd_pa:.2f}"}  # fmt: skip


def main(holds: int = 1500) -> None:
    """Judge, tell."""
    answers = ("wave", "sample_hz", "relaxing", "noise_pa", "hold_s", "beats", "found", "true_pa",
               "size_pa", "sd_pa")  # fmt: skip
    fill(OUT, ("seed",), answers, [(seed,) for seed in range(holds)], judge)
    table = pd.read_csv(OUT)
    print(table.groupby(["beats", "found"]).size().unstack(fill_value=0).to_string())
    for by in ("beats", "wave", "sample_hz", "relaxing"):
        for name, cell in table[~table.found.str.startswith("bound")].groupby(by):
            inside = int((cell.found == "in the interval").sum())
            print(f"{by} {name}: {exact(inside, len(cell))} % of {len(cell)}")


if __name__ == "__main__":
    run(main)
