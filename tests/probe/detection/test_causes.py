"""What moves in a hold: a pulse, regular or not, or breathing, a machine, a hand."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from known_presses import recording, station, wave

from drivers.core.arrays import Array
from probe.core.recording import Station
from probe.detection import detect
from probe.detection.pulse import causes
from probe.detection.pulse.beat_train import beat_train
from probe.detection.pulse.causes import coarse_of
from probe.detection.pulse.fit import design_of, fit
from probe.detection.pulse.hold_samples import hold_of

Motion = Callable[[Array, np.random.Generator], Array]


def moved(seed: int, by: Motion, sample_hz: float = 500.0) -> Station:
    """A relaxing press of 5 s in which something moves; its size is over the level."""
    rng = np.random.default_rng(seed)
    one = station(rng, sample_hz=sample_hz, noise_pa=15.0)
    t = one.time_s - one.time_s[0]
    return replace(one, signal_pa=one.signal_pa + 9000.0 * by(t, rng)[:, None])


def breathing(t: Array, rng: np.random.Generator) -> Array:
    """3 % trough to crest, with harmonics."""
    rate = rng.uniform(0.2, 0.4)
    sizes = (1.0, 0.4, 0.2, 0.1)
    turns = [2 * np.pi * k * rate * t + rng.uniform(0, 6.28) for k in range(1, 5)]
    wave = sum(a * np.cos(turn) for a, turn in zip(sizes, turns, strict=True))
    return np.asarray(0.03 * wave / np.ptp(wave))


def line(t: Array, rng: np.random.Generator) -> Array:
    """A machine of 0.3 %, trough to crest."""
    return np.asarray(0.0015 * np.cos(2 * np.pi * rng.uniform(0.8, 3.5) * t + rng.uniform(0, 6.28)))


def steps(t: Array, rng: np.random.Generator) -> Array:
    """A hand that slips, three times."""
    return np.asarray(sum(0.01 * rng.normal() * (t > rng.uniform(0, 5)) for _ in range(3)))


def bumps(t: Array, rng: np.random.Generator) -> Array:
    """Coughs of 1 to 3 %."""
    each = [(rng.uniform(0.01, 0.03), rng.uniform(0, 5), rng.uniform(0.1, 0.4)) for _ in range(3)]
    return np.asarray(sum(a * np.exp(-0.5 * ((t - at) / sd) ** 2) for a, at, sd in each))


def fibrillation(t: Array, rng: np.random.Generator) -> Array:
    """3 %; beats of any length, of a wave that is not the search's: straight up, e-fold down."""
    lengths = np.clip(0.75 * np.exp(0.22 * rng.standard_normal(30)), 0.35, 1.5)
    begins = np.cumsum(lengths) - rng.uniform(2, 4)
    beat = np.searchsorted(begins, t, side="right") - 1
    phase = (t - begins[beat]) / lengths[beat + 1]
    sizes = 1 + 0.15 * rng.standard_normal(30)
    wave = np.where(phase < 0.15, phase / 0.15, np.exp(-(phase - 0.15) / 0.35))
    return np.asarray(0.03 * sizes[beat] * wave)


def walk(t: Array, rng: np.random.Generator) -> Array:
    """At random, by 0.3 to 1 % within a second: next to no white noise."""
    steps = rng.standard_normal(len(t)) * np.sqrt(t[1] - t[0])
    return np.asarray(10 ** rng.uniform(-2.5, -2) * np.cumsum(steps))


def test_most_random_walks_are_nothing() -> None:
    """Of 60, where 16 were something while no noise was a walk alone."""
    said = [detect(recording([moved(seed, walk)])).finding for seed in range(60)]
    assert said.count("nothing") >= 51
    assert said.count("artery") <= 3


@pytest.mark.parametrize("by", [breathing, line, steps, bumps])
def test_what_is_no_pulse_is_not_called_an_artery(by: Motion) -> None:
    """But for one line in forty."""
    said = [detect(recording([moved(seed, by)])).finding for seed in range(12)]
    assert said.count("artery") <= 1
    assert said.count("undecided") + said.count("nothing") >= 11


@pytest.mark.parametrize("sample_hz", [10.0, 500.0])
def test_fibrillation_is_an_artery(sample_hz: float) -> None:
    said = [detect(recording([moved(seed, fibrillation, sample_hz)])) for seed in range(8)]
    assert sum(found.finding == "artery" for found in said) >= 7


def breathed_upon(t: Array, rng: np.random.Generator) -> Array:
    """A pulse of 1 %, and beside it a breath with one harmonic of twice that."""
    rate, angles = rng.uniform(0.2, 0.5), rng.uniform(0, 6.28, 2)
    breath = 0.01 * np.cos(2 * np.pi * rate * t + angles[0])
    breath += 0.004 * np.cos(4 * np.pi * rate * t + angles[1])
    return np.asarray(breath + 0.01 * wave(rng.uniform(1.0, 1.4) * t + rng.uniform()))


