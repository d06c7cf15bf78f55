"""A grid's stations are told apart by x and y wherever one is named, in the row y = 0 too."""

import re
from pathlib import Path
from typing import Any

import pytest
from rig_files import rig_file

pytestmark = pytest.mark.usefixtures("springs")
PLACES = [(26.0, 0.0), (30.0, 0.0), (34.0, 0.0), (34.0, 1.5), (30.0, 1.5), (26.0, 1.5)]


def named_places(text: str) -> list[tuple[float, float]]:
    found = re.findall(r"station \d.*x = ([\d.]+) mm, y = ([\d.]+) mm", text)
    return [(float(x), float(y)) for x, y in found]


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    return rig_file(
        tmp_path, start_mm=[26.0, 0.0], pitch_mm=[4.0, 1.5], stations=[3, 2],
        more="[safety]\nworkspace_mm = { x = [-5.0, 70.0], y = [-5.0, 5.0], z = [-4.5, 50.0] }\n",
    )  # fmt: skip


def test_progress_and_replay_name_both_axes_at_every_station(
    palpate: Any, rig: Path, tmp_path: Path
) -> None:
    scanned = palpate("scan", rig, "--out", tmp_path)
    assert named_places(scanned.err) == PLACES
    assert "station x mm y mm baseline Pa ± 95 % pulse Pa" in " ".join(scanned.out.split())
    (run,) = tmp_path.glob("*.run")
    assert named_places(palpate("replay", run).out) == PLACES
    reported = palpate("detect", run, "--json").json["stations"]
    assert [one["y_mm"] for one in reported] == pytest.approx([0, 0, 0, 1.5, 1.5, 1.5])
    assert all(one["baseline_sd_pa"] > 0 for one in reported)


def test_a_row_has_no_y(palpate: Any, tmp_path: Path) -> None:
    scanned = palpate("scan", "--scene", "TI", "--out", tmp_path, "--json")
    assert "x = 60.0 mm" in scanned.err
    assert "y = " not in scanned.err


def test_a_plan_says_how_far_it_reaches_in_x_and_y(palpate: Any, rig: Path) -> None:
    """To and fro, the last station of a grid may lie where the first does."""
    assert "6 stations, x = 26 to 34 mm, y = 0 to 1.5 mm;" in palpate("plan", rig).out
    assert "15 stations, x = 4 to 60 mm;" in palpate("plan", "--scene", "TI").out
    assert palpate("plan", "--scene", "HAOT").out.startswith("1 station, x = 32 mm;")
