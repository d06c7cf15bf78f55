"""The report is complete, self-contained, marked where simulated, and its maps tell the truth."""

import errno
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from drivers import Channel
from probe.core.events import RunStarted
from probe.core.recording import Recording, Station
from probe.report import figures
from probe.report.anonymous import anonymous
from probe.report.page import Picture, page, svg
from probe.report.write import report
from sim_backend import Scene, load_scene
from sim_backend.models.press import CannotSolve

FACE_M2 = 1e-4


def station(index: int, x_m: float, y_m: float = 0.0) -> Station:
    """A press of 1 s and a hold with one beat, strongest at 32 mm."""
    t = np.arange(0, 2.2, 0.01)
    near = np.exp(-(((x_m - 0.032) / 0.008) ** 2))
    ramp = np.clip(t, 0, 1)
    beat = np.where((t > 1) & (t < 1.825), np.sin(2 * np.pi * (t - 1) / 0.825), 0.0)
    signal = 9000 * ramp + near * (600 * ramp + 40 * beat)
    return Station(
        index, x_m, y_m, t + 5, signal[:, None], np.zeros((len(t), 1), bool), 5.0, 6.0, 6.825,
        2.5e-3 * ramp,
    )  # fmt: skip


def row() -> Recording:
    stations = tuple(station(n, 4e-3 * (n + 1)) for n in range(15))
    return Recording(stations, ("virtual.force",), ("virtual.force",), FACE_M2)


def grid() -> Recording:
    stations = tuple(
        station(8 * j + i, 4e-3 * (i + 4), 4e-3 * j) for j in range(5) for i in range(8)
    )
    return Recording(stations, ("virtual.force",), (), FACE_M2)


def finding(recording: Recording) -> dict[str, object]:
    stations = [
        {
            "station": s.index + 1,
            "x_mm": 1e3 * s.x_m,
            "y_mm": 1e3 * s.y_m,
            "baseline_pa": 9000.0,
            "baseline_sd_pa": 2.0,
            "pulse_sd_pa": 5.0,
            "pulse_below_pa": None,
            "pulse_pa": float(np.ptp(s.signal_pa[110:180])),
        }
        for s in recording.stations
    ]
    one = {
        "kind": "artery", "position_mm": 32.0, "position_ci_mm": [31.4, 32.6], "peak_pa": 9600.0,
        "pulse_pa": 80.0, "confidence": 0.99,
    }  # fmt: skip
    return {"finding": "artery", "objects": [one], "stations": stations}


def started() -> RunStarted:
    config = {"scene": None, "plan": {"indentation_mm": 2.5}, "versions": {"palpate": "0.1.0"}}
    force = Channel("force", "N", "force", simulated=True)
    return RunStarted(0.0, "2026-01-01T00:00:00+00:00", config, {"virtual": (force,)})


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


def test_a_grids_table_has_y_and_counts_from_one() -> None:
    recording = grid()
    reported = {"simulated": [], "finish": "completed", **finding(recording)}
    reported["heart_rate_bpm"], reported["heart_rate_ci_bpm"] = 72.7, [72.0, 73.4]
    text = page("a run", reported, [], {}, {})
    assert "<th scope='col'>y [mm]</th>" in text
    assert "<td>1</td><td>16.00</td><td>0.00</td>" in text
    assert "heart rate 73 /min (95 %: 72 to 73)" in text
    assert "<td>9000.0</td><td>3.9</td>" in text  # 1.96 standard deviations
    assert "e+0" not in text


def test_a_scan_without_a_pulse_shows_its_hardest_press() -> None:
    found = finding(grid())
    found["stations"][-1]["pulse_pa"] = 1e4  # noise, as large as it may be
    shown, why = figures.best_station(grid(), found)
    assert shown.signal_pa.max() == max(s.signal_pa.max() for s in grid().stations)
    assert why == "the hardest pressed; nothing pulses"
    found["heart_rate_bpm"] = 72.0
    shown, why = figures.best_station(grid(), found)
    assert (shown.index, why) == (39, "the strongest pulse")


