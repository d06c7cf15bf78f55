"""An absent device is replaced only where the rig or the user allows it, and marked so."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers import Channel, ConfigError, DeviceAbsent, WallClock
from probe.config.devices import connect, open_sensors
from probe.config.load_rig import load_rig
from probe.config.rig import Rig, RigError
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.core.events import Event, Finish, RunStarted, Samples
from probe.guards.prepare import prepare
from probe.scan.engine import run_scan
from sim_backend import load_scene
from sim_backend.emulators import ft300, grbl
from sim_backend.emulators.serving import Served
from sim_backend.phantom.phantom import Phantom, Respond

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
silence_s = 5.0
late_s = 5.0
hardest_n_mm = 1.0
[scene]
name = "TIHA"
"""
# the emulator shares this machine with other tests
GRBL = "origin_mm = [-80.0, -20.0, -52.0]\nanswer_s = 5.0\nsilent_s = 5.0"


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


@pytest.mark.parametrize("stage_key, sensor_key, asked, leave", [
    ('fallback = "virtual"', 'fallback = "virtual"', None, True),
    ("", "", "virtual", True),
    ('fallback = "virtual"', "", None, False),  # the sensor has none
])  # fmt: skip
def test_with_leave_it_is_replaced_and_named(
    stage_key: str, sensor_key: str, asked: Any, leave: bool, winkler: Respond, tmp_path: Path
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
        said = "no such port.* a simulated stand-in takes its place"
        assert all(re.search(said, note) for note in opened.notes)
        assert opened.stage.simulated
        assert [sensor.name for sensor in opened.sensors] == ["ft300"]
        assert all(channel.simulated for s in opened.sensors for channel in s.channels)


class Held:
    """A device that knows whether anybody has it open."""

    channels = (Channel("force", "N", "force"),)

    def __init__(self, name: str, absent: bool = False) -> None:
        self.name, self.absent, self.open = name, absent, False

    def connect(self) -> None:
        if self.absent:
            raise DeviceAbsent(self.name, "not here")
        self.open = True

    def close(self) -> None:
        self.open = False


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> dict[str, Held]:
    """What is opened for a rig of a stage and two sensors."""
    all_held = {where: Held(where) for where in ("stage", "sensor[0]", "sensor[1]")}
    monkeypatch.setattr(
        "probe.config.devices.make_device", lambda _kind, where, *_: all_held[where]
    )
    return all_held


TWO_CELLS = Rig.model_validate({"sensor": [{"driver": "virtual"}, {"driver": "virtual"}]})


def test_one_absent_device_leaves_none_open(held: dict[str, Held]) -> None:
    held["sensor[1]"].absent = True
    with pytest.raises(DeviceAbsent, match="not here"):
        connect(TWO_CELLS, WallClock())
    assert not any(one.open for one in held.values())


def test_sensors_that_were_opened_alone_are_closed(held: dict[str, Held]) -> None:
    with pytest.raises(KeyError), open_sensors(TWO_CELLS, WallClock()) as sensors:
        assert [sensor.name for sensor in sensors] == ["sensor[0]", "sensor[1]"]
        assert [one.open for one in held.values()] == [False, True, True]
        raise KeyError
    assert not any(one.open for one in held.values())


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
        plan = plan_for(rig)
        ready = prepare(rig, plan, limits_for(rig, plan), load_scene("TIHA"), devices, 0)
        run_scan(
            ready.plan, devices.stage, devices.sensors, clock, sink, ready.limits,
            config=ready.config,
        )  # fmt: skip
    return events


def marks(events: list[Event]) -> dict[str, bool]:
    (started,) = [e for e in events if isinstance(e, RunStarted)]
    return {device: own[0].simulated for device, own in started.channels.items()}


@contextmanager
def real_stage_virtual_sensor(respond: Respond, folder: Path) -> Iterator[tuple[Path, Phantom]]:
    """A rig file, and the world that its stage moves in; its sensor is not there."""
    world = Phantom(load_scene("TIHA"), WallClock(), respond, home=(0.032, 0.0, 0.003))
    with grbl.emulate(world, at=str(folder / "tty"), homed=True) as board:
        path = rig_file(
            folder,
            f'driver = "grbl"\nport = "{board.address}"\n{GRBL}',
            f'driver = "ft300"\n{ABSENT}\nfallback = "virtual"',
        )
        yield path, world


def test_a_real_stage_with_a_virtual_sensor_rehearses_a_scan(
    winkler: Respond, tmp_path: Path
) -> None:
    with real_stage_virtual_sensor(winkler, tmp_path) as (path, board_world):
        events = scanned(path, winkler, lambda _event: None)
    assert events[-1].finish is Finish.COMPLETED
    assert marks(events) == {"stage": False, "ft300": True}
    # nothing real feels, so nothing real is touched: the true tip stays in the air
    t = np.arange(0.0, board_world.clock.now(), 1e-3)
    way = board_world.tip.legs(t)
    assert min(float(leg.points(t[span])[:, 2].min()) for leg, _, span in way) > 2.9e-3
    reported = [
        e.block.values[:, 2] for e in events if isinstance(e, Samples) and e.device == "stage"
    ]
    assert np.ptp(np.concatenate(reported)) == pytest.approx(11e-3 + 2 * 0.5e-3 - 3e-3, abs=2e-4)
    (started,) = [e for e in events if isinstance(e, RunStarted)]
    assert started.config["rehearsal_mm"] == pytest.approx(1.0 + 10.0)


def test_a_rehearsal_without_room_is_refused(winkler: Respond, tmp_path: Path) -> None:
    with real_stage_virtual_sensor(winkler, tmp_path) as (path, board_world):
        low = path.read_text() + "\n[safety.workspace_mm]\nz = [-4.0, 9.0]\n"
        path.write_text(low)
        rig = load_rig(path)
        plan = plan_for(rig)
        with (
            connect(rig, WallClock(), respond=winkler) as devices,
            pytest.raises(ConfigError, match="rehearsed 11 mm higher"),
        ):
            prepare(rig, plan, limits_for(rig, plan), load_scene("TIHA"), devices, 0)
    assert not board_world.tip.moving(board_world.clock.now())


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
        if getattr(event, "phase", None) == "indenting":
            device.fail("drop")

    return look
