"""What rows of a grid say together of one vessel."""

import pytest

from probe.detection.finding import Kind, ObjectFinding
from probe.detection.map.vessel_tracking import across_rows

PITCH_M = 4e-3


def seen(kind: Kind, confidence: float, diseased: float, x_mm: float = 30.0) -> ObjectFinding:
    x_m = 1e-3 * x_mm
    return ObjectFinding(
        kind, x_m, (x_m - 1e-3, x_m + 1e-3), 900.0, 300.0, confidence, diseased=diseased
    )


HEALTHY = seen("artery", 0.97, 0.01)
STIFF = seen("undecided", 0.76, 0.99)  # a stenosis or a lump, as far as its own row can tell


def together(*rows: ObjectFinding | None) -> list[ObjectFinding]:
    found = [(4e-3 * n, [one] if one else []) for n, one in enumerate(rows)]
    return across_rows(found, PITCH_M)


def test_a_stiff_place_without_pulse_on_a_vessels_course_is_a_stenosis() -> None:
    (one,) = together(HEALTHY, HEALTHY, STIFF, STIFF, HEALTHY)
    assert one.kind == "stenotic artery"
    assert one.stenosed_m == pytest.approx((8e-3, 12e-3))
    assert one.confidence == pytest.approx(0.97 * 0.99)
    assert not one.reason


def test_rows_that_show_nothing_beside_a_stenosis_belong_to_it() -> None:
    (one,) = together(HEALTHY, None, STIFF, None, HEALTHY)
    assert one.stenosed_m == pytest.approx((4e-3, 12e-3))
    assert len(one.course) == 3


def test_a_vessel_that_two_rows_do_not_show_is_one_and_not_called_healthy() -> None:
    (one,) = together(HEALTHY, HEALTHY, None, None, HEALTHY)
    assert one.kind == "undecided"
    assert "y = 8.0, 12.0 mm" in one.reason
    assert len(one.course) == 3


def test_a_vessel_of_which_one_row_is_in_doubt_is_not_called_healthy() -> None:
    (one,) = together(HEALTHY, seen("undecided", 0.6, 0.4), HEALTHY)
    assert one.kind == "undecided"
    assert "y = 4.0 mm" in one.reason


def test_a_vessel_is_healthy_if_every_row_says_so() -> None:
    (one,) = together(HEALTHY, seen("undecided", 0.8, 0.1), HEALTHY)
    assert one.kind == "artery"
    assert len(one.course) == 3


def test_without_a_pulse_in_any_row_stiff_places_are_what_they_are_by_themselves() -> None:
    (one,) = together(STIFF, seen("tumour", 0.9, 0.95), None)
    assert one.kind == "tumour"
    (one,) = together(STIFF, STIFF)
    assert one.kind == "undecided"


def test_three_missed_rows_part_two_vessels() -> None:
    assert len(together(HEALTHY, None, None, None, HEALTHY)) == 2
