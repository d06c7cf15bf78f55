"""The main job on the paper's six scenes, finite elements included: what is found, and where."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from programs import ended

from probe.detection import detect
from probe.storage.csv_import import import_csv
from probe.storage.export import export

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("six-scenes")


@cache
def scanned(scene: str, folder: Path) -> dict[str, Any]:
    """What ``palpate scan --json`` says; scanned once."""
    done = ended("scan", "--scene", scene, "--seed", "1", "--out", folder, "--json", status=0)
    reported: dict[str, Any] = json.loads(done.stdout)
    return reported


@pytest.mark.parametrize("scene, finding", [
    ("TI", "nothing"), ("TIT", "tumour"), ("TIHA", "artery"), ("TISA", "stenotic artery"),
])  # fmt: skip
def test_finding_and_place(scene: str, finding: str, folder: Path) -> None:
    reported = scanned(scene, folder)
    assert reported["finding"] == finding
    assert reported["finish"] == "completed"
    assert len(reported["stations"]) == 15
    if finding == "nothing":
        assert reported["objects"] == []
        return
    (found,) = reported["objects"]
    assert found["kind"] == finding
    assert found["position_mm"] == pytest.approx(32, abs=0.5)
    low, high = found["position_ci_mm"]
    assert low < found["position_mm"] < high


def test_the_stenotic_pulse_is_much_weaker(folder: Path) -> None:
    """By the paper 22.6 Pa at 32 mm; ours between 5 and 45, a quarter of the healthy one's."""
    healthy, stenotic = (
        next(s["pulse_pa"] for s in scanned(scene, folder)["stations"] if abs(s["x_mm"] - 32) < 1)
        for scene in ("TIHA", "TISA")
    )
    assert 5 <= stenotic <= 45
    assert healthy >= 4 * stenotic


def test_of_two_lone_arteries_the_stenotic_one_is_named(folder: Path) -> None:
    runs = [scanned(scene, folder)["run"] for scene in ("HAOT", "SAOT")]
    done = ended("compare", *runs, "--json", status=0)
    compared = json.loads(done.stdout)
    assert compared["diseased"] == "B"
    assert compared["confidence"] > 0.9


@pytest.mark.parametrize("form", ["csv", "mcap"])
def test_a_lone_artery_is_called_the_same_once_it_was_elsewhere(form: str, folder: Path) -> None:
    """Without the depth of its press any would be a healthy one."""
    reported = scanned("SAOT", folder)
    files = export(reported["run"], form, folder / form)
    (file,) = (f for f in files if len(files) == 1 or "-force-" in f.name)
    back = import_csv(file, folder / f"{form}.run", face_mm2=100.0)
    (found,), (then,) = detect(back.path).as_json()["objects"], reported["objects"]
    assert found["kind"] == then["kind"] == "stenotic artery"
    assert found["confidence"] == pytest.approx(then["confidence"], abs=1e-3)
