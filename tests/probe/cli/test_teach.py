"""``palpate teach``: three points, by numbers or from the robot, and the keys in the rig file."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drivers import Pose
from drivers.ur.stage import UrStage

pytest.importorskip(
    "rtde_control", reason="UR rigs are not tested: ur-rtde has no wheel for this Python"
)

RIG = """\
face_mm2 = 100
[stage]
driver = "ur"
host = "127.0.0.9"  # nobody is there
[[sensor]]
driver = "ur"
host = "127.0.0.9"
"""
TURN = Rotation.from_euler("xyz", (90.0, 0.0, 20.0), degrees=True)  # on a wall
PLACES = TURN.apply([[0, 0, 0], [0.06, 0, 0], [0.01, 0.04, 0]]) + np.array([0.4, 0.1, 0.3])
HELD = (TURN * Rotation.from_rotvec([0.0, 3.14159265, 0.0])).as_rotvec()


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "wall.toml"
    path.write_text(RIG)
    return path


@pytest.fixture
def guided(monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot that is guided from point to point, and only read."""
    left = iter(PLACES)
    monkeypatch.setattr(UrStage, "connect", lambda _stage: None)
    monkeypatch.setattr(UrStage, "base_pose", lambda _stage: Pose(*next(left), *HELD))


def typed(monkeypatch: pytest.MonkeyPatch, *lines: str) -> None:
    left = iter(lines)
    monkeypatch.setattr("builtins.input", lambda: next(left))


@pytest.mark.usefixtures("guided")
def test_enter_takes_the_robot_s_pose_and_the_file_gets_the_keys(
    palpate: Any, rig: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    typed(monkeypatch, "", "", "")
    done = palpate("teach", str(rig), "--write", status=0)
    assert "Point 2: a point along x" in done.err
    assert "tool stood 0.0 degrees" in done.err
    stage = tomllib.loads(rig.read_text())["stage"]
    assert stage["origin_mm"] == [400.0, 100.0, 300.0]
    mounted = [stage[f"{one}_deg"] for one in ("roll", "pitch", "yaw")]
    assert mounted == pytest.approx([90.0, 0.0, 20.0], abs=1e-3)
    axis = Rotation.from_rotvec(stage["tool_rotvec_rad"]).apply([0.0, 0.0, 1.0])
    assert axis == pytest.approx([0.0, 0.0, -1.0], abs=1e-5)
    assert "# nobody is there" in rig.read_text()


def test_numbers_need_no_robot_and_are_printed(
    palpate: Any, rig: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    typed(monkeypatch, "400 100 300", "here", "460, 100, 300", "400, 150, 300")
    done = palpate("teach", str(rig), "--json", status=0)
    assert "three numbers in mm" in done.err
    assert done.json["stage"] == {
        "origin_mm": [400.0, 100.0, 300.0], "roll_deg": 0.0, "pitch_deg": 0.0, "yaw_deg": 0.0,
    }  # fmt: skip
    assert rig.read_text() == RIG


@pytest.mark.parametrize("given, said", [
    (["--point", "1,2,3"], "a frame needs three"),
    (["--point", "1,2,3", "--point", "1,2,nan", "--point", "1,2,3"], "an arm reaches"),
    (["--point", "1,2,3", "--point", "1,2,1e300", "--point", "1,2,3"], "up to 3000 mm"),
    (["--point", "1,2,3", "--point", "2,2,3", "--point", "1,30,3"], "1.0 mm apart"),
])  # fmt: skip
def test_bad_points_are_named(palpate: Any, rig: Path, given: list[str], said: str) -> None:
    done = palpate("teach", str(rig), *given, "--write", status=2)
    assert said in done.err
    assert rig.read_text() == RIG


def test_a_stage_without_an_arm_says_what_to_do_instead(palpate: Any, tmp_path: Path) -> None:
    path = tmp_path / "axes.toml"
    path.write_text(RIG.replace('"ur"', '"virtual"').replace("host", "#"))
    done = palpate("teach", str(path), "--point", "1,2,3", "--point", "2,2,3", "--point", "1,3,3")
    assert done.status == 2
    assert "origin_mm" in done.err
