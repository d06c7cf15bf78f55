"""Scene files of a user's own, with a wave file beside them."""

from pathlib import Path

import numpy as np
import pytest
from own_scene import OWN_SCENE

from sim_backend.scene.scene_file import load_scene
from sim_backend.scene.waves import PA_PER_MMHG, load_wave

SCENE = f'{OWN_SCENE}[pulse]\nwave = "wave.csv"\n'
WAVE = "time_s,pressure_mmhg\n0,70\n0.2,130\n0.5,90\n0.8,70\n"


@pytest.mark.usefixtures("springs")
def test_a_wave_file_lies_beside_its_scene(
    palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "files").mkdir()
    scene = tmp_path / "files" / "mine.toml"
    scene.write_text(SCENE)
    (tmp_path / "files" / "wave.csv").write_text(WAVE)
    monkeypatch.chdir(tmp_path)
    for more in (["--dry-run"], []):
        palpate("scan", "--scene", "files/mine.toml", *more, "--out", "runs", status=0)


def test_the_wave_of_a_loaded_scene_can_be_read_from_anywhere(tmp_path: Path) -> None:
    scene = tmp_path / "mine.toml"
    scene.write_text(SCENE)
    (tmp_path / "wave.csv").write_text(WAVE)
    wave = load_wave(load_scene(scene).pulse)
    phase = np.linspace(0, 1, 81)
    pressure = wave.pressure_pa(phase * wave.period_s)
    assert pressure.max() == pytest.approx(120 * PA_PER_MMHG, rel=0.01)
    assert phase[pressure.argmax()] == pytest.approx(0.2 / 0.8)


def test_scenes_prints_a_file_to_start_from(palpate, tmp_path: Path) -> None:
    printed = palpate("scenes", "TISA", status=0)
    scene = tmp_path / "mine.toml"
    scene.write_text(printed.out)
    assert load_scene(scene) == load_scene("TISA")


def test_scenes_lists_all(palpate) -> None:
    listed = palpate("scenes", "--json").json["scenes"]
    plane = ["HAOT", "SAOT", "TI", "TIHA", "TISA", "TIT"]
    assert sorted(listed) == sorted([*plane, *(f"{name}-solid" for name in plane[2:])])
    assert "stenosis" in listed["TISA"]


@pytest.mark.parametrize("option", ["--deck", "--feb"])
def test_a_solid_that_cannot_be_written_is_refused_before_it_is_solved(
    palpate, monkeypatch: pytest.MonkeyPatch, option: str
) -> None:
    monkeypatch.setattr("sim_backend.models.press.press", None)
    outcome = palpate("press", "TI-solid", "--x", "32", "--depth", "1", option, "file")
    assert (outcome.status, "write plane sections only" in outcome.err) == (2, True)


@pytest.mark.parametrize(
    ("option", "written"), [("--deck", "file"), ("--feb", "file"), ("--vtu", "file-1")]
)
def test_a_press_replaces_its_own_files_and_no_other(
    palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, option: str, written: str
) -> None:
    path = tmp_path / written
    press = ("press", "TIHA", "--x", "32", "--depth", "0.5", "--accuracy", "9", option)
    for _ in range(2):
        assert palpate(*press, tmp_path / "file").status == 0
    assert path.stat().st_size > 1000
    monkeypatch.setattr("sim_backend.models.press.press", None)
    for foreign in ("my notes", "<?xml version='1.0'?>\n<svg>", "** of another program\n*NODE\n"):
        path.write_text(foreign)
        outcome = palpate(*press, tmp_path / "file")
        assert (outcome.status, "exists already" in outcome.err) == (2, True)
        assert path.read_text() == foreign
    assert palpate(*press, tmp_path).status == 2  # a folder


def test_an_unknown_key_leads_to_what_is_not_modelled(palpate, tmp_path: Path) -> None:
    file = tmp_path / "layers.toml"
    file.write_text('name = "a"\n[tissue]\nlayers = 2\n')
    outcome = palpate("press", str(file), "--x", "1", "--depth", "1", status=2)
    page = outcome.err.rsplit("(", 1)[1].split(",")[0]
    root = Path(__file__).parents[3]
    assert "\n## What is not modelled\n" in (root / page).read_text()


def test_a_twin_is_a_scene_file_that_overwrites_none(palpate, tmp_path: Path) -> None:
    palpate("scan", "--scene", "TIT", "--seed", "1", "--out", tmp_path, status=0)
    run, twin = next(tmp_path.glob("*.run")), tmp_path / "twin.toml"
    assert "tumour" in palpate("twin", run, "--out", twin, status=0).out
    (lump,) = load_scene(twin).inclusion
    assert lump.kind == "tumour" and lump.x_mm == pytest.approx(32, abs=0.5)
    assert "exists already" in palpate("twin", run, "--out", twin, status=2).err