def test_the_section_is_that_of_the_row_which_was_pressed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An oblique vessel lies elsewhere in each row."""
    scene = load_scene("TIHA").model_dump(mode="json")
    scene["inclusion"][0]["path"] = [[0.0, 20.0, 10.0], [16.0, 36.0, 10.0]]
    config = started().config | {"scene": scene}
    found = finding(grid())
    found["stations"][-1]["pulse_pa"] = 1e4  # in the last row, y = 16 mm
    found |= {"heart_rate_bpm": 72.0, "heart_rate_ci_bpm": [70.0, 74.0]}
    pressed = []

    def press(there: Scene, x_mm: float, *_: object) -> None:
        pressed.append((there.arteries[0].x_mm, x_mm))
        raise CannotSolve("mesh", "shown without")

    monkeypatch.setattr("sim_backend.models.press.press", press)
    one = replace(started(), config=config)
    text = report(grid(), one, found, Path("grid.run"), tmp_path).read_text()
    assert pressed == [(36.0, 44.0)]
    assert "station 40 at x = 44.0 mm, y = 16.0 mm, the strongest pulse" in text


def test_a_certain_finding_is_not_called_certain() -> None:
    reported = {"simulated": [], "finish": "completed", **finding(row())}
    reported["objects"][0]["confidence"] = 1.0
    assert "99.9 %" in page("a run", reported, [], {}, {})


def test_an_anonymous_run_names_nobody() -> None:
    config = {
        "labels": {"operator": "Ann", "specimen": "Bob"},
        "rig": {"stage": {"driver": "ur", "host": "10.1.2.3"}, "sensor": [{"port": "/dev/x"}]},
        "calibration": {"force": {"file": "/home/ann/f.json", "sha256": "0"}},
    }
    kept = anonymous(RunStarted(0.0, "2026-01-01T00:00:00+00:00", config, {}))
    for telling in ("Ann", "Bob", "10.1.2.3", "/dev/x", "/home", "2026"):
        assert telling not in str(kept)
    assert kept.config["rig"]["stage"]["driver"] == "ur"


def test_a_robots_grid_has_no_holes() -> None:
    """Measured places differ by micrometres within a row and a column."""
    aside = np.array([0.0, 2e-3, -3e-3, 1e-3])
    columns, rows, table = figures.grid_of(
        np.array([0.0, 4.0, 4.0, 0.0]) + aside, np.array([0.0, 0.0, 4.0, 4.0]) - aside, np.ones(4)
    )
    assert columns == pytest.approx([0, 4], abs=0.01)
    assert rows == pytest.approx([0, 4], abs=0.01)
    assert (table == 1).all()


def test_an_anonymous_run_names_no_file_of_its_user() -> None:
    """A home folder has a name, and so may a scene, a wave, a calibration and a computer."""
    home = "/home/ann/bob.toml"
    config = {
        "rig": {
            "stage": {"driver": "own", "program": "C:\\Users\\ann\\move.script"},
            "sensor": [{"driver": "own", "models": [home]}],
            "scene": {"name": "bob.toml", "surface_mm": 1.0},
            "calibration": {"force": "bob.json"},
        },
        "scene": load_scene("TIHA").model_dump(mode="json"),
        "computer": "0123abcd",
    }
    config["scene"]["pulse"]["wave"] = "bob.csv"
    kept = anonymous(RunStarted(0.0, "2026-01-01T00:00:00+00:00", config, {})).config
    for telling in ("ann", "bob", "0123abcd"):
        assert telling not in str(kept)
    assert kept["rig"]["scene"]["surface_mm"] == 1.0
    assert Scene.model_validate(kept["scene"]).name == "TIHA"  # what the section is drawn from
    built_in = {"rig": {"scene": {"name": "TIHA"}}}
    assert anonymous(RunStarted(0.0, "", built_in, {})).config == built_in


def test_a_grid_becomes_a_table_with_holes_where_no_station_is() -> None:
    columns, rows, table = figures.grid_of(
        np.array([0.0, 4.0, 0.0]), np.array([0.0, 0.0, 4.0]), np.array([1.0, 2.0, 3.0])
    )
    assert columns.tolist() == [0, 4]
    assert rows.tolist() == [0, 4]
    assert table[0].tolist() == [1, 2]
    assert table[1, 0] == 3
    assert np.isnan(table[1, 1])


@pytest.mark.parametrize("recording", [row(), grid()], ids=["row", "grid"])
def test_the_page_needs_nothing_else_and_the_figures_lie_beside_it(
    recording: Recording, tmp_path: Path
) -> None:
    path = report(recording, started(), finding(recording), Path("a.run"), tmp_path)
    text = path.read_text()
    assert "Finding: artery" in text
    assert "31.40 to 32.60" in text
    assert "<h1>Run a, 2026-01-01 00:00 UTC</h1>" in text
    assert not re.search(r"(?:src|href)=['\"]https?:", text)
    assert "prefers-color-scheme: dark" in text
    assert text.count("<svg") == 3
    for name in ("tactile_map", "pulse_map", "force"):
        for ending in ("png", "svg", "pdf"):
            assert (tmp_path / f"{name}.{ending}").stat().st_size > 1000


@pytest.mark.parametrize("wrote", [".png", ".html"])
def test_a_full_disk_is_said_of_the_file_that_it_does_not_take(
    wrote: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the system tells it, without the file."""

    def full(_self: object, to: object, **_more: object) -> None:
        if wrote == ".html" or isinstance(to, Path):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(*((Path, "write_text") if wrote == ".html" else (Figure, "savefig")), full)
    monkeypatch.setattr(
        "probe.report.write._pictures", lambda *_: ([Picture("map", "", Figure())], [])
    )
    monkeypatch.setattr("probe.report.write.page", lambda *_: "a page")
    with pytest.raises(OSError, match="No space") as said:
        report(row(), started(), finding(row()), tmp_path / "a.run", tmp_path / "out")
    named = {".png": "map.png", ".html": "report.html"}[wrote]
    assert said.value.filename == str(tmp_path / "out" / named)


