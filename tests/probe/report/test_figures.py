"""A report's figures tell the truth, and are read on a phone and in the dark."""

import re
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from recordings import FACE_M2, finding, grid, row, station

from drivers.core.array_layout import taxel_names
from probe.core.recording import Recording, Station
from probe.report import figures
from probe.report.page import page, svg
from probe.report.taxel_figure import taxels


def test_diastole_and_systole_are_those_of_the_beat() -> None:
    low, high = figures.diastole_and_systole(station(0, 0.032), 0.825)
    assert high - low == pytest.approx(80.0, rel=0.02)
    assert low < station(0, 0.032).hold_level_pa < high


@pytest.mark.parametrize(("ramp_s", "begun_s"), [(1.0, 0.0), (3.0, 0.3), (0.2, 0.71)])
def test_any_ramp_and_a_free_heart_are_read_alike(ramp_s: float, begun_s: float) -> None:
    """The heart beats on its own clock, at 50/min, through holds of three beats that relax."""
    t = np.arange(0.0, ramp_s + 3.7, 0.01)
    level = 9000 * np.clip(t / ramp_s, 0, 1) - 30 * np.clip(t - ramp_s, 0, None)
    signal = level + 40 * np.sin(2 * np.pi * (t + begun_s) / 1.2)
    press = Station(
        0, 0.0, 0.0, t, signal[:, None], np.zeros((len(t), 1), bool), 0.0, ramp_s, ramp_s + 3.65,
        np.zeros(len(t)),
    )  # fmt: skip
    low, high = figures.diastole_and_systole(press, 1.2)
    assert high - low == pytest.approx(80.0, rel=0.05)
    assert np.isnan(figures.diastole_and_systole(press, 5.0)).all()  # no whole beat was held


def test_only_the_level_is_drawn_without_a_pulse() -> None:
    with figures.style():
        (axes,) = figures.tactile_map(row()).axes
        assert [line.get_label() for line in axes.lines] == ["mean of the hold"]
        (axes,) = figures.tactile_map(row(), 60 / 0.825).axes
    assert [line.get_label() for line in axes.lines] == [
        "diastole", "mean of the hold", "systole",
    ]  # fmt: skip


def test_a_scan_without_a_pulse_shows_its_hardest_press() -> None:
    found = finding(grid())
    found["stations"][-1]["pulse_pa"] = 1e4  # noise, as large as it may be
    shown, why = figures.best_station(grid(), found)
    assert shown.signal_pa.max() == max(s.signal_pa.max() for s in grid().stations)
    assert why == "the hardest pressed; nothing pulses"
    found["heart_rate_bpm"] = 72.0
    shown, why = figures.best_station(grid(), found)
    assert (shown.index, why) == (39, "the strongest pulse")


def test_a_robots_grid_has_no_holes() -> None:
    aside = np.array([0.0, 2e-3, -3e-3, 1e-3])
    columns, rows, table = figures.grid_of(
        np.array([0.0, 4.0, 4.0, 0.0]) + aside, np.array([0.0, 0.0, 4.0, 4.0]) - aside, np.ones(4)
    )
    assert columns == pytest.approx([0, 4], abs=0.01)
    assert rows == pytest.approx([0, 4], abs=0.01)
    assert (table == 1).all()


def test_a_grid_becomes_a_table_with_holes_where_no_station_is() -> None:
    columns, rows, table = figures.grid_of(
        np.array([0.0, 4.0, 0.0]), np.array([0.0, 0.0, 4.0]), np.array([1.0, 2.0, 3.0])
    )
    assert columns.tolist() == [0, 4]
    assert rows.tolist() == [0, 4]
    assert table[0].tolist() == [1, 2]
    assert table[1, 0] == 3
    assert np.isnan(table[1, 1])


def test_ink_follows_the_page_so_that_dark_is_readable() -> None:
    with figures.style():
        drawing = svg(figures.force_trace(station(0, 0.032), FACE_M2, "station 1"))
    assert "currentColor" in drawing
    assert figures.INK not in drawing


def test_an_object_without_an_interval_is_drawn_as_a_line() -> None:
    found = finding(row())
    one = {"kind": "undecided", "position_mm": 12.0, "position_ci_mm": None}
    (axes,) = figures.pulse_map({**found, "objects": [one]}, row()).axes
    dashed = [line for line in axes.lines if line.get_linestyle() == "--"]
    assert [line.get_xdata()[0] for line in dashed] == [12.0]


def test_pulses_are_drawn_with_their_limits() -> None:
    (axes,) = figures.pulse_map(finding(row()), row()).axes
    (bars,) = axes.collections
    low, high = bars.get_segments()[0][:, 1]
    assert high - low == pytest.approx(2 * 1.96 * 5.0)


def test_no_figure_is_wider_than_a_column_so_that_a_phone_shows_it_whole() -> None:
    """At 360 px a figure of one column shows its text at 11 px; nothing asks for more width."""
    triangle = np.array([[0, 1, 2]])
    nodes_m = np.array([[0.0, 0.0], [0.064, 0.0], [0.064, 0.017]])
    drawn = [
        figures.tactile_map(row()),
        figures.tactile_map(grid(), 60 / 0.825),
        figures.pulse_map(finding(grid()), grid()),
        figures.force_trace(station(0, 0.032), FACE_M2, "station 1"),
        figures.section(nodes_m, np.zeros((3, 2)), triangle, np.ones(3)),
    ]
    assert {figure.get_figwidth() for figure in drawn} == {figures.PAPER_WIDTH_IN}
    text = page("a run", {"simulated": [], "finish": "completed", **finding(row())}, [], {}, {})
    assert "min-width:" not in text


