import json
import re
import shutil
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibration import fit_force, fit_tare, record, save
from drivers import SimulatedClock
from probe.checks.doctor import listen, machine
from probe.checks.dry_run import dry_run
from probe.checks.preflight import Check
from probe.checks.run_size import scan_seconds
from probe.config.devices import connect
from probe.config.rig import Rig, RigError, default_rig
from probe.config.scan_plan import plan_for
from probe.core.events import Phase, PhaseEntered
from probe.detection import detect
from probe.scan.session import scan
from probe.storage.rows import BLOCK_BYTES
from probe.storage.run import open_run
from sim_backend.scene.scene_file import load_scene


def levels(report: Any) -> dict[str, str]:
    return {check.name: check.level for check in report.checks}


def test_the_default_rig_can_scan_and_sees_the_pulse(tmp_path: Path, winkler: Any) -> None:
    report = dry_run(default_rig(), load_scene("TIHA"), tmp_path, winkler)
    assert report.can_scan
    assert levels(report)["pulse on virtual"] == "ok"
    assert report.seconds == pytest.approx(41, abs=1)
    assert json.loads(json.dumps(report.as_json()))["can_scan"]


@pytest.mark.parametrize(("stations", "level"), [(15, "ok"), (5, "warning")])
def test_what_lies_beside_the_stations_is_said(
    stations: int, level: str, tmp_path: Path, winkler: Any
) -> None:
    """The artery of TIHA lies at 32 mm; five stations reach to 20 mm."""
    rig = Rig.model_validate({"scan": {"stations": stations}, "scene": {"name": "TIHA"}})
    report = dry_run(rig, load_scene("TIHA"), tmp_path, winkler)
    assert levels(report).get("scene", "ok") == level
    assert report.can_scan
    if level == "warning":
        (text,) = (check.text for check in report.checks if check.name == "scene")
        assert "x = 4 to 20 mm; the artery at x = 32 mm lies beside them" in text


@pytest.mark.parametrize("name, keys, said", [
    ("TIHA", {"start_mm": -3.0}, r"station 1 presses at x = -3 mm, .*between 0 and 64 mm"),
    ("TIHA", {"start_mm": 60.0, "stations": 3}, r"station 3 presses at x = 68 mm"),
    ("TIHA-solid", {"start_mm": [32.0, 20.0]}, r"at y = 20 mm, .*between -20 and 20 mm"),
    # leaning outwards over a slope, the tip goes on beyond the side
    (
        "TIHA",
        {"start_mm": 0.5, "surface_mm": [[0, 0, 0], [10, 0, -4], [0, 10, 0]]},
        r"station 1 presses at x = -0.4",
    ),
])  # fmt: skip
def test_a_press_beside_a_simulated_block_is_refused_before_it_is_made(
    name: str, keys: dict[str, Any], said: str, tmp_path: Path, winkler: Any
) -> None:
    """The dry run said that the scan could go on; it ended in crushed tissue."""
    box = {"workspace_mm": {"x": [-9, 99], "y": [-9, 99], "z": [-9, 99]}}
    scan_keys = {"stations": 1} | keys
    rig = Rig.model_validate({"scan": scan_keys, "safety": box, "scene": {"name": name}})
    report = dry_run(rig, load_scene(name), tmp_path, winkler)
    (fault,) = (check.text for check in report.checks if check.level == "fault")
    assert re.search(said, fault)
    with pytest.raises(RigError, match=re.escape(fault)):
        scan(rig, out=tmp_path, respond=winkler)
    assert not list(tmp_path.glob("*.run"))


