"""Presses repeated at one place, at few, or at none that is known: they make no row."""

from dataclasses import replace

import numpy as np
import pytest
from known_presses import recording, row, station

from probe.detection import detect
from probe.detection.repeats import distinct_m, pitch_m, places_of

MIN_WIDTH_MM = 1.0


@pytest.mark.parametrize("places_mm", [(32.0,), (28.0, 36.0), (28.0, 32.0, 36.0), (np.nan,)])
def test_a_pulse_in_six_repeats_at_few_places_is_no_nothing(places_mm: tuple[float, ...]) -> None:
    rng = np.random.default_rng(1)
    x_mm = np.tile(places_mm, -(-6 // len(places_mm)))
    presses = [
        station(rng, index=n, x_mm=x, pulse_pa=150.0, noise_pa=4.0, hold_s=2.5, sample_hz=100.0)
        for n, x in enumerate(x_mm)
    ]
    found = detect(recording(presses))
    assert found.finding in ("artery", "undecided")
    assert len(found.objects) == 1
    still = [replace(s, signal_pa=9000.0 + rng.standard_normal(
        s.signal_pa.shape)) for s in presses]  # fmt: skip
    known = bool(np.isfinite(places_mm).all())
    assert detect(recording(still)).finding == ("undecided" if known else "nothing")
    assert "nan" not in detect(replace(recording(still), finish="aborted")).reason


def test_a_pulse_in_a_short_row_beside_a_long_one_is_no_nothing() -> None:
    rng = np.random.default_rng(1)
    long = row(rng, noise_pa=4.0, hold_s=1.65, sample_hz=100.0)
    short = [
        station(rng, index=15 + n, x_mm=28.0 + 4 * n, y_mm=8.0, pulse_pa=150.0, noise_pa=4.0,
                hold_s=1.65, sample_hz=100.0)
        for n in range(3)
    ]  # fmt: skip
    found = detect(recording(long + short))
    assert found.finding in ("artery", "undecided")
    low, high = found.objects[0].position_ci_mm
    assert low <= 28.0 < 36.0 <= high


@pytest.mark.parametrize("off_m", [1e-9, 3e-6, 10e-6])
def test_repeats_that_miss_their_place_are_repeats(off_m: float) -> None:
    """A third of the gaps are pitches, the others what a stage comes back by."""
    rng = np.random.default_rng(3)
    x_m = np.repeat(4e-3 * np.arange(1, 8), 3)
    rng.shuffle(x_m)
    measured_m = x_m + off_m * rng.standard_normal(len(x_m))
    assert (places_of(measured_m) == np.round(x_m / 4e-3).astype(int) - 1).all()
    assert distinct_m(measured_m) == pytest.approx(4e-3 * np.arange(1, 8), abs=5 * off_m)
    assert pitch_m(measured_m) == pytest.approx(4e-3, abs=5 * off_m)


def test_an_object_of_a_row_of_repeats_has_an_interval() -> None:
    rng = np.random.default_rng(3)
    presses = [
        replace(s, x_m=s.x_m + 3e-6 * rng.standard_normal())
        for _ in range(2)
        for s in row(rng, bump=0.3, pulse_pa=60.0, noise_pa=4.0, hold_s=1.65, sample_hz=100.0)
    ]
    ordered = [replace(s, index=n) for n, s in enumerate(presses)]
    found = detect(recording(ordered))
    low, high = found.objects[0].position_ci_mm
    assert [len(found.objects), low < 33.0 < high] == [1, True]
    # at two places only, the vessel lies within the pitch of the clearer press
    two = [replace(s, index=n) for n, s in enumerate([s for s in ordered if 31 < s.x_m * 1e3 < 37])]
    low, high = detect(recording(two)).objects[0].position_ci_mm
    assert high - low > MIN_WIDTH_MM


@pytest.mark.parametrize(
    ("x_mm", "pitch_mm"),
    [
        (np.arange(4.0, 61.0, 4.0), 4.0),
        (np.concatenate([np.arange(4.0, 61.0, 4.0), [200.0]]), 4.0),  # a hole of 140 mm
        (np.concatenate([np.arange(4.0, 30.0, 4.0), np.arange(102.0, 130.0, 4.0)]), 4.0),
        ([3, 3.5, 9, 10, 11, 18, 30, 31, 33, 40, 41, 55, 56, 57, 60], 7.0),
        ([*np.arange(4.0, 61.0, 8.0), *np.arange(4.6, 61.0, 8.0)], 8.0),
    ],
)
def test_neither_clusters_nor_a_hole_are_what_a_row_can_show(
    x_mm: list[float], pitch_mm: float
) -> None:
    assert 1e3 * pitch_m(1e-3 * np.array(x_mm)) == pytest.approx(pitch_mm)
