"""What is said before a scan of the press itself: its force, and what no answer is known of."""

from pathlib import Path
from typing import Any

import pytest

from probe.checks.dry_run import dry_run
from probe.checks.preflight import Check
from probe.config.rig import Rig, default_rig
from probe.scan.session import scan
from sim_backend.fem.newton import CannotSolve
from sim_backend.scene.scene_file import load_scene


def said(rig: Rig, scene: str, out: Path, respond: Any, name: str) -> Check:
    checks = dry_run(rig, load_scene(scene), out, respond).checks
    (check,) = (one for one in checks if one.name == name)
    return check


@pytest.mark.parametrize("scene, most_n, level, finish", [
    ("TIHA", 5.0, "ok", "completed"),
    ("TIHA", 1.4, "warning", "completed"),
    ("TIHA", 1.1, "fault", "faulted"),
    ("TIT", 1.1, "fault", "faulted"),
    ("TI", 1.1, "warning", "completed"),
])  # fmt: skip
def test_a_press_that_the_force_limit_would_end_is_said(
    scene: str, most_n: float, level: str, finish: str, tmp_path: Path, winkler: Any
) -> None:
    """Springs: 1.0 N in plain tissue, 1.2 N over an inclusion and up to 1.23 N over an artery."""
    keys = {"scene": {"name": scene}, "safety": {"max_force_n": most_n},
            "scan": {"start_mm": 32.0, "stations": 1}}  # fmt: skip
    rig = Rig.model_validate(keys)
    check = said(rig, scene, tmp_path, winkler, "force")
    assert check.level == level
    assert f"deep at x = 32 mm in scene {scene}" in check.text
    assert ("press less deep" in check.text) == (level != "ok")
    assert scan(rig, out=tmp_path, respond=winkler).ended.finish == finish


@pytest.mark.parametrize("keys", [
    {"scene": {"name": "TIHA", "surface_mm": -1.0}},
    {"stage": {"driver": "virtual", "stiffness_n_mm": 2.0}},
    {"sensor": [{"driver": "virtual", "gain": 0.5}]},
    {"sensor": [{"driver": "lines", "port": "x"}]},
])  # fmt: skip
def test_a_force_that_may_not_be_measured_as_solved_is_a_warning(
    keys: dict[str, Any], tmp_path: Path, winkler: Any
) -> None:
    rig = Rig.model_validate({"safety": {"max_force_n": 1.1}} | keys)
    assert said(rig, "TIHA", tmp_path, winkler, "force").level == "warning"


def test_a_press_without_an_answer_is_said_in_words(tmp_path: Path) -> None:
    def none(_scene: Any, _x_m: float, _depth_m: float) -> Any:
        raise CannotSolve("stability", "found no stable equilibrium beyond 90 mmHg")

    check = said(default_rig(), "TIHA", tmp_path, none, "force")
    assert check.level == "fault"
    assert "x = 32 mm in scene TIHA: found no stable equilibrium beyond 90 mmHg" in check.text
    assert "has no answer" in said(default_rig(), "TIHA", tmp_path, none, "pulse on virtual").text


def test_of_a_sensor_that_is_none_no_pulse_is_said(tmp_path: Path) -> None:
    sensors = [{"driver": "warp", "noise_mn": 1.0}, {"driver": "virtual"}]
    rig = Rig.model_validate({"sensor": sensors, "face_mm2": 100.0})
    checks = dry_run(rig, None, tmp_path).checks
    assert [one.name for one in checks if one.name.startswith("pulse on")] == ["pulse on virtual"]
    assert any("no such driver" in one.text for one in checks if one.level == "fault")
