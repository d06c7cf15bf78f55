"""Hearts without a rate: fibrillation and ectopic beats, of a wave that is not the search's."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from known_presses import recording, row, station

from drivers.core.arrays import Array
from probe.core.recording import Station
from probe.detection import detect
from probe.detection.pulse.hold_samples import hold_of
from probe.detection.pulse.possible_rates import RATE_VARIABILITY
from probe.detection.pulse.presses import Press, presses_of
from probe.detection.pulse.reference import find_pulse_by
from probe.detection.pulse.uneven_beats import MIN_WHOLE, UNEVEN, beats_of

Heart = Callable[[np.random.Generator, float, int], Array]
PULSE_PA = 450.0


def fibrillating(rng: np.random.Generator, usual_s: float, beats: int) -> Array:
    return np.clip(usual_s * (1 + 0.2 * rng.standard_normal(beats)), 0.35, 1.4)


def ectopic(rng: np.random.Generator, usual_s: float, beats: int) -> Array:
    lengths = usual_s * (1 + 0.03 * rng.standard_normal(beats))
    early = np.flatnonzero(rng.uniform(size=beats - 1) < 0.2)
    lengths[early] *= 0.6
    lengths[early + 1] *= 1.4
    return lengths


def beating(one: Station, begins_s: Array, pulse_pa: float) -> Station:
    """With beats that go straight up in 0.1 s and fall by e in 0.3 s."""
    t = one.time_s - one.time_s[0]
    since = t - begins_s[np.searchsorted(begins_s, t, side="right") - 1]
    wave = np.where(since < 0.1, since / 0.1, np.exp(-(since - 0.1) / 0.3))
    return replace(one, signal_pa=one.signal_pa + pulse_pa * wave[:, None])


def pressed(
    lengths_s: Array, rng: np.random.Generator, hold_s: float = 6.0, noise_pa: float = 20.0
) -> tuple[Press, float]:
    """A press and the mean rate [1/min] of its whole beats."""
    begins = np.cumsum(lengths_s) - lengths_s[0] - rng.uniform() * lengths_s[0]
    one = station(rng, hold_s=hold_s, sample_hz=100.0, noise_pa=noise_pa)
    inside = begins[(begins >= 0) & (begins < hold_s)]
    found = presses_of(recording([beating(one, begins, PULSE_PA)]), 0.02)
    return found[0], 60 / float(np.diff(inside).mean())


@pytest.mark.parametrize(("heart", "most"), [(fibrillating, 11), (ectopic, 9)])
def test_a_pulse_is_as_large_as_its_beats_are_however_they_come(heart: Heart, most: int) -> None:
    """At one rate for all beats 10 and 6 of 12 were within a third of it, the least a fifth."""
    sizes = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        press, _ = pressed(heart(rng, rng.uniform(0.55, 0.9), 30), rng)
        assert press.pulsing
        sizes.append(press.size_pa)
    assert np.sum(np.abs(np.array(sizes) / PULSE_PA - 1) < 1 / 3) >= most


@pytest.mark.parametrize(("heart", "most"), [(fibrillating, 15), (ectopic, 11)])
def test_the_rate_of_an_uneven_heart_lies_in_its_interval(heart: Heart, most: int) -> None:
    """At one rate for all beats in 10 and 12 of 16. A long pause after an early beat may be taken
    for two beats."""
    held = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        lengths = heart(rng, rng.uniform(0.55, 0.9), 30)
        begins = np.cumsum(lengths) - lengths[0] - rng.uniform() * lengths[0]
        one = beating(station(rng, hold_s=6.0, sample_hz=100.0), begins, PULSE_PA)
        found = detect(recording([one])).heart_rate_bpm
        assert found is not None
        true = 60 / float(np.diff(begins[(begins >= 0) & (begins < 6.0)]).mean())
        held.append(found[1] <= true <= found[2])
    assert sum(held) >= most


@pytest.mark.parametrize(("noise_pa", "most"), [(2.0, 0), (150.0, 0), (400.0, 2)])
def test_a_steady_heart_is_not_taken_for_an_uneven_one(noise_pa: float, most: int) -> None:
    """In noise as loud as the pulse 9 of 12 were, while beats of any length cost nothing."""
    uneven = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        lengths = rng.uniform(0.6, 1.0) * (1 + 0.03 * rng.standard_normal(20))
        press, _ = pressed(lengths, rng, noise_pa=noise_pa)
        uneven += press.pulse is not None and press.pulse.variability > RATE_VARIABILITY
    assert uneven <= most


def test_a_vessel_of_an_uneven_heart_is_one_vessel_in_its_place() -> None:
    """At one rate for all beats its pulse came and went from station to station: half of the
    places were off, and there were second arteries."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        centre_mm = rng.uniform(22, 44)
        stations = []
        for one in row(rng, centre_mm=centre_mm, bump=0.1, hold_s=5.0, sample_hz=50.0):
            lengths = fibrillating(rng, 0.8, 30)
            begins = np.cumsum(lengths) - lengths[0] - rng.uniform() * lengths[0]
            form = 1 / (1 + ((1e3 * one.x_m - centre_mm) / 5.0) ** 2) ** 1.5
            stations.append(beating(one, begins, PULSE_PA * form))
        (found,) = detect(recording(stations)).objects
        assert found.kind == "artery"
        low, high = 1e3 * np.array(found.position_ci_m)
        assert low - 0.2 <= centre_mm <= high + 0.2


