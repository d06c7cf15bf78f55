"""The benchmark of devices' faults leaves no registered driver out."""

from importlib.metadata import distribution

import device_faults


def test_every_registered_driver_has_rows_or_a_reason() -> None:
    """Of this package: others may be installed beside it."""
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
