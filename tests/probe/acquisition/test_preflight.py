"""What a dry run says of the press itself: its force, and what no answer is known of."""

from pathlib import Path
from typing import Any

import pytest

from drivers import SimulatedClock
from probe.acquisition.dry_run import dry_run
from probe.acquisition.preflight import Check, device_checks
from probe.acquisition.session import scan
from probe.config.devices import connect
from probe.config.rig import Rig, RigError, default_rig
from probe.config.scan_plan import plan_for
from sim_backend.fem.newton import CannotSolve
from sim_backend.scene.scene_file import load_scene


def said(rig: Rig, scene: str, out: Path, respond: Any, name: str) -> Check:
    checks = dry_run(rig, load_scene(scene), out, respond).checks
    (check,) = (one for one in checks if one.name == name)
    return check


@pytest.mark.parametrize(
    ("scene", "most_n", "level", "finish"),
    [
        ("TIHA", 5.0, "ok", "completed"),
        ("TIHA", 1.4, "warning", "completed"),
        ("TIHA", 1.1, "fault", "faulted"),
        ("TIT", 1.1, "fault", "faulted"),
        ("TI", 1.1, "warning", "completed"),
    ],
)
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


@pytest.mark.parametrize(
    "keys",
    [
        {"scene": {"name": "TIHA", "surface_mm": -1.0}},
        {"stage": {"driver": "virtual", "stiffness_n_mm": 2.0}},
        {"sensor": [{"driver": "virtual", "gain": 0.5}]},
        {"sensor": [{"driver": "lines", "port": "x"}]},
    ],
)
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


@pytest.mark.parametrize(("depth_mm", "is_warned"), [(0.0025, True), (0.09, True), (0.1, False)])
def test_a_press_as_shallow_as_an_arrival_is_warned_of(
    depth_mm: float, is_warned: bool, tmp_path: Path
) -> None:
    """2.5 mm in metres went through without a word."""
    report = dry_run(Rig.model_validate({"scan": {"indentation_mm": depth_mm}}), None, tmp_path)
    texts = [
        one.text for one in report.checks if (one.name, one.level) == ("indentation", "warning")
    ]
    assert len(texts) == is_warned
    assert all("the key is in millimetres" in text for text in texts)


def test_of_a_sensor_that_is_none_no_pulse_is_said(tmp_path: Path) -> None:
    sensors = [{"driver": "warp", "noise_mn": 1.0}, {"driver": "virtual"}]
    rig = Rig.model_validate({"sensor": sensors, "face_mm2": 100.0})
    checks = dry_run(rig, None, tmp_path).checks
    assert [one.name for one in checks if one.name.startswith("pulse on")] == ["pulse on virtual"]
    assert any("no such driver" in one.text for one in checks if one.level == "fault")


CELL = {"driver": "lines", "port": "x", "pattern": "(?P<f>.*)", "rate_hz": 10}


def cell(unit: str, role: str, **more: float) -> dict[str, Any]:
    return CELL | {"channel": [{"name": "f", "unit": unit, "role": role, **more}]}


@pytest.mark.parametrize(
    ("sensors", "limit_n", "said"),
    [
        ([{"driver": "ft300", "port": "x"}], 300, None),
        ([{"driver": "ft300", "port": "x"}], 5000, "ft300 reads up to 300 N"),
        ([cell("N", "force", full_scale=10.0)], 10, None),
        ([cell("N", "force", full_scale=10.0)], 12, "lines reads up to 10 N"),
        ([cell("kPa", "pressure", full_scale=100.0)], 12, "lines reads up to 10 N"),
        ([cell("N", "force")], 300, None),
        ([cell("N", "force")], 301, "lines reads up to 300 N"),
        ([cell("N", "force", full_scale=10.0), {"driver": "ft300", "port": "x"}], 12, None),
    ],
)
def test_a_limit_that_no_sensor_reads_up_to_is_said(
    sensors: list[dict[str, Any]], limit_n: float, said: str | None, tmp_path: Path
) -> None:
    keys = {"sensor": sensors, "safety": {"max_force_n": limit_n}, "face_mm2": 100.0}
    checks = dry_run(Rig.model_validate(keys), None, tmp_path).checks
    (limit,) = (one for one in checks if one.name == "force limit")
    assert (limit.level == "ok") == (said is None)
    assert said is None or said in limit.text


def test_a_stage_that_nobody_named_is_said() -> None:
    """A real sensor on a stage that does not exist passed the dry run without a word."""
    cell = {"driver": "ft300", "port": "/dev/ttyUSB0"}
    forgotten = Rig.model_validate({"sensor": [cell], "scene": {"name": "TI"}})
    meant = Rig.model_validate({"stage": {"driver": "virtual"}, "sensor": [cell]})

    def warned(rig: Rig) -> bool:
        found, *_ = device_checks(rig, plan_for(rig), load_scene("TI"))
        return any("[stage] is missing" in check.text for check in found)

    assert warned(forgotten)
    assert not warned(meant)
    assert not warned(Rig())
    with pytest.raises(RigError, match=r"\[stage\] is missing: say what moves"):
        connect(Rig.model_validate({"sensor": [cell]}), SimulatedClock())
