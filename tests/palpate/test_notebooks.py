"""What a person does in a notebook, and the HTML in which it shows results."""

import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from known_presses import recording, row

import palpate
from palpate import ScanResult
from probe.core.events import RunEnded, StationEnded
from sim_backend import html
from sim_backend.phantom.phantom import Respond


class Cells(HTMLParser):
    """The text of all table cells."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.inside = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: ARG002
        self.inside = tag == "td"

    def handle_data(self, data: str) -> None:
        if self.inside:
            self.found.append(data)
            self.inside = False


def svg_of(text: str) -> ElementTree.Element:
    return ElementTree.fromstring(text[text.index("<svg") : text.rindex("</svg>") + 6])


def test_a_scene_is_drawn_to_scale() -> None:
    shown = palpate.load_scene("TIHA")._repr_html_()
    block = svg_of(shown).find("{*}rect")
    circle = svg_of(shown).find("{*}circle")
    scale = float(block.attrib["width"]) / 64
    assert float(block.attrib["height"]) == pytest.approx(16.83 * scale, rel=1e-2)
    assert (float(circle.attrib["cx"]) - float(block.attrib["x"])) / scale == pytest.approx(
        32, abs=0.1
    )


def test_a_press_shows_each_state() -> None:
    pressed = palpate.press("TIHA", 32.0, 2.5, (80.0, 120.0), accuracy_pct=5)
    cells = Cells(pressed._repr_html_()).found
    assert not any("e+" in cell for cell in cells), "numbers in words have no exponents"
    assert cells[0] == "80"
    assert f"{pressed.states[1].force_n:.5g}" in cells
    assert len(repr(pressed)) < 200


@pytest.fixture(scope="module")
def scanned(
    winkler: Respond, tmp_path_factory: pytest.TempPathFactory
) -> tuple[ScanResult, palpate.Finding]:
    result = palpate.scan(
        scene="TIHA", out=tmp_path_factory.mktemp("runs"), seed=1, respond=winkler
    )
    return result, palpate.detect(result.path)


def test_a_run_and_its_finding_show_their_stations(
    scanned: tuple[ScanResult, palpate.Finding],
) -> None:
    result, finding = scanned
    shown = palpate.open_run(result.path)._repr_html_()
    assert "15 complete" in Cells(shown).found
    assert len(svg_of(shown).findall("{*}circle")) == 15
    x_mm = [1e3 * one.x_m for one in palpate.open_run(result.path).recording().stations]
    assert {f"{x_mm[0]:g}", f"{x_mm[-1]:g}"} <= {
        text.text for text in svg_of(shown).findall("{*}text")
    }
    assert finding.finding in finding._repr_html_()
    assert str(result.path) in Cells(result._repr_html_()).found


def test_results_print_as_the_terminal_shows_them(
    scanned: tuple[ScanResult, palpate.Finding],
) -> None:
    result, finding = scanned
    first, *objects = str(finding).splitlines()
    assert first == f"Finding: {finding.finding}"
    assert f"x = {finding.objects[0].position_mm:.2f} mm" in objects[0]
    assert "confidence" in objects[0]
    recording = palpate.open_run(result.path).recording()
    assert len(repr(recording)) < 150
    assert repr(result) == f"ScanResult({result.path}, completed: every station is complete)"


def test_a_cell_that_scans_shows_how_far_it_is(
    winkler: Respond,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rig = palpate.Rig.model_validate({"scan": {"start_mm": 28.0, "stations": 3}})
    palpate.scan(rig, "TIHA", tmp_path, respond=winkler)
    assert not capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "ipykernel", ModuleType("ipykernel"))
    palpate.scan(rig, "TIHA", tmp_path, respond=winkler)
    shown = [line.rstrip() for line in capsys.readouterr().err.split("\r")]
    assert shown[1].startswith("station 1 of 3, x = 28.0 mm")
    assert shown[-1] == "3 of 3 stations: completed"


def test_what_others_wrote_is_escaped() -> None:
    assert "<script>" not in html.table([("<script>", "x")], ("<script>",))


def test_curves_without_a_number_are_no_picture() -> None:
    assert html.lines([1.0, 2.0], {"a": [float("nan")] * 2}, "x", "y") == ""
    assert svg_of(html.lines([1.0], {"a": [2.0]}, "x", "y")) is not None


ROW = palpate.Rig.model_validate({"scan": {"start_mm": 24.0, "stations": 3}})


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, winkler: Any) -> palpate.Run:
    done = palpate.scan(ROW, "TIHA", tmp_path_factory.mktemp("runs"), respond=winkler)
    return palpate.open_run(done)


def test_a_scene_made_in_python_is_scanned_and_resumed(tmp_path: Path, winkler: Any) -> None:
    scene = palpate.load_scene("TIHA")
    tissue = scene.tissue
    softer = tissue.model_copy(update={"modulus_kpa": 30.0})
    mine = scene.model_copy(update={"name": "mine", "tissue": softer})

    def after_one(event: Any) -> None:
        if isinstance(event, StationEnded):
            control.abort()

    control = palpate.Control()
    begun = palpate.scan(
        ROW, mine, tmp_path, control=control, observers=[after_one], respond=winkler
    )
    assert begun.ended.finish.value == "aborted"
    assert f"palpate.resume({str(begun.path)!r})" in begun._repr_html_().replace("&#x27;", "'")
    done = palpate.resume(begun, respond=winkler)
    stored = palpate.open_run(done).config
    assert stored["scene"] == mine.model_dump(mode="json")
    assert stored["rig"]["scene"]["name"] == "mine"
    assert done.path.name.startswith("mine-")


def test_ones_own_samples_are_judged_in_place_of_the_stored(run: palpate.Run) -> None:
    stored, mine = run.recording(), run.samples()
    for changed in (mine, mine.to_dataframe()):
        same = run.recording(samples=changed)
        for one, other in zip(stored.stations, same.stations, strict=True):
            assert np.array_equal(one.signal_pa, other.signal_pa)
            assert np.array_equal(one.depth_m, other.depth_m, equal_nan=True)
    mine["force"] *= 2.0
    without = mine.where(mine["station"] != 2, drop=True)
    twice = run.recording(samples=without).stations
    assert [one.index for one in twice] == [0, 2], "a press with no row left is left out"
    assert np.allclose(twice[0].signal_pa, 2 * stored.stations[0].signal_pa)
    with pytest.raises(palpate.RunFileError, match="samples of 'force': no station"):
        run.recording(samples=mine.drop_vars("station"))
    with pytest.raises(palpate.RunFileError, match="time_s must ascend"):
        run.recording(samples=mine.isel(time_s=slice(None, None, -1)))


def test_an_interrupted_cell_is_an_aborted_scan_and_says_how_to_go_on(
    tmp_path: Path, winkler: Any
) -> None:
    def interrupt(event: Any) -> None:
        if isinstance(event, StationEnded):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match=r"palpate\.resume\('.*\.run'\) goes on"):
        palpate.scan(ROW, "TIHA", tmp_path, observers=[interrupt], respond=winkler)
    (path,) = tmp_path.glob("*.run")
    *_, last = palpate.open_run(path).events()
    assert (last.finish.value, last.reason) == ("aborted", "aborted by the user")
    assert palpate.resume(path, respond=winkler).ended.finish.value == "completed"


def test_what_an_observer_raises_is_in_the_results_notes(
    tmp_path: Path, winkler: Any, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(event: Any) -> None:
        if isinstance(event, StationEnded | RunEnded):
            raise OSError(type(event).__name__)

    done = palpate.scan(ROW, "TIHA", tmp_path, observers=[broken], respond=winkler)
    assert done.notes == ("observer: OSError: StationEnded",)

    def late(event: Any) -> None:
        if isinstance(event, RunEnded):
            raise OSError("late")

    done = palpate.scan(ROW, "TIHA", tmp_path, observers=[late], respond=winkler)
    assert "observer: OSError: late" in caplog.messages
    assert palpate.verify(done).ok, "nothing is stored after the run's end"


def test_a_value_of_a_wrong_type_is_refused_in_words(tmp_path: Path) -> None:
    a_list = [1, 2]
    with pytest.raises(TypeError, match=r"a Rig or the name of a rig file is needed.*type list"):
        palpate.scan(a_list)
    with pytest.raises(TypeError, match=r"a Rig or the name of a rig file is needed.*type Scene"):
        palpate.scan(palpate.load_scene("TIHA"))
    with pytest.raises(palpate.RigError, match="TIHA is a scene: say scene='TIHA'"):
        palpate.scan("TIHA")
    with pytest.raises(TypeError, match="a Scene, the name of a built-in one or of a scene file"):
        palpate.press(a_list, 32, 1)
    with pytest.raises(palpate.SceneError, match="x_mm = '32': must be a number"):
        palpate.press("TIHA", "32", 1)
    for takes_a_run in (palpate.detect, palpate.verify, palpate.resume, palpate.open_run):
        with pytest.raises(TypeError, match=r"a run or the name of its file is needed.*type list"):
            takes_a_run(a_list)
    with pytest.raises(TypeError, match=r"a Rig is needed; palpate\.load_rig"):
        palpate.plan_for("rig.toml")
    with pytest.raises(palpate.ConfigError, match="keys with values are needed"):
        palpate.sweep("TIHA", a_list, out=tmp_path / "t.csv")


def test_a_face_or_a_place_in_other_units_is_refused() -> None:
    good = recording(row(np.random.default_rng(2), bump=0.15, pulse_pa=400.0))
    for face_m2 in (-1e-4, 0.0, 100.0):
        with pytest.raises(ValueError, match=r"face_m2 = .*in m2 is needed"):
            replace(good, face_m2=face_m2)
    far = tuple(replace(s, x_m=1e3 * s.x_m) for s in good.stations)
    with pytest.raises(ValueError, match="are they millimetres"):
        replace(good, stations=far)
    assert np.isnan(replace(good, face_m2=np.nan).face_m2)


def test_a_value_that_says_nothing_is_refused(run: palpate.Run, tmp_path: Path) -> None:
    for face_mm2 in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(palpate.RunFileError, match=r": face_mm2 = .*: must be above 0"):
            run.recording(face_mm2=face_mm2)
    with pytest.raises(TypeError, match=r"samples: what Run\.samples gives is needed.*type int"):
        run.recording(samples=3)
    for asked_pa in (0.0, np.inf, np.nan):
        with pytest.raises(ValueError, match=r"asked_pa is .*more than 0 and finite"):
            palpate.detect(run, asked_pa=asked_pa)
    for formats in (None, 3, [None], "doc"):
        with pytest.raises(ValueError, match=r"format '(None|3|doc)': known are csv, hdf5"):
            palpate.export(run, formats, tmp_path)
    with pytest.raises(palpate.RunFileError, match=r"'a\\x00b': no such run file; .*zero byte"):
        palpate.open_run("a\0b")


def test_a_grids_finding_is_shown_as_maps() -> None:
    def shown(*places_m: tuple[float, float]) -> str:
        stations = tuple(
            palpate.StationFinding(n, x, y, 0.0, baseline_pa=9e3 + n, pulse_pa=10.0 * n)
            for n, (x, y) in enumerate(places_m, start=1)
        )
        return palpate.Finding("nothing", (), stations, "", 0.01)._repr_html_()

    grid = shown((0.0, 0.0), (0.004, 0.0), (0.004, 0.002), (0.0, 0.002))
    assert grid.count("<rect") == 2 * 4
    assert "<title>x 4 mm, y 2 mm: 30</title>" in grid
    row_only = shown((0.0, 0.0), (0.004, 0.0))
    assert "<rect" not in row_only
    assert row_only.count("<polyline") == 2


def test_long_solves_say_how_far_they_are_in_a_notebook(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def solve() -> list[str]:
        palpate.press("TI", 32, 0.5, accuracy_pct=20)
        table = tmp_path / f"{len(list(tmp_path.iterdir()))}.csv"  # a new sweep each time
        palpate.sweep(
            "TI", {"modulus_kpa": [40.0, 50.0]}, out=table,
            x_mm=[32.0], indentation_mm=0.5, model="small", accuracy_pct=20, workers=1,
        )  # fmt: skip
        return [line.strip() for line in capsys.readouterr().err.split("\r")]

    assert solve() == [""]
    monkeypatch.setitem(sys.modules, "ipykernel", ModuleType("ipykernel"))
    shown = solve()
    assert any(line.startswith("solving ") for line in shown)
    assert "2 of 2 points" in shown
    assert shown[-1] == ""
