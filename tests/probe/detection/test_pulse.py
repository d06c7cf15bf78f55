"""A pulse in a hold: its size, its chance, and what must not be taken for one."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from known_presses import station, wave

from probe.core.recording import Recording
from probe.detection.pulse import search
from probe.detection.pulse.estimate import find_pulse
from probe.detection.pulse.hold_samples import NoHold, hold_of
from probe.detection.pulse.presses import presses_of


def sizes(pulse_pa: float, count: int, **kind: float) -> np.ndarray:
    rng = np.random.default_rng(5)
    presses = [station(rng, pulse_pa=pulse_pa, **kind) for _ in range(count)]
    return np.array(
        [presses_of(Recording((p,), ("force",), (), 1e-4), 0.01)[0].size_pa for p in presses]
    )


@pytest.mark.parametrize("hold_s", [0.825, 2.5, 5.0])
def test_size_is_unbiased_in_relaxing_tissue(hold_s: float) -> None:
    """A pulse of 3 % of the force, whose tissue relaxes by ten times as much meanwhile."""
    found = sizes(300.0, 24, hold_s=hold_s, noise_pa=10.0)
    if hold_s > 1:
        assert np.median(found) == pytest.approx(309.3, rel=0.03)  # the wave swings by 1.031
        assert np.std(found) < 8
    else:  # less than a beat, of unknown rate, in a relaxing level: the order of magnitude
        assert 150 < np.median(found) < 600


def test_rate_of_false_pulses_is_the_stated_one() -> None:
    """Over 400 relaxing holds 5 % pass at 5 %: 95 % of such counts lie between 11 and 30."""
    rng = np.random.default_rng(11)
    chances = [find_pulse(hold_of(station(rng, hold_s=2.5))).p_value for _ in range(400)]
    assert np.count_nonzero(np.array(chances) < 0.05) <= 30
    assert np.count_nonzero(np.array(chances) < 0.5) >= 60  # and the test is not merely silent


def test_small_pulses_are_found() -> None:
    """Half a percent of the force in 5 s."""
    rng = np.random.default_rng(12)
    found = [
        find_pulse(hold_of(station(rng, pulse_pa=45.0, rate_hz=rate))).p_value < 0.01
        for rate in np.linspace(0.8, 1.8, 30)
    ]
    assert np.mean(found) >= 0.95


@pytest.mark.parametrize("pulse_pa", [150.0, 1500.0])
def test_uneven_beats_do_not_shrink_a_pulse(pulse_pa: float) -> None:
    """Beats that vary by 8 %, twice what they do at rest: one steady wave would find three quarters
    of the size, and scatter by a fifth of it."""
    found = sizes(pulse_pa, 24, noise_pa=20.0, rate_hz=1.6, uneven_s=0.05) / (1.031 * pulse_pa)
    assert np.median(found) == pytest.approx(1.0, abs=0.03)
    assert np.std(found) < 0.07


@pytest.mark.parametrize("rate_hz", [0.75, 1.1, 1.5046])
def test_a_loud_pulse_is_not_taken_for_its_harmonic(rate_hz: float) -> None:
    """200 times its doubt: whatever noise is fitted, the pulse is not it."""
    rng = np.random.default_rng(14)
    for _ in range(8):
        one = station(rng, pulse_pa=900.0, rate_hz=rate_hz, noise_pa=20.0)
        (press,) = presses_of(Recording((one,), ("force",), (), 1e-4), 0.01)
        assert press.pulse is not None
        assert press.pulse.rate_hz == pytest.approx(rate_hz, rel=0.01)
        assert press.size_pa == pytest.approx(1.031 * 900.0, rel=0.03)


def test_rate_is_found() -> None:
    rng = np.random.default_rng(13)
    for rate in (0.8, 1.1, 1.7):
        one = station(rng, pulse_pa=200.0, rate_hz=rate)
        (press,) = presses_of(Recording((one,), ("force",), (), 1e-4), 0.01)
        assert press.pulse is not None
        assert press.pulse.rate_hz == pytest.approx(rate, abs=0.02)


def test_spikes_and_gaps_cost_nothing() -> None:
    rng = np.random.default_rng(14)
    one = station(rng, pulse_pa=200.0)
    signal = one.signal_pa.copy()
    signal[::97] += 5000.0
    kept = rng.uniform(size=len(one.time_s)) > 0.2
    spoilt = replace(one, time_s=one.time_s[kept], signal_pa=signal[kept],
                     saturated=one.saturated[kept], depth_m=one.depth_m[kept])  # fmt: skip
    clean, hurt = (presses_of(Recording((s,), ("f",), (), 1e-4), 0.01)[0] for s in (one, spoilt))
    assert hurt.size_pa == pytest.approx(clean.size_pa, rel=0.05)
    assert hurt.level_pa == pytest.approx(clean.level_pa, rel=0.01)


def test_clipped_samples_are_left_out_and_reported() -> None:
    rng = np.random.default_rng(15)
    one = station(rng, pulse_pa=400.0, relaxing=0.0)
    limit = 9100.0
    over = one.signal_pa >= limit
    clipped = replace(one, signal_pa=np.minimum(one.signal_pa, limit), saturated=over)
    (press,) = presses_of(Recording((clipped,), ("f",), (), 1e-4), 0.01)
    assert press.clipped == pytest.approx(over.mean(), abs=0.01)
    assert "press less deep" in press.note
    assert press.size_pa > 200  # averaging the bounds in would give 200 or less


def test_a_sample_of_which_one_taxel_is_clipped_is_left_out() -> None:
    """The mean over the taxels is too low there."""
    one = station(np.random.default_rng(4))
    over = np.zeros((len(one.time_s), 2), dtype=bool)
    over[:500, 1] = True
    both = np.where(over, 0.7, 1.0) * np.hstack([one.signal_pa, one.signal_pa])
    found = hold_of(replace(one, signal_pa=both, saturated=over))
    whole = hold_of(one)
    assert found.clipped == pytest.approx(500 / len(over), rel=0.05)
    assert found.time_s[0] > 0.9 > whole.time_s[0]
    after = whole.time_s > 1.1
    assert found.signal_pa[found.time_s > 1.1].mean() == pytest.approx(
        whole.signal_pa[after].mean(), rel=1e-3
    )


def test_a_hold_that_is_all_clipped_says_so() -> None:
    one = station(np.random.default_rng(16))
    with pytest.raises(NoHold, match="100 % are clipped"):
        hold_of(replace(one, saturated=np.ones_like(one.saturated)))


@pytest.mark.parametrize("offset_pa", [0.0, -30000.0])
def test_a_ramp_that_only_the_samples_show_is_left_out(offset_pa: float) -> None:
    """At 10 Hz, of a sensor with any zero; a later beat higher than the ramp's end is no end."""
    rng = np.random.default_rng(18)
    one = station(rng, sample_hz=10.0, hold_s=8.0, noise_pa=2.0, pulse_pa=400.0, relaxing=0.0)
    ramp_s = np.arange(-1.0, 0.0, 0.1) + one.time_s[0]
    ramp = 9000.0 * (ramp_s - ramp_s[0])
    signal = np.concatenate([ramp, one.signal_pa[:, 0]]) + offset_pa
    n = len(signal)
    whole = replace(
        one, time_s=np.concatenate([ramp_s, one.time_s]), signal_pa=signal[:, None],
        saturated=np.zeros((n, 1), dtype=bool), depth_m=np.full(n, np.nan),
        indent_s=np.nan, hold_s=np.nan, retract_s=np.nan,
    )  # fmt: skip
    hold = hold_of(whole)
    assert one.time_s[0] - 0.1 <= hold.start_s + hold.time_s[0] <= one.time_s[0] + 1.0


