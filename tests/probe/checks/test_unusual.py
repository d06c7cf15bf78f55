"""Values in another unit than their key's are said before anything moves."""

from typing import Any

import pytest
from paths import ROOT

import palpate
from probe.checks.unusual import unusual
from probe.config.load_rig import load_rig
from probe.config.rig import Rig

RIGS = sorted((ROOT / "rigs").glob("*.toml"))
GRBL = {"driver": "grbl", "port": "x"}


@pytest.mark.parametrize("keys, level, said", [
    ({"safety": {"max_speed_mm_s": 25000}}, "warning", "safety.max_speed_mm_s = 25000: 1,000"),
    ({"safety": {"max_force_n": 0.005}}, "warning", "safety.max_force_n = 0.005: 1,000 times"),
    ({"scan": {"ramp_s": 1000}}, "warning", "scan.ramp_s = 1000: 1,000 times more than the"),
    ({"scan": {"pitch_mm": [4, 0.004]}}, "warning", "scan.pitch_mm = 0.004: 1,000 times less"),
    ({"face_mm2": 0.0001}, "warning", "face_mm2 = 0.0001: 1,000,000 times less"),
    ({"face_mm2": 1}, "warning", "face_mm2 = 1: 100 times less"),
    ({"face_mm2": 100000}, "warning", "face_mm2 = 100000: 1,000 times more"),
    ({"stage": GRBL | {"baud": 115}}, "warning", "stage.baud = 115: 1,002 times less"),
    (
        {"stage": GRBL | {"origin_mm": [-0.08, -0.02, -0.052]}},
        "warning",
        "stage.origin_mm = [-0.08, -0.02, -0.052]: less than 1 mm from the machine's own zero",
    ),
    (
        {"stage": GRBL | {"status_hz": 2}},
        "fault",
        "stage.status_hz = 2: a position every 0.5 s is older than stage.silent_s = 0.25",
    ),
])  # fmt: skip
def test_a_slip_of_the_unit_is_said(keys: dict[str, Any], level: str, said: str) -> None:
    (check,) = unusual(Rig.model_validate(keys))
    assert (check.name, check.level) == ("values", level)
    assert check.text.startswith(said)


@pytest.mark.parametrize("path", RIGS, ids=lambda path: path.stem)
def test_of_no_rig_that_is_shipped_a_unit_is_in_doubt(path: Any) -> None:
    assert not list(unusual(load_rig(path)))


@pytest.mark.parametrize("keys", [
    {"scan": {"hold_s": 60, "start_mm": 0.01, "touch_n": 0.01}},
    {"scan": {"pitch_mm": [4, 0], "start_mm": [0, 0]}, "face_mm2": 20},
    {"stage": GRBL | {"origin_mm": [0, 0, 0]}},
    {"stage": GRBL | {"origin_mm": "here"}},  # what is no origin is said where it is made
    {"stage": GRBL | {"status_hz": "often"}},
    {"stage": {"driver": "warp"}},
])  # fmt: skip
def test_what_may_be_meant_is_not_doubted(keys: dict[str, Any]) -> None:
    assert not list(unusual(Rig.model_validate(keys)))


def test_a_scene_is_doubted_with_its_rig() -> None:
    scene = palpate.load_scene("TI")
    assert scene.tissue is not None
    soft = scene.model_copy(
        update={"tissue": scene.tissue.model_copy(update={"modulus_kpa": 0.05})}
    )
    assert list(unusual(Rig(), scene)) == []
    (check,) = unusual(Rig(), soft)
    assert check.level == "warning"
    assert check.text.startswith("scene: tissue.modulus_kpa = 0.05: 2,000 times less than")
