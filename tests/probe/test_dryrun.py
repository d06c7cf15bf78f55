import json
import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibration import fit_force, fit_tare, record, save
from probe.dryrun import draw_path, dry_run, scan_seconds
from probe.rig import Rig, default_rig
from sim_backend.scene import load_scene


def levels(report: Any) -> dict[str, str]:
    return {check.name: check.level for check in report.checks}


def test_the_default_rig_can_scan_and_sees_the_pulse(tmp_path: Path, winkler: Any) -> None:
    report = dry_run(default_rig(), load_scene("TIHA"), tmp_path, winkler)
    assert report.can_scan
    assert levels(report)["pulse on virtual"] == "ok"
    assert report.seconds == pytest.approx(38, abs=1)
    assert json.loads(json.dumps(report.as_json()))["can_scan"]


def test_a_noisy_sensor_is_warned_of(tmp_path: Path) -> None:
    rig = Rig.model_validate({"sensor": [{"driver": "ft300"}], "face_mm2": 50})
    report = dry_run(rig, None, tmp_path)
    assert levels(report)["pulse on ft300"] == "warning"


def test_an_unknown_driver_is_a_fault(tmp_path: Path) -> None:
    rig = Rig.model_validate({"stage": {"driver": "warp"}})
    report = dry_run(rig, None, tmp_path)
    assert levels(report)["stage"] == "fault"
    assert not report.can_scan


def test_a_full_disk_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10, 9, 1))
    assert not dry_run(default_rig(), None, tmp_path / "not" / "yet").can_scan


def test_calibrations_are_read_and_old_ones_warned_of(tmp_path: Path) -> None:
    loads = np.arange(6.0)[:, None]
    made = fit_force(loads + 1e-3 * np.sin(9 * loads), loads)
    tare = fit_tare(np.arange(20.0), np.sin(np.arange(20.0)))
    now = datetime.now(UTC)
    files = {name: tmp_path / f"{name}.json" for name in ("new", "old", "bad", "other")}
    save(record(made, "cell", {}, valid_days=2.0, now=now), files["new"])
    save(record(made, "cell", {}, valid_days=2.0, now=now - timedelta(days=3)), files["old"])
    files["bad"].write_text("{}")
    save(record(tare, "cell", {}, now=now), files["other"])
    named = {f"force_{name}": str(file) for name, file in files.items()}
    rig = Rig.model_validate({"calibration": named})
    report = dry_run(rig, None, tmp_path)
    found = levels(report)
    assert found["calibration force_new"] == "ok"
    assert found["calibration force_old"] == "warning"
    assert found["calibration force_bad"] == "fault"
    assert found["calibration force_other"] == "fault"
    assert not report.can_scan


def test_the_time_of_a_row_is_its_moves_ramps_and_holds() -> None:
    plan = Rig.model_validate({"scan": {"stations": 2}}).plan
    assert scan_seconds(plan) == pytest.approx(2 * (0.05 + 1 + 0.825 + 0.2 + 0.225) + 0.2)


def test_the_path_is_drawn(tmp_path: Path) -> None:
    draw_path(default_rig(), tmp_path / "path.png")
    assert (tmp_path / "path.png").read_bytes().startswith(b"\x89PNG")