def test_a_reference_shows_a_pulse_that_is_too_small_alone() -> None:
    """A PPG gives the beats, irregular ones too; ten seconds of them."""
    rng = np.random.default_rng(17)
    alone, beside = 0, 0
    for _ in range(12):
        one = station(rng, hold_s=10.0, noise_pa=150.0)
        beats = np.cumsum(np.concatenate([[9.0], 0.84 + 0.12 * rng.standard_normal(16)]))
        phase = np.interp(one.time_s, beats, np.arange(len(beats)))
        signal = one.signal_pa[:, 0] + 40.0 * np.cos(2 * np.pi * phase)
        ppg_s = np.arange(8.5, 21.0, 0.01)
        ppg = np.exp(-0.5 * ((ppg_s[:, None] - beats) / 0.08) ** 2).sum(axis=1)
        one = replace(one, signal_pa=signal[:, None])
        known = replace(one, reference_s=ppg_s, reference=ppg)
        for s, with_it in ((one, False), (known, True)):
            (press,) = presses_of(Recording((s,), ("f",), (), 1e-4), 0.01)
            assert press.pulse is not None
            if press.pulse.p_value < 0.01:
                beside, alone = (beside + 1, alone) if with_it else (beside, alone + 1)
    assert beside >= 11
    assert beside >= alone + 2


