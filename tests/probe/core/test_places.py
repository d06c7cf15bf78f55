"""Where a station is, in words and by a plan that may be anybody's."""

import math
from typing import Any

import pytest

from probe.core.places import has_rows, place_words, planned, plans_rows, rows_of


@pytest.mark.parametrize(
    ("x_m", "y_m", "in_grid", "words"),
    [
        (0.012, 0.0, False, "x = 12.0 mm"),
        (0.012, 0.0, True, "x = 12.0 mm, y = 0.0 mm"),
        (0.012, -0.0015, False, "x = 12.0 mm, y = -1.5 mm"),
        (math.nan, math.nan, True, "an unknown place"),
    ],
)
def test_words_of_a_place(x_m: float, y_m: float, in_grid: bool, words: str) -> None:
    assert place_words(x_m, y_m, in_grid=in_grid) == words


def test_rows_differ_by_more_than_a_robot_does_and_only_where_they_are_known() -> None:
    assert has_rows([0.0, 0.2])
    assert not has_rows([0.0, 1e-7, None, math.nan])


@pytest.mark.parametrize("y_m", [0.0, 0.05e-3, 0.25e-3, -1.05e-3, 0.0123456])
def test_a_row_stays_one_wherever_it_lies(y_m: float) -> None:
    """A robot comes back to within micrometres: no y may lie where rows are told apart."""
    near = [y_m + (-1) ** n * 2e-6 for n in range(6)]
    assert not has_rows([1e3 * y for y in near])
    assert rows_of(near) == [0] * 6
    assert rows_of([*near, math.nan, y_m - 1e-3]) == [1] * 6 + [None, 0]


@pytest.mark.parametrize("plan", [None, {}, {"stations": 3}, {"stations": [[0, 1.0]]}])
def test_a_plan_that_makes_no_sense_is_no_grid(plan: Any) -> None:
    """The run file may come from anybody."""
    assert planned({"plan": plan}) == {}
    assert not plans_rows({"plan": plan})