def test_a_grids_pulse_map_shows_the_course_and_where_it_is_stenosed() -> None:
    found: dict[str, Any] = finding(grid())
    course = [[30.0, 0.0], [31.0, 4.0], [32.0, 8.0], [33.0, 12.0]]
    found["objects"][0] |= {"course_mm": course, "stenosed_mm": [4.0, 8.0]}
    vessel, stenosed = figures.pulse_map(found, grid()).axes[0].lines
    assert vessel.get_xydata().tolist() == course
    assert vessel.get_label() == "artery"
    assert stenosed.get_xydata().tolist() == course[1:3]


@pytest.mark.parametrize(("seen_pa", "most_pa"), [(0.0, 240.0), (90.0, 90.0)])
def test_a_grids_pulses_are_on_a_scale_from_0_also_where_none_was_seen(
    seen_pa: float, most_pa: float
) -> None:
    found: dict[str, Any] = finding(grid())
    for n, one in enumerate(found["stations"]):
        one["pulse_pa"], one["pulse_below_pa"] = 100.0, 240.0 - n
    if seen_pa:
        found["stations"][3] |= {"pulse_pa": seen_pa, "pulse_below_pa": None}
    figure = figures.pulse_map(found, grid())
    (picture,) = figure.axes[0].collections
    assert picture.get_clim() == (0.0, most_pa)
    assert len(figure.axes[1].get_xticks()) <= 7


@pytest.mark.parametrize("recording", [row(), grid()], ids=["row", "grid"])
def test_what_is_not_seen_is_marked_and_not_drawn_as_0(recording: Recording) -> None:
    found: dict[str, Any] = finding(recording)
    found["stations"][2]["pulse_below_pa"] = 240.0
    axes = figures.pulse_map(found, recording).axes[0]
    (mark,) = [line for line in axes.lines if "seen" in str(line.get_label())]
    x_mm, y = mark.get_xydata()[0]
    assert x_mm == pytest.approx(1e3 * recording.stations[2].x_m)
    if len(recording.rows()) > 1:
        assert np.ma.getmaskarray(axes.collections[0].get_array()).ravel()[2]
    else:
        assert y == 240.0
        drawn: Any = axes.containers[0]
        assert len(drawn[0].get_ydata()) == len(recording.stations) - 1


def test_every_curve_is_named() -> None:
    def words(figure: Figure) -> set[str]:
        return {text.get_text() for legend in figure.legends for text in legend.get_texts()}

    found: dict[str, Any] = finding(row())
    assert words(figures.pulse_map(found, row())) == {"pulse, 95 %", "place, 95 %"}
    found["stations"][2]["pulse_below_pa"] = 240.0
    assert "not seen: below this" in words(figures.pulse_map(found, row()))
    assert len(words(figures.tactile_map(row(), 60 / 0.825))) == 3


def test_every_axis_names_its_unit() -> None:
    with figures.style():
        drawn = [
            figures.tactile_map(row()),
            figures.tactile_map(grid()),
            figures.pulse_map(finding(row()), row()),
            figures.force_trace(station(0, 0.032), FACE_M2, "station 1"),
        ]
    for figure in drawn:
        for axes in figure.axes:
            shown = [axis for axis in (axes.xaxis, axes.yaxis) if len(axis.get_ticklocs())]
            labels = [axis.get_label_text() for axis in shown]
            assert labels
            assert all(re.search(r"\[(mm|s|N|Pa|kPa)\]", label) for label in labels), labels


@pytest.mark.parametrize(("rows", "columns"), [(1, 8), (4, 7), (8, 8), (16, 16)])
def test_an_array_is_drawn_as_it_lies_with_its_pulse(rows: int, columns: int) -> None:
    """Of the hold and not of the air about it; r0c1 is dead, and not seen."""
    count = rows * columns
    level = np.add.outer(100.0 * np.arange(rows), np.arange(columns)).ravel() + 1000.0
    time_s = np.arange(0.0, 4.0, 0.01)
    held = (time_s >= 1.0) & (time_s < 3.0)
    beat = np.sin(2 * np.pi * time_s / 0.825)[:, None] * np.linspace(1.0, 2.0, count)
    signal = held[:, None] * (level + 40 * beat)
    alive = np.arange(count) != 1
    press = Station(
        0, 0.0, 0.0, time_s, signal[:, alive], np.zeros((len(time_s), count - 1), bool), 0.0, 1.0,
        3.0, np.zeros(len(time_s)),
    )  # fmt: skip
    names = tuple(f"skin.{name}" for name in taxel_names(rows, columns) if name != "r0c1")
    with figures.style():
        drawn = taxels(Recording((press,), names, (), FACE_M2), press, 60 / 0.825)
    images = [axes.collections[0].get_array() for axes in drawn.axes[:2]]
    mean, pulse = (np.ma.filled(image, np.nan) for image in images)
    assert mean.shape == pulse.shape == (rows, columns)
    np.testing.assert_allclose(1e3 * mean.ravel()[alive], level[alive], atol=20)
    np.testing.assert_allclose(
        pulse.ravel()[alive], 80 * np.linspace(1, 2, count)[alive], rtol=0.02
    )
    for axes in drawn.axes[:2]:
        assert axes.lines[0].get_xydata().tolist() == [[1, 0]]
    no_array = Recording((press,), ("cell.force",) * (count - 1), (), FACE_M2)
    assert taxels(no_array, press, None) is None
