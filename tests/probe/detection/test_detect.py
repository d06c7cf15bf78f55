"""Whole scans with a known truth."""

import json
from dataclasses import replace

import numpy as np
import pytest
from known_presses import recording, row, station

from drivers.core.arrays import Array
from probe.detection import detect
from probe.detection.finding import Finding, ObjectFinding, StationFinding
from probe.detection.map.objects import objects_in
from probe.detection.map.pressed import Pressed
from probe.detection.map.row_shapes import shape
from probe.detection.scan import _reasons


def test_false_findings_are_as_rare_as_stated() -> None:
    """60 tilted, scattered, relaxing rows over nothing, at 5 %: at most 6 in 95 % of cases."""
    rng = np.random.default_rng(1)
    wrong = sum(
        detect(recording(row(rng, hold_s=1.0, sample_hz=100.0)), false_alarm=0.05).finding
        not in ("nothing", "cannot see")
        for _ in range(60)
    )
    assert wrong <= 6


def test_a_stiff_place_without_pulse_is_a_tumour_at_its_place() -> None:
    rng = np.random.default_rng(2)
    off = []
    for centre in (21.0, 30.5, 33.0, 44.2):
        found = detect(recording(row(rng, centre_mm=centre, bump=0.2, noise_pa=5.0)))
        (one,) = found.objects
        assert one.kind == found.finding == "tumour"
        off.append(1e3 * one.position_m - centre)
        assert 1e3 * one.position_ci_m[0] - 0.5 <= centre <= 1e3 * one.position_ci_m[1] + 0.5
    assert np.sqrt(np.mean(np.square(off))) < 0.5


def test_pulse_size_tells_healthy_from_stenotic() -> None:
    rng = np.random.default_rng(3)
    healthy = detect(recording(row(rng, bump=0.1, pulse_pa=600.0)))
    stenotic = detect(recording(row(rng, bump=0.25, pulse_pa=25.0, noise_pa=5.0)))
    assert healthy.finding == "artery"
    assert stenotic.finding == "stenotic artery"


def test_a_dip_that_pulses_is_an_artery() -> None:
    """A soft-walled vessel can make its place softer."""
    found = detect(recording(row(np.random.default_rng(4), bump=-0.06, pulse_pa=600.0)))
    (one,) = found.objects
    assert one.kind == "artery"
    assert one.peak_pa < 0
    assert 1e3 * one.position_m == pytest.approx(33.0, abs=0.7)


def test_what_could_hide_a_pulse_is_undecided() -> None:
    """A stiff place under a sensor too noisy to see a stenotic pulse."""
    found = detect(recording(row(np.random.default_rng(5), bump=0.25, noise_pa=900.0, hold_s=1.0)))
    assert found.finding in ("undecided", "nothing")
    assert found.finding == "nothing" or "hold for more beats" in found.reason


def test_two_objects() -> None:
    rng = np.random.default_rng(6)
    one = row(rng, centre_mm=18.0, bump=0.2, scatter=0.001, tilt=0.0, noise_pa=2.0)
    other = row(
        rng, centre_mm=46.0, bump=0.1, pulse_pa=600.0, scatter=0.001, tilt=0.0, noise_pa=2.0
    )
    both = [replace(a, signal_pa=a.signal_pa + b.signal_pa - 9000.0) for a, b in
            zip(one, other, strict=True)]  # fmt: skip
    found = detect(recording(both))
    lump, vessel = found.objects  # along the row
    assert max(lump.chances, key=lambda kind: lump.chances[kind]) == "tumour"
    assert lump.confidence > 0.75, "the artery's pulse reaches there, and hides a stenosis' own"
    assert vessel.kind == "artery"
    assert [one.position_mm for one in found.objects] == pytest.approx([18.0, 46.0], abs=1.0)


def test_a_stenosis_in_a_row_with_a_healthy_artery_is_not_called_a_lump() -> None:
    rng = np.random.default_rng(6)
    quiet = {"scatter": 0.001, "tilt": 0.0, "noise_pa": 4.0}
    one = row(rng, centre_mm=16.0, bump=0.1, pulse_pa=600.0, **quiet)
    other = row(rng, centre_mm=48.0, bump=0.3, pulse_pa=30.0, **quiet)
    both = [replace(a, signal_pa=a.signal_pa + b.signal_pa - 9000.0)
            for a, b in zip(one, other, strict=True)]  # fmt: skip
    found = detect(recording(both))
    assert [one.kind for one in found.objects] == ["artery", "stenotic artery"]


