"""A finding's words: never certain, never silent about what could not be seen or was assumed."""

import pytest

from probe.core.events import Note
from probe.core.finding_words import assumption, headline, hold_down_line, object_line, percent


def thing(kind="artery", **changes):
    one = {"kind": kind, "position_mm": 20.0, "position_ci_mm": [19.5, 20.5], "peak_pa": 912.4,
           "pulse_pa": 12540.0, "confidence": 0.9999}  # fmt: skip
    return one | changes


def test_what_could_not_be_seen_is_the_headline():
    found = {"finding": "cannot see", "objects": [], "asked_pa": 466.0, "needed_pa": 2400.0}
    assert headline(found) == (
        "cannot see: a pulse of 470 Pa was asked for, 2400 Pa would have been needed"
    )


def test_several_objects_are_named_and_what_was_assumed_is_said():
    objects = [thing(), thing("tumour"), thing(), thing("undecided")]
    found = {"finding": "artery", "objects": objects}
    assert headline(found) == "2 arteries, 1 tumour, 1 undecided"
    assert "as if it lay alone" in assumption(found)
    assert assumption({"objects": [thing()]}) == ""


def test_an_object_without_a_place_has_no_gaps_in_its_line():
    line = object_line(thing(position_mm=None, position_ci_mm=None, peak_pa=None))
    assert line == "artery, pulse 12500 Pa, confidence 99.9 %"


@pytest.mark.parametrize(
    ("peak_pa", "said"), [(912.4, "stiffer by 912"), (-64.3, "softer by 64.3")]
)
def test_a_place_is_said_to_be_stiffer_or_softer(peak_pa, said):
    assert f", {said} Pa, pulse" in object_line(thing(peak_pa=peak_pa))


def test_what_is_undecided_has_no_confidence():
    assert object_line(thing("undecided")).endswith("pulse 12500 Pa")


def test_an_object_of_a_grid_says_where_it_lies_across_the_rows():
    vessel = thing(course_mm=[[20.0, 0.0], [24.0, 8.0]], stenosed_mm=[4.0, 8.0])
    assert object_line(vessel).endswith(
        "seen from x, y = 20.0, 0.0 to 24.0, 8.0 mm, stenosed from y = 4.0 to 8.0 mm"
    )
    one_row = thing(course_mm=[[20.0, 0.0]], stenosed_mm=[10.0, 10.0])
    assert object_line(one_row).endswith("at y = 0.0 mm, stenosed at y = 10.0 mm")
    assert object_line(thing("tumour", course_mm=[[20.0, 4.0]])).endswith("at y = 4.0 mm")


@pytest.mark.parametrize(
    ("value", "said"), [(1.0, "99.9 %"), (0.0, "0.1 %"), (0.5, "50 %"), (None, "unknown")]
)
def test_nothing_is_certain(value, said):
    assert percent(value) == said


@pytest.mark.parametrize("text", ["engine: blocked for 2 s", "blocked for 2 s"])
def test_a_note_names_its_device_once(text):
    assert Note(0.0, "fault", "engine", text).words == "engine: blocked for 2 s"


@pytest.mark.parametrize(
    ("pulses_mn", "sd_mn", "said"),
    [
        ([5, 12, 7], 0.5, "12 mN, at 0.6 N, 1.00 mm deep at station 3, and 7 mN at the last"),
        (
            [5, 12, 11.5],
            0.5,
            "12 mN, at 0.6 N, 1.00 mm deep at station 3, and not less at the last",
        ),
        ([5, 12, 14], 0.5, "14 mN, at 0.9 N, 1.50 mm deep at station 3, and not less at the last"),
    ],
)
def test_the_step_of_the_greatest_pulse_is_said_and_whether_it_falls_beyond(pulses_mn, sd_mn, said):
    steps = [
        {"station": 3, "depth_mm": 0.5 * (n + 1), "force_n": 0.3 * (n + 1),
         "pulse_n": 1e-3 * pulse_mn, "pulse_sd_n": 1e-3 * sd_mn}
        for n, pulse_mn in enumerate(pulses_mn)
    ]  # fmt: skip
    assert said in hold_down_line({"steps": steps, "heart_rate_bpm": 72.0})
    assert hold_down_line({"steps": steps, "heart_rate_bpm": None}) == "", "no pulse, no greatest"
