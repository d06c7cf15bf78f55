"""A grid's stations are told apart by x and y wherever one is named, in the row y = 0 too."""

import re
from pathlib import Path
from typing import Any

import pytest

GRID = """
[stage]
driver = "virtual"
[[sensor]]
driver = "virtual"
[scan]
start_mm = [26.0, 0.0]
pitch_mm = [4.0, 1.5]
stations = [3, 2]
[safety]
max_force_n = 5.0
max_speed_mm_s = 25.0
workspace_mm = { x = [-5.0, 70.0], y = [-5.0, 5.0], z = [-4.5, 50.0] }
[scene]
name = "TI"
"""
PLACES = [(26.0, 0.0), (30.0, 0.0), (34.0, 0.0), (34.0, 1.5), (30.0, 1.5), (26.0, 1.5)]


def named_places(text: str) -> list[tuple[float, float]]:
    found = re.findall(r"station \d.*x = ([\d.]+) mm, y = ([\d.]+) mm", text)
    return [(float(x), float(y)) for x, y in found]


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "grid.toml"
    path.write_text(GRID, encoding="utf-8")
    return path


@pytest.mark.usefixtures("springs")
def test_progress_and_replay_name_both_axes_at_every_station(
    palpate: Any, rig: Path, tmp_path: Path
) -> None:
    scanned = palpate("scan", rig, "--out", tmp_path, "--json")
    assert named_places(scanned.err) == PLACES
    assert named_places(palpate("replay", scanned.json["run"]).out) == PLACES


@pytest.mark.usefixtures("springs")
def test_a_row_has_no_y(palpate: Any, tmp_path: Path) -> None:
    scanned = palpate("scan", "--scene", "TI", "--out", tmp_path, "--json")
    assert "x = 60.0 mm" in scanned.err
    assert "y = " not in scanned.err


@pytest.mark.usefixtures("springs")
def test_a_plan_says_how_far_it_reaches_in_x_and_y(palpate: Any, rig: Path) -> None:
    """To and fro, the last station of a grid may lie where the first does."""
    assert "6 stations, x = 26 to 34 mm, y = 0 to 1.5 mm;" in palpate("plan", rig).out
    assert "15 stations, x = 4 to 60 mm;" in palpate("plan", "--scene", "TI").out
    assert palpate("plan", "--scene", "HAOT").out.startswith("1 station, x = 32 mm;")