def test_a_reason_of_one_of_several_objects_says_of_which() -> None:
    one = ObjectFinding("artery", 20e-3, (19e-3, 21e-3), 300.0, 450.0, 0.99)
    unsure = replace(one, kind="undecided", position_m=50e-3, reason="hold longer")
    alike = replace(unsure, position_m=70e-3)
    assert _reasons([unsure]) == "hold longer"
    assert _reasons([one, unsure]) == "at x = 50.00 mm: hold longer"
    assert _reasons([one, unsure, alike]) == "hold longer"


def line(pulse_pa: list[float], level_pa: Array) -> Pressed:
    """A row's maps, pulses known to 15 Pa."""
    n = len(pulse_pa)
    place_m = 4e-3 * np.arange(1, n + 1)[:, None]
    return Pressed(place_m, level_pa, np.full(n, 30.0), np.array(pulse_pa), np.full(n, 15.0),
                   ((),) * n, 2e-3)  # fmt: skip


@pytest.mark.parametrize("wrong_pa", [20.0, 116.0, 400.0])
def test_a_press_that_is_measured_badly_does_not_split_a_vessel(wrong_pa: float) -> None:
    """A hand swayed in the middle of its pulses, whose neighbours show where it is: two vessels
    were named, or one beside it."""
    x_m = 4e-3 * np.arange(1, 16)
    pulse_pa = 245.0 * shape(x_m, 31e-3, 6e-3)
    pulse_pa[7] = wrong_pa
    flat = line(pulse_pa.tolist(), 9000 * (1 + 0.1 * shape(x_m, 31e-3, 6e-3)))
    swayed = replace(flat, pulse_sd_pa=np.where(x_m == x_m[7], 130.0, 4.0))
    (one,) = objects_in(swayed, 0.999, 0.01)
    assert one.position_ci_m[0] <= 31e-3 <= one.position_ci_m[1]


def test_pulses_that_stray_by_more_than_they_say_name_nothing_else() -> None:
    """A vessel pulses near the row's first end, tremor is in all presses, a lump has the most."""
    x_m = 4e-3 * np.arange(1, 20)
    level_pa = 9000 * (1 + 0.3 * shape(x_m, 57e-3, 5e-3))
    still = [500, 900, 500, 250, 90, 40, 20, 10, 12, 9, 15, 11, 9, 14, 12, 10, 16, 9, 12]
    tremor = [0, 0, 0, 90, 10, 110, 5, 130, 20, 140, 10, 90, 20, 120, 120, 0, 150, 20, 130]
    pulse_pa = [float(a + b) for a, b in zip(still, tremor, strict=True)]
    beating, other = sorted(objects_in(line(pulse_pa, level_pa), 0.999, 0.01),
                            key=lambda one: one.position_m)  # fmt: skip
    assert beating.kind == "artery"
    assert other.position_m == pytest.approx(57e-3, abs=1e-3)
    assert other.kind == "undecided"


def test_what_stands_beside_another_is_as_high_as_by_itself() -> None:
    x_m = 4e-3 * np.arange(1, 20)
    both_pa = 9000 * (1 + 0.8 * shape(x_m, 22e-3, 5e-3) + 0.3 * shape(x_m, 50e-3, 5e-3))
    found = objects_in(line([0.0] * 19, both_pa), None, 0.01)
    heights = {round(1e3 * one.position_m): one.peak_pa for one in found}
    assert heights == {22: pytest.approx(7200, rel=0.02), 50: pytest.approx(2700, rel=0.02)}


def test_a_grid_gives_the_course_and_its_stenosed_stretch() -> None:
    rng = np.random.default_rng(7)
    stations = []
    for k in range(6):
        sick = k in (2, 3)
        stations += row(rng, centre_mm=24.0 + 2 * k, y_mm=4.0 * k, first=15 * k, tilt=0.0,
                        bump=0.3 if sick else 0.1, pulse_pa=20.0 if sick else 600.0,
                        noise_pa=4.0, hold_s=2.5)  # fmt: skip
    found = detect(recording(stations))
    (one,) = found.objects
    assert one.kind == found.finding == "stenotic artery"
    assert len(one.course) == 6
    x = np.array([1e3 * p[0] for p in one.course])
    assert np.abs(x - (24.0 + 2 * np.arange(6))).max() < 1.5
    assert one.stenosed_m == pytest.approx((8e-3, 12e-3))