def test_beats_of_a_long_hold_are_found_part_by_part_and_counted_once() -> None:
    rng = np.random.default_rng(4)
    lengths = fibrillating(rng, 0.8, 80)
    begins = np.cumsum(lengths) - lengths[0] - 0.3
    one = station(rng, hold_s=45.0, sample_hz=50.0, noise_pa=5.0)
    found = beats_of(hold_of(beating(one, begins, PULSE_PA)))
    inside = begins[(begins >= 0) & (begins < 45.0)]
    assert abs(len(found.bounds_s) - 2 - len(inside)) <= 2
    assert found.uneven
    assert found.mean_s == pytest.approx(float(np.diff(inside).mean()), rel=0.05)
    near = np.abs(found.bounds_s[:, None] - inside).min(axis=0)
    assert np.median(near) < 0.06
    counted = found.counted_s(found.bounds_s)
    assert np.diff(counted) == pytest.approx(found.mean_s)


def test_few_beats_say_nothing_of_their_scatter() -> None:
    rng = np.random.default_rng(5)
    begins = np.cumsum(fibrillating(rng, 0.8, 30)) - 1.0
    short = beating(station(rng, hold_s=2.4, sample_hz=100.0), begins, PULSE_PA)
    found = beats_of(hold_of(short))
    assert len(found.whole_s) < MIN_WHOLE
    assert not found.uneven
    assert UNEVEN > RATE_VARIABILITY


def test_beats_of_a_reference_have_their_mean_rate_and_their_scatter() -> None:
    """The usual beat's rate was taken for the mean one, as sure as a steady heart's."""
    held, off = [], []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        lengths = fibrillating(rng, 0.75, 40)
        begins = np.cumsum(lengths) - lengths[0] - 3.0
        one = beating(station(rng, hold_s=6.0, sample_hz=100.0), begins, PULSE_PA)
        t = np.arange(one.time_s[0] - 2, one.time_s[-1] + 2, 0.01)
        ecg = np.exp(-0.5 * ((t[:, None] - one.time_s[0] - begins) / 0.015) ** 2).sum(axis=1)
        seen = replace(one, reference=ecg, reference_s=t)
        found = detect(recording([seen])).heart_rate_bpm
        assert found is not None
        rate, low, high = found
        held.append(low <= 60 / 0.75 <= high)
        off.append(rate / (60 / lengths.mean()) - 1)
    assert sum(held) >= 14
    assert abs(np.mean(off)) < 0.05


def test_a_reference_of_two_unlike_beats_is_none() -> None:
    """Of an early beat and a pause neither is the usual one: their mean was that of no number."""
    rng = np.random.default_rng(1)
    begins = np.array([-9.0, 1.0, 1.36, 3.2])
    one = beating(station(rng, hold_s=5.0, sample_hz=100.0), begins, PULSE_PA)
    t = np.arange(one.time_s[0] - 0.5, one.time_s[-1] + 0.5, 0.01)
    ecg = np.exp(-0.5 * ((t[:, None] - one.time_s[0] - begins) / 0.015) ** 2).sum(axis=1)
    hold = hold_of(one)
    assert find_pulse_by(hold, t - one.time_s[0], ecg) is None
