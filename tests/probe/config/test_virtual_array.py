"""A rig whose simulated sensor is an array."""

from pathlib import Path

import pytest
from rig_files import rig_file

from drivers import SimulatedClock
from palpate import connect
from probe.config.load_rig import load_rig
from probe.config.rig import RigError
from probe.config.snapshot import face_mm2_of
from sim_backend.phantom.phantom import Respond
from sim_backend.scene.scene_file import load_scene

ARRAY = "[sensor.array]\nrows = 2\ncolumns = 3\n"


def rig_with(folder: Path, keys: str) -> Path:
    path = rig_file(folder)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("[scan]\n", f"{ARRAY}{keys}[scan]\n"), encoding="utf-8")
    return path


def test_a_rig_names_its_array_and_the_face_is_that_of_its_taxels(
    tmp_path: Path, winkler: Respond
) -> None:
    scene = load_scene("TI")
    whole = load_rig(rig_with(tmp_path, ""))
    assert face_mm2_of(whole, scene) == scene.face_mm2
    rig = load_rig(rig_with(tmp_path, "pitch_mm = 1.5\n"))
    assert face_mm2_of(rig, scene) == pytest.approx(6 * 1.5**2)
    with connect(rig, SimulatedClock(), respond=winkler) as devices:
        (sensor,) = devices.sensors
        assert sensor.name == "taxels"
        assert [c.name for c in sensor.channels] == [
            "r0c0", "r0c1", "r0c2", "r1c0", "r1c1", "r1c2",
        ]  # fmt: skip


def test_what_is_wrong_in_an_array_is_named(tmp_path: Path, winkler: Respond) -> None:
    for keys, words in (
        ("gain_spread_pct = -1\n", r"sensor\[0\]\.array\.gain_spread_pct"),
        ("dead = [[2, 0]]\n", r"sensor\[0\]\.array.*dead = \[2, 0\]: rows are 0 to 1"),
        ("hysteresis_pct = 1\n", r"sensor\[0\]\.array\.hysteresis_pct"),
    ):
        rig = load_rig(rig_with(tmp_path, keys))
        with pytest.raises(RigError, match=words):
            connect(rig, SimulatedClock(), respond=winkler)
