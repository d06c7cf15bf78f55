"""Every rig file that is shipped can be read, and its devices know every key in it."""

from pathlib import Path

import numpy as np
import pytest
from paths import ROOT

from drivers import Sensor, WallClock
from drivers.core.arrays import Array
from probe.checks.dry_run import dry_run
from probe.config.devices import connect
from probe.config.load_rig import load_rig
from sim_backend import load_scene
from sim_backend.emulators import modbus, taxels
from sim_backend.phantom.phantom import Phantom, Respond

RIGS = ROOT / "rigs"
NEEDS = {
    "standa_lines": "libximc", "netft": "pynetft", "ur5e": "rtde_control",
    "ur5e_ft300": "rtde_control",
}  # fmt: skip


@pytest.mark.parametrize("path", sorted(RIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_its_devices_know_every_key(path: Path, winkler: Respond) -> None:
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem])
    rig, scene = load_rig(path), load_scene("TIHA")
    with connect(rig, WallClock(), scene, fallback="virtual", respond=winkler) as devices:
        assert len(devices.sensors) == len(rig.sensor)


@pytest.mark.parametrize("path", sorted(RIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_its_scan_breaks_no_limit(path: Path, winkler: Respond, tmp_path: Path) -> None:
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem])
    report = dry_run(load_rig(path), load_scene("TIHA"), tmp_path, winkler)
    assert not [check.text for check in report.checks if check.level == "fault"]


def test_a_transmitter_and_an_array_are_read_together(winkler: Respond, tmp_path: Path) -> None:
    clock = WallClock()
    world = Phantom(load_scene("TI"), clock, winkler, home=(0.032, 0.0, -0.001))
    at = str(tmp_path / "tty")
    with modbus.emulate(world, at=at + "1") as one, taxels.emulate(world, at=at + "2") as two:
        text = (RIGS / "modbus_taxels.toml").read_text("utf-8")
        for port, served in (("23004", one), ("23005", two)):
            text = text.replace(f"socket://127.0.0.1:{port}", served.address)
        (tmp_path / "rig.toml").write_text(text, "utf-8")
        rig = load_rig(tmp_path / "rig.toml")
        with connect(rig, clock, respond=winkler) as devices:
            force_n, face_m2 = {}, 1e-6 * (rig.face_mm2 or 0.0)
            for sensor in devices.sensors:
                assert all(channel.simulated for channel in sensor.channels)
                values = read(sensor, clock, 20)
                force_n[sensor.name] = values if values.shape[1] == 1 else face_m2 * values
    pressed_n = force_n["modbus"].mean()
    assert pressed_n > 0.1
    assert force_n["taxels"].mean(axis=1).mean() == pytest.approx(pressed_n, rel=0.05)


def read(sensor: Sensor, clock: WallClock, count: int) -> Array:
    """At least ``count`` readings, however long a busy machine takes."""
    sensor.connect()
    sensor.start()
    found: list[Array] = []
    while sum(map(len, found)) < count:
        clock.sleep_until(clock.now() + 0.02)
        found.append(sensor.read().values)
    sensor.stop()
    return np.concatenate(found)
