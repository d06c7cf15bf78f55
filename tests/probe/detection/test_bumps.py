"""Bumps of a row: how many stations it takes to show one."""

import numpy as np
import pytest

from drivers.core.arrays import Array
from probe.detection.map.bumps import evenness, find_bumps, least_height
from probe.detection.map.row_shapes import TAIL, floor, shape, surroundings
from probe.detection.map.seen_map import bump_at, row_of

HEIGHT, NOISE = 1.0, 1e-3
GAUSSIAN, OURS, LORENTZIAN = 1e4, TAIL, 1.0
CLUSTERS_M = 1e-3 * np.array([3, 3.5, 9, 10, 11, 18, 30, 31, 33, 40, 41, 55, 56, 57, 60])
PAIRS_M = 1e-3 * np.sort(np.concatenate([np.arange(4.0, 61, 8), np.arange(4.6, 61, 8)]))


@pytest.mark.parametrize(("stations", "found"), [(3, 0), (5, 0), (7, 1), (15, 1)])
def test_fewer_than_six_stations_show_no_bump(stations: int, found: int) -> None:
    rng = np.random.default_rng(stations)
    x_m = 4e-3 * np.arange(stations)
    value = HEIGHT * shape(x_m, float(x_m[stations // 2]), 4e-3) + NOISE * rng.normal(size=stations)
    row = find_bumps(row_of(x_m, value, np.full(stations, NOISE), floor(x_m)), 0.01)
    assert len(row) == found
    for bump in row:
        assert bump.x_m == pytest.approx(x_m[stations // 2], abs=0.5e-3)


@pytest.mark.parametrize("stations", [7, 9, 15])
def test_the_least_height_is_what_most_rows_show(stations: int) -> None:
    """Nine of ten by its formula; the scatter of a short row is partly believed, partly seen."""
    rng = np.random.default_rng(stations)
    x_m, level, sd = 4e-3 * np.arange(stations), np.full(stations, 8200.0), np.full(stations, 37.0)
    base = surroundings(x_m)
    least = least_height(row_of(x_m, level, sd, base), 0.0025)

    def share(height: float) -> float:
        bump = level + height * shape(x_m, float(x_m.mean()), 8e-3)
        rows = (bump + sd * rng.standard_normal(stations) for _ in range(60))
        return float(np.mean([len(find_bumps(row_of(x_m, row, sd, base), 0.0025)) for row in rows]))

    assert share(least) > 0.7
    assert share(0.5 * least) < 0.3


def test_presses_that_scatter_more_than_stated_show_less() -> None:
    """Nine of ten by the formula, whose scatter is seen in one row and met in others."""
    rng = np.random.default_rng(2)
    x_m, stated = 4e-3 * np.arange(15), np.full(15, 37.0)
    base = surroundings(x_m)

    def row(bump_pa: float) -> Array:
        bump = bump_pa * shape(x_m, float(x_m.mean()), 8e-3)
        return np.asarray(8200.0 + bump + 3 * stated * rng.standard_normal(15))

    rows = [row(0.0) for _ in range(25)]
    least = float(np.median([least_height(row_of(x_m, one, stated, base), 0.0025) for one in rows]))
    assert max(evenness(row_of(x_m, one, stated, base)) for one in rows) < 0.01
    found = [len(find_bumps(row_of(x_m, row(least), stated, base), 0.0025)) > 0 for _ in range(60)]
    assert np.mean(found) > 0.7


def test_a_row_is_as_even_as_its_presses_scatter() -> None:
    rng = np.random.default_rng(3)
    x_m, sd = 4e-3 * np.arange(15), np.full(15, 37.0)
    base = surroundings(x_m)
    rows = (8200.0 + sd * rng.standard_normal(15) for _ in range(400))
    few = np.mean([evenness(row_of(x_m, one, sd, base)) < 0.1 for one in rows])
    assert 0.06 < few < 0.15


@pytest.mark.parametrize("stations", [5, 6])
def test_where_none_can_show_no_height_is_promised(stations: int) -> None:
    x_m = 4e-3 * np.arange(stations)
    level = np.full(stations, 8200.0)
    assert np.isinf(least_height(row_of(x_m, level, 0.004 * level, surroundings(x_m)), 0.0025))


@pytest.mark.parametrize("stations", [15, 19])
@pytest.mark.parametrize("in_pitches", [2.0, 2.5, 3.0])
def test_two_pulses_near_the_ends_are_two_and_not_a_dip_between_them(
    stations: int, in_pitches: float
) -> None:
    x_m = 4e-3 * np.arange(1, stations + 1)
    places_m = 4e-3 * in_pitches, 4e-3 * (stations + 1 - in_pitches)
    value = 1300 * shape(x_m, places_m[0], 4.7e-3) + 1200 * shape(x_m, places_m[1], 5.2e-3) + 10.0
    row = find_bumps(row_of(x_m, value, np.full(stations, 104.0), floor(x_m)), 0.0025, rising=True)
    assert sorted(bump.x_m for bump in row) == pytest.approx(places_m, abs=0.5e-3)


@pytest.mark.parametrize("level", [-700.0, 0.0])
def test_a_row_that_reads_less_than_nothing_is_judged_without_a_warning(level: float) -> None:
    x_m = 4e-3 * np.arange(1, 16)
    value = level + 500.0 * shape(x_m, 32e-3, 4e-3) - level * 0.2 * (x_m > 40e-3)
    row = find_bumps(row_of(x_m, value, np.full(15, 3.0), surroundings(x_m)), 0.01)
    assert all(np.isfinite(bump.height) for bump in row)


def test_three_that_hide_each_other_are_found_together() -> None:
    rng = np.random.default_rng(5)
    x_m = 4e-3 * np.arange(1, 23)
    places_m = 15e-3, 46e-3, 75e-3
    value = 1000 + 200 * sum(shape(x_m, place_m, 4.5e-3) for place_m in places_m)
    row = find_bumps(
        row_of(x_m, value + rng.normal(size=22), np.full(22, 3.0), surroundings(x_m)), 0.0025
    )
    assert sorted(bump.x_m for bump in row) == pytest.approx(places_m, abs=1e-3)


def test_a_row_that_begins_over_an_artery_shows_it_and_no_other() -> None:
    """Pulses [Pa] of 4 mN of noise, 3.5 mm apart; what rises by 40 Pa is noise."""
    value = np.array([562.0, 421, 175, 94, 60, 38, 66, 18, 28, 49, 34, 82, 40, 35])
    x_m = 12.1e-3 + 3.48e-3 * np.arange(len(value))
    row = find_bumps(row_of(x_m, value, np.full(len(value), 51.0), floor(x_m)), 0.005, rising=True)
    assert [bump.x_m < x_m[1] for bump in row] == [True]


@pytest.mark.parametrize("in_pitches", [-0.5, 0.0, 0.3])
def test_a_pulse_at_the_rows_end_is_found_there(in_pitches: float) -> None:
    """Also of a vessel beyond it, which is felt most at the end."""
    x_m = 4e-3 * np.arange(1, 15)
    place_m = x_m[0] + 4e-3 * in_pitches
    value = 600 * shape(x_m, place_m, 5e-3) + 20.0
    row = find_bumps(row_of(x_m, value, np.full(len(x_m), 50.0), floor(x_m)), 0.0025, rising=True)
    (bump,) = row
    assert bump.x_m == pytest.approx(max(place_m, x_m[0]), abs=0.6e-3)
    assert abs(max(place_m, x_m[0]) - bump.x_m) <= bump.reach_m[0]


def test_a_height_is_as_doubtful_as_the_width_makes_it() -> None:
    """Of 60 bumps anywhere in a row 19 in 20 lie within two standard deviations."""
    x_m = 4e-3 * np.arange(1, 16)
    off = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        bump = 120 * shape(x_m, rng.uniform(10e-3, 54e-3), rng.uniform(3e-3, 8e-3))
        value = 1000 + bump + 3 * rng.standard_normal(15)
        found = find_bumps(row_of(x_m, value, np.full(15, 3.0), surroundings(x_m)), 0.0025)[0]
        off.append(abs(found.height - 120) / found.height_sd)
    assert np.mean(np.array(off) < 2) > 0.87


HALF_OF_TIT_PA = (
    6919, 7681, 8025, 8140, 8169, 8175, 8186, 8210, 8252, 8332, 8455, 8637, 8845, 9023, 9091
)  # fmt: skip
"""Levels that the virtual sensor reads over TIT at 2.5 mm, every 2 mm from 4 mm to its middle."""


HALF_OF_A_HIGH_BLOCK_PA = (
    3530, 3942, 4251, 4469, 4616, 4706, 4761, 4783, 4798, 4800, 4797, 4795, 4801, 4797, 4793
)  # fmt: skip
"""The same over TI in a block of 30 mm, pressed 2 mm deep."""


@pytest.mark.parametrize("scatter_pa", [5.0, 25.0, 40.0])
def test_what_the_sides_of_a_high_block_make_of_a_close_row_is_no_lump(scatter_pa: float) -> None:
    """They reach three times as far; a surface that waves was eleven times less likely than one."""
    x_m = 1e-3 * np.arange(4.0, 61.0, 2.0)
    level_pa = np.array([*HALF_OF_A_HIGH_BLOCK_PA, *HALF_OF_A_HIGH_BLOCK_PA[-2::-1]], float)
    row = find_bumps(
        row_of(x_m, level_pa, np.full(len(x_m), scatter_pa), surroundings(x_m)), 0.0025
    )
    assert bool(row) == (scatter_pa < 40)
    assert all(bump.uneven > 100 for bump in row)


@pytest.mark.parametrize("start_m", [0.0, 4e-3])
def test_stations_3_mm_apart_are_close_however_their_places_are_rounded(start_m: float) -> None:
    """From 4 mm on, their distances are a rounding error above 3 mm."""
    x_m = start_m + 3e-3 * np.arange(19)
    left, right = (np.exp(-np.abs(x_m - end_m) / 5.4e-3) for end_m in x_m[[0, -1]])
    value = 1000 - 250 * left - 150 * right
    found = find_bumps(row_of(x_m, value, np.full(19, 1.0), surroundings(x_m)), 0.0025)
    assert found
    assert all(bump.uneven > 100 for bump in found)


def test_a_lump_beside_short_edges_is_not_taken_for_far_ones() -> None:
    x_m = 1e-3 * np.arange(4.0, 61.0, 2.0)
    edges = np.exp(-(x_m - x_m[0]) / 1.8e-3) + np.exp(-(x_m[-1] - x_m) / 1.8e-3)
    sure = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        lump = 50 * shape(x_m, rng.uniform(12e-3, 52e-3), 4.5e-3)
        value = 1000 - 150 * edges + lump + rng.normal(scale=5.0, size=len(x_m))
        found = find_bumps(row_of(x_m, value, np.full(len(x_m), 5.0), surroundings(x_m)), 0.0025)
        sure += len(found) == 1 and found[0].uneven < 0.05
    assert sure >= 18


def test_edges_reach_as_far_in_where_stations_are_closer() -> None:
    """With edges that reach by the station distance only, the row was taken for a wave."""
    x_m = 1e-3 * np.arange(4.0, 61.0, 2.0)
    level_pa = np.array([*HALF_OF_TIT_PA, *HALF_OF_TIT_PA[-2::-1]], float)
    row = find_bumps(row_of(x_m, level_pa, np.full(len(x_m), 40.0), surroundings(x_m)), 0.01)
    (bump,) = row
    assert bump.x_m == pytest.approx(32e-3, abs=0.1e-3)
    assert bump.uneven < 0.01
    left_pa = level_pa - bump.height * bump_at(x_m[:, None], bump.shape)
    assert evenness(row_of(x_m, left_pa, np.full(len(x_m), 40.0), surroundings(x_m))) > 0.5


@pytest.mark.parametrize("tail", [GAUSSIAN, OURS, LORENTZIAN])
@pytest.mark.parametrize("pitch_mm", [0.5, 1.0, 2.0])
def test_an_artery_below_close_stations_is_one(pitch_mm: float, tail: float) -> None:
    """It is no narrower there; with half widths up to four stations it was three at 1 mm."""
    rng = np.random.default_rng(1)
    x_m = 1e-3 * np.arange(4.0, 60.1, pitch_mm)
    for place_m in rng.uniform(15e-3, 49e-3, size=5):
        value = 400 * shape(x_m, place_m, 6.7e-3, tail) * rng.normal(1, 0.05, size=len(x_m))
        sd = np.full(len(x_m), 0.08 * value.max())
        (bump,) = find_bumps(row_of(x_m, value, sd, floor(x_m)), 0.0025, rising=True)
        assert bump.x_m == pytest.approx(place_m, abs=0.5e-3)


@pytest.mark.parametrize("x_m", [CLUSTERS_M, PAIRS_M])
@pytest.mark.parametrize("half_width_mm", [7.0, 11.0])
def test_intervals_hold_where_stations_stand_in_clusters(x_m: Array, half_width_mm: float) -> None:
    """The median of all their distances is that within clusters: a third of them held."""
    rng = np.random.default_rng(2)
    held = []
    for place_m in rng.uniform(10e-3, 52e-3, size=25):
        value = 400 * shape(x_m, place_m, 1e-3 * half_width_mm, GAUSSIAN)
        value *= rng.normal(1, 0.05, size=len(x_m))
        sd = np.full(len(x_m), 0.08 * value.max())
        bumps = find_bumps(row_of(x_m, value, sd, floor(x_m)), 0.0025, rising=True)
        held.append(any(abs(place_m - one.x_m) <= one.reach_m[0] for one in bumps))
    assert np.mean(held) > 0.85


def test_an_interval_holds_whatever_the_shape_between_far_stations() -> None:
    """Stations of 8 mm show a bump of 7 mm at three; 8 of 40 held with one shape alone."""
    rng = np.random.default_rng(3)
    x_m = 8e-3 * np.arange(8)
    held = []
    for place_m in rng.uniform(12e-3, 44e-3, size=25):
        value = 1000 + 100 * shape(x_m, place_m, 7e-3, GAUSSIAN) + rng.normal(scale=1.0, size=8)
        found = find_bumps(row_of(x_m, value, np.full(8, 1.0), surroundings(x_m)), 0.0025)
        held += [abs(place_m - one.x_m) <= one.reach_m[0] for one in found]
    assert len(held) >= 25
    assert np.mean(held) > 0.9


@pytest.mark.parametrize("tail", [GAUSSIAN, OURS, LORENTZIAN])
@pytest.mark.parametrize("places_mm", [(18.0, 43.0), (16.0, 46.0), (20.0, 40.0)])
def test_two_lumps_are_no_dip_between_them(places_mm: tuple[float, float], tail: float) -> None:
    x_m = 1e-3 * np.arange(4.0, 61.0, 4.0)
    value = 1000 + sum(150 * shape(x_m, 1e-3 * place, 7e-3, tail) for place in places_mm)
    value += np.random.default_rng(4).normal(scale=2.0, size=15)
    row = find_bumps(row_of(x_m, value, np.full(15, 4.0), surroundings(x_m)), 0.0025)
    assert sorted(1e3 * bump.x_m for bump in row) == pytest.approx(places_mm, abs=1.0)


@pytest.mark.parametrize("tail", [GAUSSIAN, OURS, LORENTZIAN])
def test_two_arteries_near_each_other_are_two_and_one_is_one(tail: float) -> None:
    x_m = 1e-3 * np.arange(4.0, 61.0, 4.0)
    for seed in range(12):
        rng = np.random.default_rng(seed)
        middle_m = rng.uniform(20e-3, 44e-3)
        for places_m in [(middle_m - 7.5e-3, middle_m + 7.5e-3), (middle_m,)]:
            value = sum(400 * shape(x_m, place_m, 7e-3, tail) for place_m in places_m)
            value = value * rng.normal(1, 0.05, size=15)
            sd = np.full(15, 0.08 * value.max())
            row = find_bumps(row_of(x_m, value, sd, floor(x_m)), 0.0025, rising=True)
            assert sorted(bump.x_m for bump in row) == pytest.approx(places_m, abs=2e-3)
