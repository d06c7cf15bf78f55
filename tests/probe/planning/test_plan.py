import math
import sys
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drivers import ConfigError
from probe.planning.plan import Plan, check_reach, grid, repeated, row
from probe.planning.press_direction import normal_of, pressed
from probe.planning.surfaces import through

BOX = ((0.0, 0.07), (-0.01, 0.01), (-0.003, 0.01))


def test_the_papers_row() -> None:
    places = row(4e-3, 4e-3, 15)
    assert [round(1e3 * p.x_m, 6) for p in places] == [4 * n for n in range(1, 16)]
    assert [p.index for p in places] == list(range(15))


@given(st.integers(1, 12), st.integers(1, 12))
def test_a_grid_visits_each_place_once_by_single_steps(columns: int, rows: int) -> None:
    places = grid((0.0, 0.0), (2e-3, 3e-3), (columns, rows))
    assert len({(p.x_m, p.y_m) for p in places}) == columns * rows
    for a, b in pairwise(places):
        assert math.dist((a.x_m, a.y_m), (b.x_m, b.y_m)) <= 3e-3 + 1e-12


def test_repeats_are_stations_of_their_own() -> None:
    places = repeated(row(0.0, 1e-3, 2), 3)
    assert [p.index for p in places] == [0, 1, 2, 3, 4, 5]
    assert [p.x_m for p in places] == [0.0, 0.0, 0.0, 1e-3, 1e-3, 1e-3]


def test_travel_clears_the_highest_station() -> None:
    plan = Plan(row(0.0, 10e-3, 4), surface=lambda x, _y: 0.1 * x)
    assert plan.travel_z_m == pytest.approx(3e-3 + 2e-3)
    assert plan.at_surface(plan.places[2]).z == pytest.approx(2e-3)


@pytest.mark.parametrize("plan, said", [
    (Plan(row(4e-3, 4e-3, 30)), "station 18 .* needs x = 72 mm"),
    (Plan(row(4e-3, 4e-3, 2), indentation_m=4e-3), "needs z = -4 mm"),
    (Plan(row(4e-3, 4e-3, 2), clearance_m=20e-3), "needs z = 20 mm"),
    (Plan(row(4e-3, 4e-3, 2), touch_n=0.01), "needs z = -4.5 mm"),
    (Plan(()), "no stations"),
])  # fmt: skip
def test_what_is_out_of_reach_is_refused(plan: Plan, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        check_reach(plan, BOX)


def test_every_press_is_normal_to_the_surface() -> None:
    """A slope of 3 in 4 along x and none along y: the normal is (-3, 0, 4) / 5."""
    plan = Plan(row(4e-3, 4e-3, 2), surface=lambda x, _y: 0.75 * x)
    start = plan.at_surface(plan.places[0])
    assert normal_of(start) == pytest.approx((-0.6, 0.0, 0.8))
    deep = pressed(start, 5e-3)
    assert deep[:3] == pytest.approx((4e-3 + 3e-3, 0.0, 3e-3 - 4e-3))
    assert plan.deepest_below_m == pytest.approx(plan.indentation_m / 0.8)
    turned = Rotation.from_rotvec(start[3:]).apply([0.0, 0.0, 1.0])
    assert turned == pytest.approx(normal_of(start))
    with pytest.raises(ConfigError, match="inclined by 37 degrees"):
        check_reach(plan, BOX)


def test_a_press_is_normal_to_a_surface_that_rises_along_y() -> None:
    plan = Plan(row(4e-3, 4e-3, 2), surface=lambda _x, y: 0.75 * y)
    assert normal_of(plan.at_surface(plan.places[0])) == pytest.approx((0.0, -0.6, 0.8))


@pytest.mark.parametrize("more", [[], [[10.0, 10.0, 3.0]]])  # three points, and a sheet
def test_a_surface_through_points_rises_both_ways(more: list[list[float]]) -> None:
    points = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 1.0], [0.0, 10.0, 2.0], *more])
    surface = through(1e-3 * points)
    assert surface(4e-3, 7e-3) == pytest.approx(1e-3 * (0.4 + 1.4))


def test_a_level_surface_turns_nothing() -> None:
    plan = Plan(row(4e-3, 4e-3, 2), surface=lambda _x, _y: 1e-3)
    assert plan.at_surface(plan.places[0])[3:] == (0.0, 0.0, 0.0)
    assert pressed(plan.at_surface(plan.places[0]), 2e-3).z == pytest.approx(-1e-3)


def test_checking_a_plan_is_linear_in_its_stations() -> None:
    """Work counted in calls, which no busy machine changes."""

    def calls(stations: int) -> int:
        count = 0

        def called(_frame: object, event: str, _argument: object) -> None:
            nonlocal count
            count += event == "call"

        plan = Plan(row(0.0, 1e-5, stations))
        before = sys.getprofile()
        sys.setprofile(called)
        try:
            check_reach(plan, BOX)
        finally:
            sys.setprofile(before)
        return count

    assert calls(800) < 5 * calls(200)
