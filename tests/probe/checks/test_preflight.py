"""What is said of devices and limits before a scan."""

from pathlib import Path
from typing import Any

import pytest

from drivers import SimulatedClock
from probe.checks.dry_run import dry_run
from probe.checks.preflight import device_checks
from probe.config.devices import connect
from probe.config.rig import Rig, RigError
from probe.config.scan_plan import plan_for
from sim_backend.scene.scene_file import load_scene


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


CELL = {"driver": "lines", "port": "x", "pattern": "(?P<f>.*)", "rate_hz": 10}


def cell(unit: str, role: str, **more: float) -> dict[str, Any]:
    return CELL | {"channel": [{"name": "f", "unit": unit, "role": role, **more}]}


@pytest.mark.parametrize("sensors, limit_n, said", [
    ([{"driver": "ft300", "port": "x"}], 300, None),
    ([{"driver": "ft300", "port": "x"}], 5000, "ft300 reads up to 300 N"),
    ([cell("N", "force", full_scale=10.0)], 10, None),
    ([cell("N", "force", full_scale=10.0)], 12, "lines reads up to 10 N"),
    ([cell("kPa", "pressure", full_scale=100.0)], 12, "lines reads up to 10 N"),
    ([cell("N", "force")], 300, None),
    ([cell("N", "force")], 301, "lines reads up to 300 N"),
    ([cell("N", "force", full_scale=10.0), {"driver": "ft300", "port": "x"}], 12, None),
])  # fmt: skip
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
