"""Arrays of taxels of which one is dead, dies, misses samples or spikes."""

from dataclasses import replace

import numpy as np
import pytest
from known_presses import station

from probe.core.recording import Recording, Station
from probe.detection import detect
from probe.detection.pulse.hold_samples import hold_of


def array(one: Station, rng: np.random.Generator) -> Station:
    """The press as nine taxels that feel the same, with noise of their own."""
    nine = one.signal_pa + 20.0 * rng.standard_normal((len(one.time_s), 9))
    return replace(one, signal_pa=nine, saturated=np.zeros(nine.shape, dtype=bool))


def test_a_dead_or_stuck_taxel_costs_nothing() -> None:
    rng = np.random.default_rng(4)
    whole = array(station(rng, pulse_pa=150.0, hold_s=2.5), rng)
    level = detect(Recording((whole,), tuple("abcdefghi"), (), 1e-4)).stations[0].baseline_pa
    for value, saturated in ((np.nan, False), (123.0, False), (1e6, True)):
        signal, clipped = whole.signal_pa.copy(), whole.saturated.copy()
        signal[:, 3], clipped[:, 3] = value, saturated
        hurt = replace(whole, signal_pa=signal, saturated=clipped)
        found = detect(Recording((hurt,), tuple("abcdefghi"), (), 1e-4))
        assert found.finding == "artery"
        assert found.stations[0].clipped == 0
        assert found.stations[0].baseline_pa == pytest.approx(level, rel=0.01)


def test_a_taxel_that_dies_in_a_scan_does_not_lower_the_levels_from_there_on() -> None:
    """It reads nothing from the third press on; an edge taxel that touches nothing, and rests in
    steps of the sensor, does so from the first."""
    rng = np.random.default_rng(4)
    presses = []
    for n in range(5):
        one = array(station(rng, index=n, x_mm=4.0 * n, noise_pa=5.0, hold_s=2.5), rng)
        air = 20.0 * rng.standard_normal((50, 9))
        signal = np.vstack([air, one.signal_pa])
        signal[:, 8] = np.where(np.arange(len(signal)) % 40 == 5, 10.0, 0.0) if n == 0 else 0.0
        if n >= 2:
            signal[:, 3] = 0.0
        presses.append(replace(
            one, time_s=np.concatenate([one.indent_s - 0.1 + 0.002 * np.arange(50), one.time_s]),
            signal_pa=signal, saturated=np.zeros(signal.shape, bool),
            depth_m=np.concatenate([np.zeros(50), one.depth_m]),
        ))  # fmt: skip
    found = detect(Recording(tuple(presses), tuple("abcdefghi"), (), 1e-4))
    levels = [one.baseline_pa for one in found.stations]
    assert np.ptp(levels) < 0.01 * np.mean(levels)
    assert all(one.note.endswith("left out everywhere: d") for one in found.stations)


def test_what_taxels_miss_for_a_while_is_taken_from_the_others() -> None:
    """Three of nine, of unlike gain, for a second each: without them a mean is another's."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        one = station(rng, pulse_pa=180.0, noise_pa=10.0)
        gain = rng.uniform(0.3, 1.7, 9)
        each = one.signal_pa * gain + 5.0 * rng.standard_normal((len(one.time_s), 9))
        t = one.time_s - one.time_s[0]
        sound = replace(one, signal_pa=each.copy(), saturated=np.zeros(each.shape, bool))
        for channel, begins in zip(rng.choice(9, 3, replace=False), (0.5, 1.5, 2.5), strict=True):
            each[(t > begins) & (t < begins + 1.0), channel] = np.nan
        missed = replace(sound, signal_pa=each)
        holds = [hold_of(made) for made in (sound, missed)]
        assert len(holds[0].time_s) == len(holds[1].time_s)
        off = holds[1].signal_pa - holds[0].signal_pa
        assert np.abs(off).max() < 10.0  # of a pulse of 180
        assert detect(Recording((missed,), tuple("abcdefghi"), (), 1e-4)).finding == "artery"


def test_spikes_in_one_channel_cost_nothing() -> None:
    rng = np.random.default_rng(5)
    for _ in range(3):
        whole = array(station(rng, pulse_pa=100.0, hold_s=2.5), rng)
        signal = whole.signal_pa.copy()
        signal[rng.uniform(size=len(signal)) < 0.02, 5] += 3000.0
        found = detect(Recording((replace(whole, signal_pa=signal),), tuple("abcdefghi"), (), 1e-4))
        assert found.finding == "artery"