@pytest.mark.parametrize(
    ("driver", "module"),
    [("ur", "rtde_control"), ("standa", "libximc"), ("netft", "pynetft"), ("lsl", "pylsl")],
)
def test_doctor_calls_no_driver_installed_whose_library_is_missing(
    driver: str, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr("probe.checks.doctor.why_no_windows", lambda: None)
    said = [check for check in machine() if check.name.endswith(f": {driver}")]
    assert said
    assert all(one.level == "warning" and module in one.text for one in said)


def test_doctor_says_what_the_missing_kernel_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim_backend.fem.kernel.BUILT", False)
    (said,) = (check for check in machine() if check.name == "simulation")
    assert said.level == "warning"
    assert "take 3 times as long" in said.text
    assert "apt install gcc" in said.text


LINES = {"driver": "lines", "port": "x", "pattern": "(?P<p>.*)", "rate_hz": 10}


def lines(unit: str, role: str) -> dict[str, Any]:
    return LINES | {"channel": [{"name": "p", "unit": unit, "role": role}]}


COUNTS = {"name": "load", "unit": "counts", "role": "force"}
JUDGED: list[tuple[dict[str, Any], str | None, str, str, str]] = [
    ({"sensor": [{"driver": "ft300"}], "face_mm2": 50}, None, "pulse on ft300", "warning", ""),
    ({"sensor": [lines("Pa", "pressure")], "face_mm2": None}, None, "force limit", "fault", ""),
    ({"sensor": [lines("Pa", "pressure")], "face_mm2": 100.0}, None, "force limit", "ok", ""),
    ({"sensor": [lines("V", "reference")], "face_mm2": 100.0}, None, "force limit", "fault", ""),
    ({"sensor": [lines("N", "force")], "face_mm2": None}, None, "force limit", "ok", ""),
    ({"sensor": [{"driver": "virtual"}] * 2}, "TIHA", "devices together", "fault", ""),
    (
        {"sensor": [LINES | {"pattern": "(?P<load>[0-9]+)", "channel": [COUNTS]}]},
        "TIHA", "devices together", "fault",
        "'counts'; what a driver or its calibration gives as force must be in N",
    ),
    ({"stage": {"driver": "warp"}}, None, "stage", "fault", ""),
    ({"scan": {"stations": [3, 2]}}, "TI", "note", "warning", "6 stations lie at 3 places"),
    ({"scan": {"stations": [3, 2], "pitch_mm": [4, 4]}}, "TI", "note", "ok", ""),
    ({"scan": {"stations": 3, "repeats": 2}}, "TI", "note", "ok", ""),
    ({"scan": {"stations": 3, "pitch_mm": 0}}, "TI", "note", "warning", "3 stations lie at 1 pl"),
    # a lone vessel may be pressed beside, on its support; then nothing pulses
    (
        {"scan": {"start_mm": -4.0, "stations": 1}, "scene": {"name": "HAOT"}},
        "HAOT", "scene", "warning", "",
    ),
    # what nothing real feels for is made in the air, wherever a real stage's places lie
    (
        {"stage": {"driver": "zaber", "port": "nowhere"}, "scan": {"start_mm": -3.0}},
        "TIHA", "scene", "ok", "",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("keys", "scene", "check", "level", "said"), JUDGED)
def test_what_a_rig_is_judged_to_be(
    keys: dict[str, Any], scene: str | None, check: str, level: str, said: str, tmp_path: Path,
    winkler: Any,
) -> None:  # fmt: skip
    report = dry_run(Rig.model_validate(keys), scene and load_scene(scene), tmp_path, winkler)
    assert levels(report).get(check, "ok") == level
    assert said in str(report.checks)
    assert level != "fault" or not report.can_scan


@pytest.mark.parametrize("keys, where, text", [
    ({"sensor": [{"driver": "netft", "host": "x"}]}, "sensor[0]", "pip install 'palpate"),
    ({"stage": {"driver": "standa", "x_uri": "x"}}, "stage", "pip install 'palpate[standa]'"),
    ({}, "stage", "scene.name is missing"),
    ({"sensor": [{"driver": "lines", "port": "x"}]}, "sensor[0]", "pattern"),
    (
        {"sensor": [{"driver": "ft300", "port": "x"}], "scan": {"indentation_mm": 20.0}},
        "stage",
        "only 16.83 mm thick",
    ),
], ids=["no netft", "no standa", "no scene", "no pattern", "through the block"])  # fmt: skip
def test_what_would_stop_a_scan_is_a_fault_of_the_dry_run(
    keys: dict[str, Any], where: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same devices are made as for a scan, without the libraries of netft and standa."""
    for library in ("pynetft", "libximc"):
        monkeypatch.setitem(sys.modules, library, None)
    thick = load_scene("TIHA") if text.startswith("only") else None
    box = {"workspace_mm": {"z": [-30.0, 50.0]}}
    report = dry_run(Rig.model_validate({"safety": box} | keys), thick, tmp_path)
    assert not report.can_scan
    (reported,) = (check for check in report.checks if check.name == where)
    assert reported.level == "fault"
    assert text in reported.text


def test_a_calibration_of_another_device_is_a_fault(tmp_path: Path, winkler: Any) -> None:
    load = np.linspace(0, 5, 8)
    file = tmp_path / "force.json"
    save(record(fit_force(2.0 * load, load), "another cell", {"raw_0": 2.0 * load}), file)
    rig = default_rig().model_copy(update={"calibration": {"force": str(file)}})
    report = dry_run(rig, load_scene("TIHA"), tmp_path, winkler)
    assert levels(report)["devices together"] == levels(report)["calibration force"] == "fault"
    assert "made for 'another cell'" in str(report.checks)


def test_a_stage_outside_its_workspace_is_a_fault(winkler: Any) -> None:
    scene, clock = load_scene("TIHA"), SimulatedClock()
    with connect(default_rig(), clock, scene, respond=winkler) as devices:
        narrow = Rig(scan={"start_mm": 32}, safety={"workspace_mm": {"x": [30, 90]}})  # type: ignore[arg-type]
        here = list(listen(devices, clock, narrow, seconds=0.1))
        there = list(listen(devices, clock, default_rig(), seconds=0.1))
    assert (here[0].level, there[0].level) == ("fault", "ok")
    assert "x is outside the workspace, which allows 30 to 90 mm" in here[0].text


@pytest.mark.parametrize("keys, said", [
    ({"noise_mn": 0.0}, "the last 101 readings are all 0: stuck or clipped"),
    ({"noise_mn": 0.01}, "safety.same_readings"),  # a tenth of its step
    ({"noise_mn": 0.1}, None),
    ({"bias_mn": 6000.0}, "force 6.0.. N; the limit is 5 N"),
    ({"bias_mn": 11000.0, "full_scale_n": 10.0}, "the sensor is saturated"),
])  # fmt: skip
def test_a_sensor_that_would_end_the_scan_at_rest_is_said_before_and_by_the_doctor(
    keys: dict[str, float], said: str | None, tmp_path: Path, winkler: Any
) -> None:
    scene, clock = load_scene("TIHA"), SimulatedClock()
    rig = Rig(
        scan={"stations": 1}, scene={"name": "TIHA"},  # type: ignore[arg-type]
        sensor=[{"driver": "virtual"} | keys],  # type: ignore[arg-type]
    )  # fmt: skip
    report = dry_run(rig, scene, tmp_path, winkler)
    faults = [check.text for check in report.checks if check.level == "fault"]
    with connect(rig, clock, scene, respond=winkler) as devices:
        heard = [one for one in listen(devices, clock, rig) if isinstance(one, Check)]
    faults += [one.text for one in heard if one.level == "fault"]
    assert len(faults) == (0 if said is None else 2)
    assert all(re.search(str(said), text) for text in faults), faults
    assert (scan(rig, out=tmp_path, respond=winkler).ended.finish == "completed") == (said is None)


@pytest.mark.parametrize("travel_mm_s, allowed, said", [
    (20.0, 25.0, None),
    (20.0, 20.0, None),
    (20.0, 19.0, "scan.travel_mm_s = 20 mm/s: stage 'virtual' allows at most 19"),
    (20.0, 9.0, "scan.travel_mm_s = 20"),
    (5.0, 9.0, "scan.approach_mm_s = 10 mm/s: stage 'virtual' allows at most 9"),
])  # fmt: skip
def test_a_scan_that_is_too_fast_for_its_stage_is_a_fault(
    travel_mm_s: float, allowed: float, said: str | None, tmp_path: Path, winkler: Any
) -> None:
    """The default's approach is 10 mm/s."""
    tables = {
        "scan": {"travel_mm_s": travel_mm_s},
        "stage": {"driver": "virtual", "max_speed_mm_s": allowed},
    }
    report = dry_run(Rig.model_validate(tables), load_scene("TIHA"), tmp_path, winkler)
    assert report.can_scan == (said is None)
    assert said is None or said in str(report.checks)


@pytest.mark.parametrize(("share", "level"), [(0.0, "fault"), (0.9, "fault"), (10.0, "ok")])
def test_a_disk_with_less_than_the_run_needs_is_a_fault(
    share: float, level: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "not" / "yet"
    free = round(share * dry_run(default_rig(), None, out).size_bytes)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**12, 0, free))
    assert levels(dry_run(default_rig(), None, out))["disk"] == level


def test_calibrations_are_read_and_old_ones_warned_of(tmp_path: Path) -> None:
    loads = np.arange(6.0)[:, None]
    made = fit_force(loads + 1e-3 * np.sin(9 * loads), loads)
    tare = fit_tare(np.arange(20.0), np.sin(np.arange(20.0)))
    now = datetime.now(UTC)
    files = {name: tmp_path / f"{name}.json" for name in ("new", "old", "bad", "other")}
    a_day_ago = now - timedelta(days=1)
    save(record(made, "cell", {}, valid_days=2.0, now=a_day_ago), files["new"])
    save(record(made, "cell", {}, valid_days=2.0, now=now - timedelta(days=3)), files["old"])
    files["bad"].write_text("{}")
    save(record(tare, "cell", {}, now=now), files["other"])
    named = {f"force_{name}": str(file) for name, file in files.items()}
    cell = {"driver": "virtual", "name": "cell"}
    rig = Rig.model_validate({"calibration": named, "sensor": [cell]})
    report = dry_run(rig, None, tmp_path)
    found = levels(report)
    assert found["calibration force_new"] == "ok"
    assert "of cell, 1.0 days old, meant for 2" in {check.text for check in report.checks}
    assert found["calibration force_old"] == "warning"
    assert found["calibration force_bad"] == "fault"
    assert found["calibration force_other"] == "fault"
    assert not report.can_scan


def test_the_time_of_a_row_is_its_moves_ramps_and_holds() -> None:
    plan = plan_for(Rig.model_validate({"scan": {"stations": 2}}))
    each_s = 0.05 + 0.1 + 1 + 0.825 + 0.1 + 0.2 + 0.225
    assert scan_seconds(plan) == pytest.approx(2 * each_s + 0.2 + (0.2 + 0.15 + 0.05) + 0.15)


@pytest.mark.parametrize("touch", [{}, {"touch_n": 0.05, "search_mm": 1.0}])
@pytest.mark.parametrize("stations", [4, [2, 2]])
def test_a_scan_takes_as_long_as_its_dry_run_says(
    touch: dict[str, float], stations: Any, tmp_path: Path, winkler: Any
) -> None:
    scan_keys = {"stations": stations, "hold_s": 0.2, "pitch_mm": 8.0, **touch}
    rig = Rig.model_validate({"scan": scan_keys, "scene": {"name": "TI"}})
    said = dry_run(rig, load_scene("TI"), tmp_path, winkler)
    run = scan(rig, out=tmp_path, respond=winkler)
    began_s = next(
        e.time_s for e in open_run(run.path).events()
        if isinstance(e, PhaseEntered) and e.phase is Phase.TARING
    )  # fmt: skip
    assert run.ended.time_s - began_s == pytest.approx(
        said.seconds,
        rel=0.09 if touch else 0.04,  # a touch is felt 0.1 mm deep; each move speeds up
    )
    (words,) = (check.text for check in said.checks if check.name == "time")
    assert ("up to 4 s more where the surface lies deeper" in words) == bool(touch)


@pytest.mark.parametrize(("hold_s", "short"), [(0.0, True), (0.07, True), (0.2, False)])
@pytest.mark.parametrize("rate_hz", [100.0, 500.0])
def test_a_hold_too_short_to_judge_a_press_by_is_said(
    hold_s: float, short: bool, rate_hz: float, tmp_path: Path, winkler: Any
) -> None:
    keys = {"stations": 1, "hold_s": hold_s}
    sensor = [{"driver": "virtual", "rate_hz": rate_hz}]
    rig = Rig.model_validate({"scan": keys, "sensor": sensor, "scene": {"name": "TIHA"}})
    report = dry_run(rig, load_scene("TIHA"), tmp_path, winkler)
    (text,) = (check.text for check in report.checks if check.name == "pulse on virtual")
    assert ("too short to judge a press by; at least 0.1" in text) == short
    found = detect(open_run(scan(rig, out=tmp_path, respond=winkler).path).recording())
    assert ("no press can be judged" in found.reason) == short


@pytest.mark.parametrize(("touch_n", "can_scan"), [(0.05, False), (0.7, True)])
def test_a_touch_must_stand_out_of_the_noise(
    touch_n: float, can_scan: bool, tmp_path: Path, winkler: Any
) -> None:
    """An FT-300 has 0.1 N: a hundred readings a second would soon find a surface in the air."""
    sensor = [{"driver": "virtual", "noise_mn": 100.0, "rate_hz": 100.0}]
    rig = Rig.model_validate(
        {"scan": {"stations": 2, "touch_n": touch_n, "search_mm": 1.0}, "sensor": sensor}
    )
    report = dry_run(rig, load_scene("TIHA"), tmp_path, winkler)
    assert report.can_scan is can_scan
    assert [c.level for c in report.checks if c.name == "touch"] == ["fault"] * (not can_scan)


@pytest.mark.parametrize("scan_keys, sensor, level, said", [
    ({"force_n": 0.5}, {}, "ok", "0.5 N are reached 1.0"),  # of 480 N/m
    ({"force_n": 2.0}, {}, "warning", "2 N are not reached: 1.23 N 2.50 mm deep"),
    ({"force_n": 0.5}, {"noise_mn": 100.0, "rate_hz": 100.0}, "fault", "steps_n, to 1.1 or more"),
    ({"steps_n": [0.6, 0.9]}, {"noise_mn": 50.0, "rate_hz": 100.0}, "fault", "0.3 N are too"),
])  # fmt: skip
def test_whether_a_force_is_reached_and_shown_is_known_before(
    scan_keys: Any, sensor: Any, level: str, said: str, tmp_path: Path, winkler: Any
) -> None:
    keys = {"scan": scan_keys, "sensor": [{"driver": "virtual", **sensor}]}
    report = dry_run(Rig.model_validate(keys), load_scene("TIHA"), tmp_path, winkler)
    assert any(c.name == "force" and c.level == level and said in c.text for c in report.checks)


def test_a_press_that_its_force_must_end_goes_slower_and_says_how_long(
    tmp_path: Path, winkler: Any
) -> None:
    """On 10 N/mm 0.25 N are there in 52 ms at 0.48 mm/s."""
    usual, slow = (
        dry_run(Rig.model_validate({"scan": keys}), load_scene("TI"), tmp_path, winkler)
        for keys in ({}, {"force_n": 0.5})
    )
    (note,) = (check.text for check in slow.checks if check.name == "note")
    assert "goes down at 0.48 mm/s and takes up to 5.2 s, not scan.ramp_s = 1" in note
    assert slow.seconds - usual.seconds == pytest.approx(15 * (4.2 + 2 * 0.15), rel=0.01)


def test_the_pulse_is_expected_where_the_vessel_s_path_lies(tmp_path: Path, winkler: Any) -> None:
    scene = load_scene("TIHA")
    (vessel,) = scene.arteries
    vessel = vessel.model_copy(update={"path": ((-2.0, 20.0, 12.66), (2.0, 44.0, 12.66))})
    scene = scene.model_copy(update={"inclusion": (vessel,)})
    grid = {"start_mm": [32.0, -2.0], "pitch_mm": [4.0, 4.0], "stations": [5, 2]}
    report = dry_run(Rig.model_validate({"scan": grid}), scene, tmp_path, winkler)
    (text,) = (c.text for c in report.checks if c.name.startswith("pulse on"))
    assert "at x = 44 mm" in text


def test_the_disk_is_asked_for_all_channels(tmp_path: Path, winkler: Any) -> None:
    """A UR's six components and the normal force are 71 bytes a sample, a load cell's one 17."""
    ur = {"driver": "ur", "host": "nowhere", "rate_hz": 500.0}
    cell = {"driver": "virtual", "rate_hz": 500.0}
    one, both = (
        dry_run(Rig.model_validate({"sensor": devices}), load_scene("TIHA"), tmp_path, winkler)
        for devices in ([cell], [cell, ur])
    )
    assert "fault" not in levels(both).values()
    more = both.size_bytes - one.size_bytes
    assert more == pytest.approx(one.seconds * (500 * 71 + 20 * BLOCK_BYTES), rel=1e-3)
