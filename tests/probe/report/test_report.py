"""The report is complete, self-contained, marked where simulated; an anonymous run names nobody."""

import errno
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from recordings import finding, grid, row, started

from drivers import Block, Channel
from probe.core.events import RunStarted, Samples, StationStarted
from probe.report.anonymous import anonymous
from probe.report.page import Picture, page
from probe.report.write import report, write_report
from probe.storage.writer import create_store
from sim_backend import Scene, load_scene
from sim_backend.models.press import CannotSolve


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


def test_the_section_is_that_of_the_row_which_was_pressed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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


def test_presses_in_steps_have_a_table_and_a_picture(tmp_path: Path) -> None:
    steps = [
        {"station": 8, "depth_mm": mm, "force_n": 0.4 * mm, "pulse_n": pulse_n, "pulse_sd_n": 1e-3}
        for mm, pulse_n in ((0.5, 0.01), (1.0, 0.02), (1.5, None))
    ]
    text = report(row(), started(), finding(row()) | {"steps": steps}, Path("a.run"), tmp_path)
    assert "<td>8</td><td>1.00</td><td>0.400</td><td>20.00</td><td>1.96</td>" in text.read_text()
    assert (tmp_path / "steps.svg").exists()


def test_a_certain_finding_is_not_called_certain() -> None:
    reported = {"simulated": [], "finish": "completed", **finding(row())}
    reported["objects"][0]["confidence"] = 1.0
    assert "99.9 %" in page("a run", reported, [], {}, {})


Reports = dict[str, Path]


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Reports:
    """An aborted row with a bounded pulse, and a grid with a vessel's course and an odd name."""
    config = started().config | {
        "labels": {"operator": "Ann <A>", "specimen": "gel 3"},
        "plan": {
            "stations": [[0, 4.0, 0.0]], "indentation_mm": 2.5, "ramp_s": 1.0, "hold_s": 0.825,
        },
        "rig": {"stage": {"driver": "ur"}, "sensor": [{"driver": "ft300"}]},
    }  # fmt: skip
    begun, aborted = replace(started(), config=config), replace(row(), finish="aborted")
    found: dict[str, dict[str, Any]] = {"row": finding(aborted), "grid": finding(grid())}
    found["row"]["stations"][2]["pulse_below_pa"] = 240.0
    found["grid"]["objects"][0]["course_mm"] = [[30.0, 0.0], [32.0, 16.0]]
    out = {name: tmp_path_factory.mktemp(name) for name in found}
    return {
        "row": report(aborted, begun, found["row"], Path("a.run"), out["row"]),
        "grid": report(grid(), started(), found["grid"], Path("<script>x.run"), out["grid"]),
    }


@pytest.mark.parametrize(("name", "title"), [("row", "Run a"), ("grid", "Run &lt;script&gt;x")])
def test_the_page_needs_nothing_else_and_the_figures_lie_beside_it(
    name: str, title: str, reports: Reports
) -> None:
    text = reports[name].read_text(encoding="utf-8")
    assert "Finding: artery" in text
    assert "31.40 to 32.60" in text
    assert f"<h1>{title}, 2026-01-01 00:00 UTC</h1>" in text
    assert "<script>" not in text
    assert not re.search(r"(?:src|href)=['\"]https?:", text)
    assert "prefers-color-scheme: dark" in text
    assert text.count("<svg") == 3
    for figure in ("tactile_map", "pulse_map", "force"):
        for ending in ("png", "svg", "pdf"):
            assert reports[name].with_name(f"{figure}.{ending}").stat().st_size > 1000


def test_a_row_s_page_says_what_is_simulated_aborted_and_not_seen(reports: Reports) -> None:
    text = reports["row"].read_text(encoding="utf-8")
    assert "SIMULATED: virtual.force" in text
    assert "This run was aborted" in text
    assert "&lt;&nbsp;240.0" in text  # in one line, on a phone too
    whole = reports["grid"].read_text(encoding="utf-8")
    assert "SIMULATED: " not in whole
    assert "aborted" not in whole


def test_the_top_says_who_scanned_what_and_how(reports: Reports) -> None:
    text = reports["row"].read_text(encoding="utf-8")
    top = re.sub(r"<[^>]+>", "", text.split("class='about'>")[1].split("</p>")[0])
    assert top == (
        "operator Ann &lt;A&gt; &middot; specimen gel 3 &middot; stations 1 &middot; depth 2.5 mm "
        "&middot; ramp 1 s &middot; hold 0.825 s &middot; rig ur + ft300"
    )
    assert text.index("class='about'") < text.index("Finding:")


def test_a_grids_objects_leave_their_columns_to_a_phone(reports: Reports) -> None:
    text = reports["grid"].read_text(encoding="utf-8")
    assert "<p>artery: seen from x, y = 30.0, 0.0 to 32.0, 16.0 mm</p>" in text
    assert "<td>seen" not in text


@pytest.mark.parametrize("wrote", [".png", ".html"])
def test_a_full_disk_is_said_of_the_file_that_it_does_not_take(
    wrote: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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


@pytest.mark.parametrize("samples", [True, False])
def test_of_a_run_without_a_complete_station_the_samples_are_shown(
    samples: bool, tmp_path: Path
) -> None:
    run, time_s = tmp_path / "a.run", 0.01 * np.arange(50)
    block = Block(time_s, time_s[:, None], np.zeros((50, 1), bool))
    channels = {"cell": (Channel("force", "N", "force"),)}
    with create_store(run) as store:
        store(RunStarted(0.0, "2026-01-01T00:00:00+00:00", {"face_mm2": 100.0}, channels))
        store(StationStarted(0.0, 0, 1, 0.0, 0.0))
        if samples:
            store(Samples("cell", block, 0, 1))
    text = write_report(run, tmp_path / "out").read_text()
    assert "No station is complete, so nothing is judged; `palpate resume`" in text
    assert ("of all that was recorded" in text) == samples
    assert ("There is no sample in it." in text) == (not samples)


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


def test_an_anonymous_run_names_no_file_of_its_user() -> None:
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
