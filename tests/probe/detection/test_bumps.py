"""Bumps of a row: how many stations it takes to show one."""

import numpy as np
import pytest

from probe.detection.map.bumps import find_bumps, floor, shape, surroundings

HEIGHT, NOISE = 1.0, 1e-3


@pytest.mark.parametrize(("stations", "found"), [(3, 0), (5, 0), (7, 1), (15, 1)])
def test_fewer_than_six_stations_show_no_bump(stations: int, found: int) -> None:
    rng = np.random.default_rng(stations)
    x_m = 4e-3 * np.arange(stations)
    value = HEIGHT * shape(x_m, float(x_m[stations // 2]), 4e-3) + NOISE * rng.normal(size=stations)
    row = find_bumps(x_m, value, np.full(stations, NOISE), floor(x_m), 0.01)
    assert len(row.bumps) == found
    for bump in row.bumps:
        assert bump.x_m == pytest.approx(x_m[stations // 2], abs=0.5e-3)


@pytest.mark.parametrize("stations", [15, 19])
@pytest.mark.parametrize("in_pitches", [2.0, 2.5, 3.0])
def test_two_pulses_near_the_ends_are_two_and_not_a_dip_between_them(
    stations: int, in_pitches: float
) -> None:
    x_m = 4e-3 * np.arange(1, stations + 1)
    places_m = 4e-3 * in_pitches, 4e-3 * (stations + 1 - in_pitches)
    value = 1300 * shape(x_m, places_m[0], 4.7e-3) + 1200 * shape(x_m, places_m[1], 5.2e-3) + 10.0
    row = find_bumps(x_m, value, np.full(stations, 104.0), floor(x_m), 0.0025, rising=True)
    assert sorted(bump.x_m for bump in row.bumps) == pytest.approx(places_m, abs=0.5e-3)


@pytest.mark.parametrize("level", [-700.0, 0.0])
def test_a_row_that_reads_less_than_nothing_is_judged_without_a_warning(level: float) -> None:
    x_m = 4e-3 * np.arange(1, 16)
    value = level + 500.0 * shape(x_m, 32e-3, 4e-3) - level * 0.2 * (x_m > 40e-3)
    row = find_bumps(x_m, value, np.full(15, 3.0), surroundings(x_m), 0.01)
    assert all(np.isfinite(bump.height) for bump in row.bumps)


def test_three_that_hide_each_other_are_found_together() -> None:
    rng = np.random.default_rng(5)
    x_m = 4e-3 * np.arange(1, 23)
    places_m = 15e-3, 46e-3, 75e-3
    value = 1000 + 200 * sum(shape(x_m, place_m, 4.5e-3) for place_m in places_m)
    row = find_bumps(x_m, value + rng.normal(size=22), np.full(22, 3.0), surroundings(x_m), 0.0025)
    assert sorted(bump.x_m for bump in row.bumps) == pytest.approx(places_m, abs=1e-3)
