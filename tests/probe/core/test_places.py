"""Where a station is, in words and by a plan that may be anybody's."""

import math
from typing import Any

import pytest

from probe.core.places import has_rows, place_words, planned, plans_rows


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


def test_rows_differ_by_more_than_rounding_and_only_where_they_are_known() -> None:
    assert has_rows([0.0, 0.001])
    assert not has_rows([0.0, 1e-7, None, math.nan])


@pytest.mark.parametrize("plan", [None, {}, {"stations": 3}, {"stations": [[0, 1.0]]}])
def test_a_plan_that_makes_no_sense_is_no_grid(plan: Any) -> None:
    """The run file may come from anybody."""
    assert planned({"plan": plan}) == {}
    assert not plans_rows({"plan": plan})