def test_simulated_and_aborted_runs_say_so_on_the_page(tmp_path: Path) -> None:
    recording = row()
    aborted = Recording(
        recording.stations, recording.channels, recording.simulated, FACE_M2, "aborted"
    )
    text = report(aborted, started(), finding(aborted), Path("a.run"), tmp_path).read_text()
    assert "SIMULATED: virtual.force" in text
    assert "This run was aborted" in text


def test_the_top_says_who_scanned_what_and_how(tmp_path: Path) -> None:
    config = started().config | {
        "labels": {"operator": "Ann <A>", "specimen": "gel 3"},
        "plan": {
            "stations": [[0, 4.0, 0.0]],
            "indentation_mm": 2.5,
            "ramp_s": 1.0,
            "hold_s": 0.825,
        },
        "rig": {"stage": {"driver": "ur"}, "sensor": [{"driver": "ft300"}]},
    }
    begun = replace(started(), config=config)
    text = report(row(), begun, finding(row()), Path("a.run"), tmp_path).read_text("utf-8")
    top = re.sub(r"<[^>]+>", "", text.split("class='about'>")[1].split("</p>")[0])
    assert top == (
        "operator Ann &lt;A&gt; &middot; specimen gel 3 &middot; stations 1 &middot; depth 2.5 mm "
        "&middot; ramp 1 s &middot; hold 0.825 s &middot; rig ur + ft300"
    )
    assert text.index("class='about'") < text.index("Finding:")


def test_text_from_a_run_cannot_become_markup(tmp_path: Path) -> None:
    path = report(row(), started(), finding(row()), Path("<script>x</script>"), tmp_path)
    assert "<script>" not in path.read_text()


def test_ink_follows_the_page_so_that_dark_is_readable() -> None:
    with figures.style():
        drawing = svg(figures.force_trace(station(0, 0.032), FACE_M2, "station 1"))
    assert "currentColor" in drawing
    assert figures.INK not in drawing


def test_an_object_without_an_interval_is_drawn_as_a_line() -> None:
    """What one station alone shows has a place and no interval."""
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
    """A map without a pulse had a scale from -0.1 to 0.1 Pa, whose numbers ran into each other."""
    found: dict[str, Any] = finding(grid())
    for n, one in enumerate(found["stations"]):
        one["pulse_pa"], one["pulse_below_pa"] = 100.0, 240.0 - n
    if seen_pa:
        found["stations"][3] |= {"pulse_pa": seen_pa, "pulse_below_pa": None}
    figure = figures.pulse_map(found, grid())
    (picture,) = figure.axes[0].collections
    assert picture.get_clim() == (0.0, most_pa)
    assert len(figure.axes[1].get_xticks()) <= 7


def test_a_bound_stays_in_one_line_on_a_phone(tmp_path: Path) -> None:
    found: dict[str, Any] = finding(row())
    found["stations"][2]["pulse_below_pa"] = 240.0
    text = report(row(), started(), found, Path("a.run"), tmp_path).read_text(encoding="utf-8")
    assert "&lt;&nbsp;240.0" in text


def test_a_grids_objects_leave_their_columns_to_a_phone(tmp_path: Path) -> None:
    """The course had a column of its own, which pushed the confidence out of the screen."""
    found: dict[str, Any] = finding(grid())
    found["objects"][0]["course_mm"] = [[30.0, 0.0], [32.0, 16.0]]
    text = report(grid(), started(), found, Path("a.run"), tmp_path).read_text(encoding="utf-8")
    assert "<p>artery: seen from x, y = 30.0, 0.0 to 32.0, 16.0 mm</p>" in text
    assert "<td>seen" not in text


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


def test_a_run_without_a_complete_station_is_refused_with_what_to_do(tmp_path: Path) -> None:
    empty = Recording((), ("virtual.force",), (), FACE_M2)
    with pytest.raises(ValueError, match=r"palpate resume"):
        report(empty, started(), finding(empty), Path("a.run"), tmp_path)