@pytest.mark.parametrize("seed", range(6))
def test_a_beat_on_a_slow_ramp_is_not_taken_for_its_end(seed: int) -> None:
    """A ramp of 30 s: a beat of 3 % on its last seconds makes a top, and a beat is all that the
    hold may begin early or late."""
    rng = np.random.default_rng(seed)
    one = station(rng, pulse_pa=270.0, noise_pa=5.0, sample_hz=10.0, hold_s=8.0)
    held_s = one.time_s - one.time_s[0]
    before_s = np.arange(-30.0, 0.0, 0.1)
    beats = 270.0 * wave(1.2 * before_s + rng.uniform())
    ramp = 9000.0 * ((before_s + 30) / 30) ** 1.5 + beats + 5.0 * rng.standard_normal(300)
    time_s = np.concatenate([before_s, held_s])
    signal = np.concatenate([ramp, one.signal_pa[:, 0]])
    n = len(time_s)
    whole = replace(
        one, time_s=time_s, signal_pa=signal[:, None], saturated=np.zeros((n, 1), dtype=bool),
        depth_m=np.full(n, np.nan), indent_s=np.nan, hold_s=np.nan, retract_s=np.nan,
    )  # fmt: skip
    hold = hold_of(whole)
    assert -0.9 < hold.start_s + hold.time_s[0] < 1.3


def test_a_long_hold_is_looked_at_in_parts_of_its_rates(monkeypatch: pytest.MonkeyPatch) -> None:
    hold = hold_of(station(np.random.default_rng(4), hold_s=25.0, pulse_pa=100.0))
    tracemalloc.start()
    in_parts, _ = search.search(hold)
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    table_bytes = 8 * len(hold.time_s) * len(in_parts.rates_hz) * 2 * search.SHAPE_HARMONICS
    assert peak_bytes < table_bytes
    monkeypatch.setattr(search, "MOST_KEPT", 2 * table_bytes)
    whole, _ = search.search(hold)
    for name in ("along", "power", "clear", "gain", "p_value"):
        assert getattr(in_parts, name) == pytest.approx(getattr(whole, name), rel=1e-9)
    assert in_parts.rate_hz == whole.rate_hz


def test_a_hold_too_long_for_two_rates_at_once_is_looked_at_one_by_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One of 15 minutes, in averages of 0.02 s, has more samples than a table holds numbers."""
    hold = hold_of(station(np.random.default_rng(4), hold_s=2.5, pulse_pa=100.0))
    whole, _ = search.search(hold)
    monkeypatch.setattr(search, "MOST_KEPT", len(hold.time_s))
    one_by_one, _ = search.search(hold)
    assert one_by_one.gain == pytest.approx(whole.gain, rel=1e-9)