@pytest.mark.parametrize("hold_s", [1.7, 2.5])  # what moves is asked of holds of 2 s or more
def test_a_grid_without_bumps_gives_the_course_by_pulses(hold_s: float) -> None:
    rng = np.random.default_rng(7)
    rows = [row(rng, centre_mm=30.0, y_mm=4.0 * k, first=15 * k, tilt=0.0, pulse_pa=600.0,
                noise_pa=4.0, hold_s=hold_s) for k in range(4)]  # fmt: skip
    (one,) = detect(recording([station for stations in rows for station in stations])).objects
    assert one.kind == "artery"
    assert [round(1e3 * y_m) for _, y_m in one.course] == [0, 4, 8, 12]


def test_one_press_tells_a_pulse_and_no_more() -> None:
    rng = np.random.default_rng(8)
    nothing = detect(recording([station(rng)]))
    assert nothing.finding == "nothing"
    assert "would have shown" in nothing.reason
    placed = detect(recording([station(rng, x_mm=32.0)]))
    assert placed.finding == "undecided"  # a lump may lie there
    assert "would have shown); a lump needs a row of 9 stations" in placed.reason
    pulse = detect(recording([station(rng, pulse_pa=200.0)]))
    assert pulse.finding == "artery"
    assert json.loads(json.dumps(pulse.as_json(), allow_nan=False))["objects"][0]["peak_pa"] is None


@pytest.mark.parametrize(("hold_s", "warned"), [(2.5, True), (5.0, False)])
def test_a_short_hold_says_what_may_pass_for_a_pulse(hold_s: float, warned: bool) -> None:
    """In 2.5 s a breath looks like beats."""
    press = station(np.random.default_rng(3), pulse_pa=400.0, hold_s=hold_s)
    found = detect(recording([press]))
    assert found.finding == "artery"
    assert ("breathing" in found.reason) == warned


def test_repeats_at_one_place_are_one_station() -> None:
    rng = np.random.default_rng(9)
    twice = row(rng, bump=0.2, noise_pa=5.0) + row(rng, bump=0.2, noise_pa=5.0, first=15)
    found = detect(recording(twice))
    assert found.finding == "tumour"
    assert len(found.stations) == 30


@pytest.mark.parametrize("level_pa", [9000.0, -9000.0])
def test_a_press_that_reads_less_than_nothing_says_so(level_pa: float) -> None:
    (one,) = detect(recording([station(np.random.default_rng(1), level_pa=level_pa)])).stations
    assert ("check the sign" in one.note) == (level_pa < 0)


@pytest.mark.parametrize("false_alarm", [0.0, 1.0, -1.0, float("nan")])
def test_a_chance_is_between_0_and_1(false_alarm: float) -> None:
    with pytest.raises(ValueError, match="between 0 and 1"):
        detect(recording([]), false_alarm=false_alarm)


def test_an_empty_recording_is_undecided() -> None:
    found = detect(recording([]))
    assert found.finding == "undecided"
    assert found.reason == "the run has no complete station"


def test_a_lump_states_no_pulse_that_its_station_did_not_see() -> None:
    """A lump had "pulse 2.23 Pa" where its stations said "< 8"."""
    lump = ObjectFinding("tumour", 0.032, (0.031, 0.033), 1000.0, 2.23, 0.95)
    for below_pa, shown in ((8.0, None), (float("nan"), 2.23)):
        near = StationFinding(1, 0.0321, 0.0, 0.0, pulse_pa=2.0, pulse_below_pa=below_pa)
        far = StationFinding(2, 0.040, 0.0, 0.0, pulse_pa=9.0)
        found = Finding("tumour", (lump,), (near, far), "", 0.01)
        assert found.as_json()["objects"][0]["pulse_pa"] == shown
        assert ("pulse" in repr(found)) == (shown is not None)
