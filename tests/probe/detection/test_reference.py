"""Beats of a reference channel, against a simulator and peak finders that are not ours."""

from dataclasses import replace

import numpy as np
import pytest
from known_presses import recording, row, wave
from paths import ROOT

from drivers.core.arrays import Array
from probe.detection import detect
from probe.detection.pulse.reference import beats_s

MADE = np.load(ROOT / "tests" / "data" / "beats" / "reference.npz")  # by make.py there: neurokit2
NAMES = [name for name in MADE.files if not name.endswith("beats_s")]
RATE_HZ, EDGE_S = 100, 0.7
SAME_BEAT_S = 0.1
"""Beats are up to 150 a minute: two are 0.4 s apart."""


def inner(beats: Array, span_s: float) -> Array:
    """Those whose whole shape is in the record: finders differ at its ends."""
    return beats[(beats > EDGE_S) & (beats < span_s - EDGE_S)]


@pytest.mark.parametrize("turned", [1, -1], ids=["upright", "inverted"])
@pytest.mark.parametrize("name", NAMES)
def test_every_simulated_beat_is_found_once(name: str, turned: int) -> None:
    signal, truth = MADE[name].astype(float), MADE[f"{name} beats_s"]
    time_s = np.arange(len(signal)) / RATE_HZ
    found = beats_s(time_s, turned * signal)
    off = found[:, None] - truth[None]
    nearest = off[np.arange(len(found)), np.abs(off).argmin(axis=1)]
    delay_s = float(np.median(nearest))  # steepest rise against highest point
    assert abs(delay_s) < 0.2
    mine = found - delay_s
    away = np.abs(inner(truth, time_s[-1])[:, None] - mine[None])
    assert (away < SAME_BEAT_S).sum(axis=1).tolist() == [1] * len(away)
    away = np.abs(inner(mine, time_s[-1])[:, None] - truth[None])
    assert ((away < SAME_BEAT_S).sum(axis=1) == 0).sum() == dropped(truth)


def dropped(beats: Array) -> int:
    """Beats that neurokit2's finder missed: its own gaps of two periods (three in fast PPG)."""
    gaps = np.diff(beats)
    return int((gaps > 1.6 * np.median(gaps)).sum())


@pytest.mark.parametrize("height", [0.0, 0.35, 0.8])
@pytest.mark.parametrize("rate_hz", [100, 250, 1000])
@pytest.mark.parametrize("bpm", [45, 90])
def test_a_t_wave_is_no_beat(height: float, rate_hz: int, bpm: int) -> None:
    """R waves 30 ms wide, T waves of a share of their height 0.3 s later."""
    time_s = np.arange(0, 20, 1 / rate_hz)
    r_s = np.arange(0.4, 19.8, 60 / bpm)
    since = time_s[:, None] - r_s
    shape = np.exp(-0.5 * (since / 0.012) ** 2)
    shape += height * np.exp(-0.5 * ((since - 0.3) / 0.05) ** 2)
    found = beats_s(time_s, shape.sum(axis=1))
    assert len(found) == len(r_s)
    assert found == pytest.approx(r_s, abs=0.05)


@pytest.mark.parametrize("signal", [np.zeros(500), np.full(500, np.nan), np.ones(2)])
def test_no_beats_without_a_signal(signal: Array) -> None:
    assert len(beats_s(np.arange(len(signal)) / 100, signal)) == 0


@pytest.mark.parametrize(("worn", "said"), [(True, 0), (False, 15)])
def test_a_reference_that_nobody_wears_hides_no_pulse(worn: bool, said: int) -> None:
    """Its noise has beats, too: by them a clear artery was stenotic, or none."""
    rng = np.random.default_rng(31)
    alone, beside = [], []
    for one in row(rng, bump=0.1, hold_s=2.0, sample_hz=200.0, noise_pa=5.0):
        t = one.time_s - one.time_s[0]
        phase = 1.2 * t + rng.uniform()
        near = 1 / (1 + ((1e3 * one.x_m - 33) / 5) ** 2) ** 1.5
        beating = replace(one, signal_pa=one.signal_pa + 250.0 * near * wave(phase)[:, None])
        light = 0.05 * rng.standard_normal(len(t)) + worn * wave(phase - 0.2)
        alone.append(beating)
        beside.append(replace(beating, reference_s=one.time_s, reference=light))
    found, without = detect(recording(beside)), detect(recording(alone))
    assert sum("beats otherwise" in one.note for one in found.stations) == said
    assert found.finding == without.finding == "artery"
    pulses = [max(one.pulse_pa for one in each.stations) for each in (found, without)]
    assert pulses[0] == pytest.approx(pulses[1], rel=0.1 if worn else 1e-9)
