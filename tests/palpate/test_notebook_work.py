"""What a person does in a notebook: own scenes, own samples, an interrupted cell, a wrong type."""

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from known_presses import recording, row

import palpate
from probe.core.events import RunEnded, StationEnded

ROW = palpate.Rig.model_validate({"scan": {"start_mm": 24.0, "stations": 3}})


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, winkler: Any) -> palpate.Run:
    done = palpate.scan(ROW, "TIHA", tmp_path_factory.mktemp("runs"), respond=winkler)
    return palpate.open_run(done)


def test_a_scene_made_in_python_is_scanned_and_resumed(tmp_path: Path, winkler: Any) -> None:
    scene = palpate.load_scene("TIHA")
    tissue = scene.tissue
    assert tissue is not None
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
    assert isinstance(last, RunEnded)
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
    a_list: Any = [1, 2]
    scene: Any = palpate.load_scene("TIHA")
    name: Any = "rig.toml"
    with pytest.raises(TypeError, match=r"a Rig or the name of a rig file is needed.*type list"):
        palpate.scan(a_list)
    with pytest.raises(TypeError, match=r"a Rig or the name of a rig file is needed.*type Scene"):
        palpate.scan(scene)
    with pytest.raises(palpate.RigError, match="TIHA is a scene: say scene='TIHA'"):
        palpate.scan("TIHA")
    with pytest.raises(TypeError, match="a Scene, the name of a built-in one or of a scene file"):
        palpate.press(a_list, 32, 1)
    with pytest.raises(palpate.SceneError, match="x_mm = '32': must be a number"):
        palpate.press("TIHA", "32", 1)  # type: ignore[arg-type]
    for takes_a_run in (palpate.detect, palpate.verify, palpate.resume, palpate.open_run):
        with pytest.raises(TypeError, match=r"a run or the name of its file is needed.*type list"):
            takes_a_run(a_list)  # type: ignore[operator]
    with pytest.raises(TypeError, match=r"a Rig is needed; palpate\.load_rig"):
        palpate.plan_for(name)
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
    """In place of being passed over, or of an error from deep inside."""
    three: Any = 3
    nothing: Any = None
    for face_mm2 in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(palpate.RunFileError, match=r": face_mm2 = .*: must be above 0"):
            run.recording(face_mm2=face_mm2)
    with pytest.raises(TypeError, match=r"samples: what Run\.samples gives is needed.*type int"):
        run.recording(samples=three)
    for asked_pa in (0.0, np.inf, np.nan):
        with pytest.raises(ValueError, match=r"asked_pa is .*more than 0 and finite"):
            palpate.detect(run, asked_pa=asked_pa)
    for formats in (nothing, three, [nothing], "doc"):
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
