"""The report is complete, self-contained, marked where simulated, and its maps tell the truth."""

import re
from pathlib import Path

import numpy as np
import pytest

from drivers import Channel
from probe.events import RunStarted
from probe.recording import Recording, Station
from probe.report import figures
from probe.report.page import svg
from probe.report.write import report

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
            "x_mm": 1e3 * s.x_m,
            "baseline_pa": 9000.0,
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


def test_maps_read_the_signal_at_the_papers_times() -> None:
    press = station(0, 0.032)
    expected = [float(np.interp(5 + t, press.time_s, press.signal_pa[:, 0])) for t in (1.1, 1.4)]
    assert [figures.signal_at(press, t) for t in (1.1, 1.4)] == pytest.approx(expected)
    assert np.isnan(figures.signal_at(press, 9.0))


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
    assert not re.search(r"(?:src|href)=['\"]https?:", text)
    assert "prefers-color-scheme: dark" in text
    assert text.count("<svg") == 3
    for name in ("tactile_map", "pulse_map", "force"):
        for ending in ("png", "svg", "pdf"):
            assert (tmp_path / f"{name}.{ending}").stat().st_size > 1000


def test_simulated_and_aborted_runs_say_so_on_the_page(tmp_path: Path) -> None:
    recording = row()
    aborted = Recording(
        recording.stations, recording.channels, recording.simulated, FACE_M2, "aborted"
    )
    text = report(aborted, started(), finding(aborted), Path("a.run"), tmp_path).read_text()
    assert "SIMULATED: virtual.force" in text
    assert "This run was aborted" in text


def test_text_from_a_run_cannot_become_markup(tmp_path: Path) -> None:
    path = report(row(), started(), finding(row()), Path("<script>x</script>"), tmp_path)
    assert "<script>" not in path.read_text()


def test_ink_follows_the_page_so_that_dark_is_readable() -> None:
    with figures.style():
        drawing = svg(figures.force_trace(station(0, 0.032), FACE_M2))
    assert "currentColor" in drawing
    assert figures.INK not in drawing


def test_every_axis_names_its_unit() -> None:
    with figures.style():
        drawn = [
            figures.tactile_map(row()),
            figures.tactile_map(grid()),
            figures.pulse_map(finding(row()), row()),
            figures.force_trace(station(0, 0.032), FACE_M2),
        ]
    for figure in drawn:
        for axes in figure.axes:
            labels = [text for text in (axes.get_xlabel(), axes.get_ylabel()) if text]
            assert labels
            assert all(re.search(r"\[(mm|s|N|Pa|kPa)\]", label) for label in labels)


def test_a_run_without_a_complete_station_is_refused_with_what_to_do(tmp_path: Path) -> None:
    empty = Recording((), ("virtual.force",), (), FACE_M2)
    with pytest.raises(ValueError, match=r"palpate resume"):
        report(empty, started(), finding(empty), Path("a.run"), tmp_path)
