"""An absent device is replaced only where the rig or the user allows it, and marked so."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers import DeviceAbsent, WallClock
from probe.devices import connect
from probe.engine import run_scan
from probe.events import Event, Finish, RunStarted, Samples
from probe.rig import RigError, load_rig
from sim_backend import load_scene
from sim_backend.emulators import ft300, grbl
from sim_backend.emulators.serving import Served
from sim_backend.phantom import Phantom, Respond

ABSENT = 'port = "/dev/ttyNotThere"'
SCAN = """
face_mm2 = 100.0
[scan]
start_mm = 32.0
stations = 1
indentation_mm = 1.0
ramp_s = 0.2
hold_s = 0.2
settle_s = 0.15
[safety]
retract_mm = 0.5
[scene]
name = "TIHA"
"""
GRBL = "origin_mm = [-80.0, -20.0, -52.0]"


def rig_file(folder: Path, stage: str, sensor: str) -> Path:
    face, rest = SCAN.split("[scan]")
    path = folder / "rig.toml"
    path.write_text(f"{face}\n[stage]\n{stage}\n[[sensor]]\n{sensor}\n[scan]{rest}", "utf-8")
    return path


@pytest.mark.parametrize("which", ["stage", "sensor"])
def test_without_leave_an_absent_device_is_an_error(
    which: str, winkler: Respond, tmp_path: Path
) -> None:
    absent = {"stage": f'driver = "grbl"\n{ABSENT}', "sensor": f'driver = "ft300"\n{ABSENT}'}
    tables = {"stage": 'driver = "virtual"', "sensor": 'driver = "virtual"'}
    tables[which] = absent[which]
    rig = load_rig(rig_file(tmp_path, **tables))
    with pytest.raises(DeviceAbsent, match="no such port; serial ports here"):
        connect(rig, WallClock(), respond=winkler)


@pytest.mark.parametrize(
    ("stage_key", "sensor_key", "asked", "leave"),
    [
        ('fallback = "virtual"', 'fallback = "virtual"', None, True),
        ("", "", "virtual", True),
        ('fallback = "virtual"', "", None, False),  # the sensor has none
    ],
)
def test_with_leave_it_is_replaced_and_named(
    stage_key: str,
    sensor_key: str,
    asked: Any,
    leave: bool,
    winkler: Respond,
    tmp_path: Path,
) -> None:
    rig = load_rig(
        rig_file(
            tmp_path,
            f'driver = "grbl"\n{ABSENT}\n{stage_key}',
            f'driver = "ft300"\n{ABSENT}\n{sensor_key}',
        )
    )
    if not leave:
        with pytest.raises(DeviceAbsent):
            connect(rig, WallClock(), fallback=asked, respond=winkler)
        return
    with connect(rig, WallClock(), fallback=asked, respond=winkler) as opened:
        assert len(opened.notes) == 2
        assert all("a simulated stand-in takes its place" in note for note in opened.notes)
        assert opened.stage.simulated
        assert [sensor.name for sensor in opened.sensors] == ["ft300"]
        assert all(channel.simulated for s in opened.sensors for channel in s.channels)


def test_a_wrong_setting_is_never_replaced(winkler: Respond, tmp_path: Path) -> None:
    rig = load_rig(
        rig_file(tmp_path, 'driver = "virtual"', f'driver = "ft300"\n{ABSENT}\nmode = "fast"')
    )
    with pytest.raises(RigError, match="mode = 'fast'"):
        connect(rig, WallClock(), fallback="virtual", respond=winkler)


def scanned(path: Path, respond: Respond, during: Callable[[Event], None]) -> list[Event]:
    """All events of a scan of the rig file."""
    rig, clock, events = load_rig(path), WallClock(), list[Event]()

    def sink(event: Event) -> None:
        events.append(event)
        during(event)

    with connect(rig, clock, respond=respond) as devices:
        run_scan(rig.plan, devices.stage, devices.sensors, clock, sink, rig.limits)
    return events


def marks(events: list[Event]) -> dict[str, bool]:
    (started,) = [e for e in events if isinstance(e, RunStarted)]
    return {device: own[0].simulated for device, own in started.channels.items()}


def test_a_real_stage_with_a_virtual_sensor_rehearses_a_scan(
    winkler: Respond, tmp_path: Path
) -> None:
    board_world = Phantom(load_scene("TIHA"), WallClock(), winkler, home=(0.032, 0.0, 0.003))
    with grbl.emulate(board_world, at=str(tmp_path / "tty"), homed=True) as board:
        path = rig_file(
            tmp_path,
            f'driver = "grbl"\nport = "{board.address}"\n{GRBL}',
            f'driver = "ft300"\n{ABSENT}\nfallback = "virtual"',
        )
        events = scanned(path, winkler, lambda _event: None)
    assert events[-1].finish is Finish.COMPLETED
    assert marks(events) == {"stage": False, "ft300": True}
    felt = [
        e.block.values[:, 0].max() for e in events if isinstance(e, Samples) and e.device == "ft300"
    ]
    # the virtual sensor feels where the real stage is: 1 mm into 480 N/m
    assert max(felt) == pytest.approx(0.48, abs=0.05)


def test_a_sensor_lost_in_mid_scan_is_a_fault_never_a_stand_in(
    winkler: Respond, tmp_path: Path
) -> None:
    world = Phantom(load_scene("TIHA"), WallClock(), winkler, home=(0.032, 0.0, 0.003))
    with ft300.emulate(world, at=str(tmp_path / "tty")) as device:
        path = rig_file(
            tmp_path,
            'driver = "virtual"',
            f'driver = "ft300"\nport = "{device.address}"\nfallback = "virtual"',
        )
        events = scanned(path, winkler, unplug_when_pressing(device))
    assert events[-1].finish is Finish.FAULTED
    assert "ft300: connection lost" in events[-1].reason
    assert marks(events) == {"stage": True, "ft300": False}
    assert {e.device for e in events if isinstance(e, Samples)} == {"stage", "ft300"}


def unplug_when_pressing(device: Served) -> Callable[[Event], None]:
    def look(event: Event) -> None:
        if getattr(event, "phase", None) == "holding":
            device.fail("drop")

    return look
