"""Every rig file that is shipped can be read, and its devices know every key in it."""

from pathlib import Path

import pytest
from paths import ROOT

from drivers import WallClock
from probe.acquisition.engine import run_scan
from probe.config.devices import connect
from probe.config.load_rig import load_rig
from probe.config.scan_plan import limits_for, plan_for
from probe.core.events import Event, Finish, RunStarted, Samples
from sim_backend import load_scene
from sim_backend.emulators import modbus, taxels
from sim_backend.phantom.phantom import Phantom, Respond

RIGS = ROOT / "rigs"
NEEDS = {"standa_lines": "libximc", "netft": "pynetft"}


@pytest.mark.parametrize("path", sorted(RIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_its_devices_know_every_key(path: Path, winkler: Respond) -> None:
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem])
    rig, scene = load_rig(path), load_scene("TIHA")
    with connect(rig, WallClock(), scene, fallback="virtual", respond=winkler) as devices:
        assert len(devices.sensors) == len(rig.sensor)


def test_a_transmitter_and_an_array_are_read_together(winkler: Respond, tmp_path: Path) -> None:
    """The rig of the file over two emulated lines, which do not move with its stage: told."""
    clock = WallClock()
    world = Phantom(load_scene("TIHA"), clock, winkler, home=(0.032, 0.0, -0.001))
    at = str(tmp_path / "tty")
    with modbus.emulate(world, at=at + "1") as one, taxels.emulate(world, at=at + "2") as two:
        text = (RIGS / "modbus_taxels.toml").read_text("utf-8")
        for port, served in (("23004", one), ("23005", two)):
            text = text.replace(f"socket://127.0.0.1:{port}", served.address)
        text = text.replace("[scan]", "[scan]\nindentation_mm = 1.0\nramp_s = 0.2\nhold_s = 0.1")
        text += "\n[safety]\nhardest_n_mm = 1.0\n" * ("[safety]" not in text)
        (tmp_path / "rig.toml").write_text(text, "utf-8")
        rig, events = load_rig(tmp_path / "rig.toml"), list[Event]()
        with connect(rig, clock, respond=winkler) as devices:
            plan = plan_for(rig)
            ended = run_scan(
                plan,
                devices.stage,
                devices.sensors,
                clock,
                events.append,
                limits_for(rig, plan),
            )
    assert ended.finish is Finish.COMPLETED or "no force above the noise" in ended.reason
    told = {e.device for e in events if isinstance(e, Samples)}
    assert told == {"stage", "modbus", "taxels"}
    (started,) = [e for e in events if isinstance(e, RunStarted)]
    assert all(c.simulated for own in started.channels.values() for c in own)
