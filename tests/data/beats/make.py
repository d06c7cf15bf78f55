"""Made reference.npz, once, by neurokit2 0.2.13: `pip install neurokit2 && python make.py`.

ECG by McSharry and others' dynamical model (2003), PPG by neurokit2's own; each 20 s at 100 Hz.
The beats beside them are neurokit2's, by its own peak finders on the recordings without noise.
neurokit2 brings scikit-learn, pandas and 350 MB with it, so its output is kept instead.
"""

from pathlib import Path

import neurokit2 as nk
import numpy as np

RATE_HZ, SPAN_S = 100, 20
found = {}
for bpm in (45, 60, 75, 110, 150):
    for seed, noise in ((1, 0.0), (2, 0.05)):
        ecg = nk.ecg_simulate(duration=SPAN_S, sampling_rate=500, heart_rate=bpm, noise=0,
                              heart_rate_std=2, method="ecgsyn", random_state=seed)  # fmt: skip
        _, peaks = nk.ecg_peaks(nk.ecg_clean(ecg, 500), 500)
        beats = np.array(peaks["ECG_R_Peaks"]) / 500
        rng = np.random.default_rng(seed)
        noisy = ecg[::5] + noise * np.ptp(ecg) * rng.standard_normal(len(ecg[::5]))
        found[f"ecg {bpm} noise {noise:g}"] = np.float32(noisy), beats
        ppg = nk.ppg_simulate(duration=SPAN_S, sampling_rate=500, heart_rate=bpm,
                              motion_amplitude=0, powerline_amplitude=0, burst_number=0,
                              ibi_randomness=0.1, drift=0.3 * (noise > 0),
                              random_state=seed)  # fmt: skip
        clean = nk.ppg_simulate(duration=SPAN_S, sampling_rate=500, heart_rate=bpm,
                                motion_amplitude=0, powerline_amplitude=0, burst_number=0,
                                ibi_randomness=0.1, drift=0, random_state=seed)  # fmt: skip
        beats = nk.ppg_findpeaks(nk.ppg_clean(clean, 500), 500)["PPG_Peaks"] / 500
        noisy = ppg[::5] + noise * np.ptp(ppg) * rng.standard_normal(len(ppg[::5]))
        found[f"ppg {bpm} noise {noise:g}"] = np.float32(noisy), beats
arrays = {}
for name, (signal, beats) in found.items():
    arrays[name], arrays[f"{name} beats_s"] = signal, np.asarray(beats)
np.savez_compressed(Path(__file__).with_name("reference.npz"), **arrays)
