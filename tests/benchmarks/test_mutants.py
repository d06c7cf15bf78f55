"""Breaking the source at random asks tests of every file; devices' faults leave no driver out."""

from importlib.metadata import distribution
from pathlib import Path

import device_faults
import pytest
from mutants import places, rooms, witnesses
from paths import ROOT


def test_every_file_has_tests_that_are_there() -> None:
    for room, files in rooms().items():
        for file in files:
            assert all((ROOT / test).exists() for test in witnesses(file)), (room, file)
            assert witnesses(file)[-1] != Path("tests"), f"no tests mirror {file}"


def test_a_place_is_a_change_of_what_runs_not_of_an_annotation() -> None:
    pytest.importorskip("cosmic_ray", reason="the extra `benchmarks` is not installed")
    found = list(places([Path("probe/planning/press_direction.py")]))
    source = (ROOT / "probe/planning/press_direction.py").read_text("utf-8").splitlines()
    assert found
    assert not [p for p in found if "->" in source[p.line - 1] and "BitOr" in p.operator]


def test_every_registered_driver_has_rows_or_a_reason() -> None:
    registered = {
        (point.group.removeprefix("palpate."), point.name)
        for point in distribution("palpate").entry_points
        if point.group in ("palpate.stages", "palpate.sensors")
    }
    tried = {(device.kind, device.driver) for device in device_faults.DEVICES.values()}
    assert tried.isdisjoint(device_faults.ELSEWHERE)
    assert tried | set(device_faults.ELSEWHERE) == registered
    assert all(device_faults.ELSEWHERE.values())


def test_every_device_and_fault_has_its_kept_rows() -> None:
    kept = device_faults.outcomes()
    for name, device in device_faults.DEVICES.items():
        jobs = [(name, "", "")]
        jobs += [(name, fault, str(p)) for fault in device.faults for p in device_faults.PHASES]
        missing = [job for job in jobs if job not in kept]
        assert not missing, f"run benchmarks/device_faults.py {name}: {missing[:3]} …"
        assert not [kept[job] for job in jobs if kept[job].wrong]
