"""A stage's own limits and its park are known before anything moves."""

from pathlib import Path
from typing import Any

import pytest

from drivers import ConfigError
from probe.checks.dry_run import dry_run
from probe.config.load_rig import load_rig
from probe.config.rig import Rig
from probe.scan.session import scan
from sim_backend.scene.scene_file import load_scene

GRBL = {"driver": "grbl", "port": "socket://127.0.0.1:1", "simulated": True}
TMCL = {
    "driver": "tmcl", "port": "socket://127.0.0.1:1", "simulated": True, "max_speed_mm_s": 25.0,
    "x": {"motor": 0, "microsteps_per_mm": 5120.0}, "y": {"motor": 1, "microsteps_per_mm": 5120.0},
    "z": {"motor": 2, "microsteps_per_mm": 5120.0},
}  # fmt: skip
WIDE = [[-500.0, 500.0], [-500.0, 500.0], [-100.0, 500.0]]


def refused(rig: Rig, respond: Any) -> list[str]:
    report = dry_run(rig, load_scene("TIHA"), Path(), respond)
    return [check.text for check in report.checks if check.level == "fault"]


def rig_of(**stage: Any) -> Rig:
    return Rig.model_validate(
        {"face_mm2": 100.0, "stage": {"driver": "virtual"} | stage, "scene": {"name": "TIHA"}}
    )


@pytest.mark.parametrize("stage", [{}, GRBL, TMCL])
@pytest.mark.parametrize("axis, limits, said", [
    (2, [-1.0, 500.0], "station 1 needs z = -2.5 mm; allowed: -1 to 500 mm"),
    (2, [-5.0, 1.0], "station 1 needs z = 2 mm; allowed: -5 to 1 mm"),
    (2, [-5.0, 3.0], "station 1 needs z = 4 mm; allowed: -5 to 3 mm"),  # to see it in the air
    (0, [-500.0, 30.0], "station 8 needs x = 32 mm; allowed: -500 to 30 mm"),
])  # fmt: skip
def test_a_scan_beyond_a_stages_limits_is_refused(
    stage: dict[str, Any], axis: int, limits: list[float], said: str, winkler: Any
) -> None:
    bounds = [*WIDE]
    bounds[axis] = limits
    (text,) = refused(rig_of(**stage, limits_mm=bounds), winkler)
    assert text.startswith(f"stage.limits_mm: {said}")
    assert not refused(rig_of(**stage, limits_mm=WIDE), winkler)


def test_limits_just_as_wide_as_the_scan_are_enough(winkler: Any, tmp_path: Path) -> None:
    bounds = [[4.0, 60.0], [0.0, 0.0], [-2.5, 4.0]]
    rig = rig_of(limits_mm=bounds)
    assert not refused(rig, winkler)
    done = scan(rig, "TIHA", tmp_path, respond=winkler)
    assert done.ended.reason == "every station is complete"


def test_a_scan_beyond_a_stages_limits_moves_nothing_and_writes_no_run(
    tmp_path: Path, winkler: Any
) -> None:
    rig = rig_of(limits_mm=[*WIDE[:2], [-1.0, 500.0]])
    with pytest.raises(ConfigError, match=r"stage\.limits_mm: station 1 needs z = -2\.5 mm"):
        scan(rig, "TIHA", tmp_path, respond=winkler)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("stage", [GRBL, TMCL])
@pytest.mark.parametrize("keys, said", [
    ({"limits_mm": [*WIDE[:2], [-5.0, 40.0]]}, "z = 45 mm; allowed: -5 to 40 mm"),
    ({"park_mm": [0.0, 0.0, 60.0]}, "z = 60 mm; allowed: -4 to 50 mm (safety.workspace_mm)"),
    ({"home": False, "park_mm": [0.0, 0.0, 60.0]}, None),
    ({}, None),
])  # fmt: skip
def test_a_park_out_of_bounds_is_refused(
    stage: dict[str, Any], keys: dict[str, Any], said: str | None, winkler: Any
) -> None:
    rig = rig_of(**stage | {"home": True, "park_mm": [0.0, 0.0, 45.0]} | keys)
    found = refused(rig, winkler)
    assert len(found) == (said is not None)
    for text in found:
        assert text.startswith("stage.park_mm: ")
        assert said in text


@pytest.mark.parametrize("name", ["grbl_ft300", "tmcl_lines", "zaber_lines", "pi_lines"])
def test_shipped_rigs_stay_within_their_limits(name: str, winkler: Any) -> None:
    rig = load_rig(Path("rigs") / f"{name}.toml")
    assert not [text for text in refused(rig, winkler) if "limits_mm" in text or "park" in text]