def test_a_pulse_beside_a_breath_is_an_artery() -> None:
    said = [detect(recording([moved(seed, breathed_upon, 10.0)])).finding for seed in range(12)]
    assert said.count("artery") >= 10


def test_what_moves_is_named_with_what_would_decide_it() -> None:
    found = detect(recording([moved(1, breathing)]))
    assert found.finding == "undecided"
    assert "breath" in found.reason
    assert found.heart_rate_bpm is None


def test_the_heart_rate_comes_with_its_interval() -> None:
    rng = np.random.default_rng(3)
    held = 0
    for rate_hz in np.linspace(0.8, 2.0, 12):
        found = detect(recording([station(rng, pulse_pa=150.0, rate_hz=rate_hz)]))
        assert found.heart_rate_bpm is not None
        _, low, high = found.heart_rate_bpm
        held += low <= 60 * rate_hz <= high
    assert held >= 10


@pytest.mark.parametrize(("rate_bpm", "sample_hz"), [(32.0, 500.0), (200.0, 500.0), (210.0, 10.0)])
def test_what_beats_slower_or_faster_than_hearts_is_said(rate_bpm: float, sample_hz: float) -> None:
    rng = np.random.default_rng(12)
    one = station(rng, pulse_pa=300.0, rate_hz=rate_bpm / 60, sample_hz=sample_hz, noise_pa=10.0)
    found = detect(recording([one]))
    assert found.finding == "undecided"
    reported = re.search(r"beats about (\d+) times a minute", found.reason)
    if reported:  # else a rival of pulses is named
        assert float(reported[1]) == pytest.approx(rate_bpm, rel=0.1)


def test_few_samples_do_not_let_motion_explain_a_loud_pulse() -> None:
    """2.5 s at 10 Hz: movements and harmonics enough for 25 samples explain any pulse."""
    found = [
        detect(recording([station(np.random.default_rng(seed), pulse_pa=300.0, noise_pa=15.0,
                                  sample_hz=10.0, hold_s=2.5, uneven_s=0.03)])).finding
        for seed in range(12)
    ]  # fmt: skip
    assert found.count("artery") >= 10


def test_of_a_long_hold_a_part_is_asked_what_moves_in_it() -> None:
    """What beat trains keep grows with the square of the samples: 4.6 GB in a hold of a minute."""
    long = moved(3, fibrillation)
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 60.0, 2e-3)
    signal = np.interp(t % long.time_s[-1], long.time_s, long.signal_pa[:, 0])
    many = replace(
        long, time_s=t, signal_pa=(signal + rng.standard_normal(len(t)))[:, None],
        saturated=np.zeros((len(t), 1), bool), depth_m=np.full(len(t), np.nan),
        indent_s=np.nan, hold_s=np.nan, retract_s=np.nan,
    )  # fmt: skip
    hold = hold_of(many)
    null = fit(hold, design_of(hold), np.empty((len(hold.time_s), 0)))
    coarse = coarse_of(hold, null)
    assert coarse.signal.size * coarse.step_s == pytest.approx(20.0, rel=0.01)


def test_how_many_movements_there_are_is_not_chosen_for_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where nothing moves, that there could be up to four movements makes motion less likely."""
    hold = hold_of(moved(5, lambda t, _: np.zeros_like(t), 10.0))
    coarse = coarse_of(hold, fit(hold, design_of(hold), np.empty((len(hold.time_s), 0))))
    train = beat_train(coarse)
    found = {}
    for most in (1, 4):
        monkeypatch.setattr(causes, "MOVEMENTS", most)
        found[most] = causes.evidence_of(coarse, train)["motion"]
    assert 0.5 < found[1] - found[4] <= np.log(4)


def test_who_asks_for_more_false_pulses_takes_less_sure_ones() -> None:
    """By default 80 %; the odds fall as the chance rises, and no likelier rival is a pulse."""
    assert causes.least_posterior(0.001) == pytest.approx(0.8)
    assert causes.least_posterior(0.02) == pytest.approx(0.8)
    assert causes.least_posterior(0.04) == pytest.approx(0.8 / (0.8 + 2 * 0.2))
    assert causes.least_posterior(0.3) == 0.5
    doubtful = moved(3, breathed_upon, 10.0)
    assert detect(recording([doubtful])).finding == "undecided"
    assert detect(recording([doubtful]), false_alarm=0.3).finding == "artery"


def test_a_tremor_at_three_times_a_hearts_rate_is_no_artery() -> None:
    """One of 5.8 Hz was a third harmonic without a first, an artery at 99.9 %."""

    def tremor(t: Array, rng: np.random.Generator) -> Array:
        hz = rng.uniform(5.5, 6.5)
        return np.asarray(0.0015 * np.cos(2 * np.pi * hz * t + rng.uniform(0, 6.28)))

    said = [detect(recording([moved(seed, tremor, 100.0)])).finding for seed in range(6)]
    assert "artery" not in said
