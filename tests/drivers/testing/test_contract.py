"""Every driver of this package keeps the contract that third-party drivers are held to."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from emulated_devices import ARRAY, PRINTED, REGISTER
from makers_peers import RATE_HZ, lsl_stream

from drivers import WallClock
from drivers.testing.contract import Bench
from drivers.testing.contract_tests import *  # noqa: F403 - the tests and their fixtures
from sim_backend import load_scene
from sim_backend.emulators import ft300, grbl, lines, modbus, netft, pi, taxels, tmcl, ur, zaber
from sim_backend.phantom.phantom import Phantom, Respond

_hosts = count(1)

Make = Callable[[Phantom, WallClock, Path], AbstractContextManager[Bench]]


@contextmanager
def on_a_line(
    name: str, emulate: Callable[..., Any], at: str, settings: dict[str, Any],
    phantom: Phantom, clock: WallClock, folder: Path,
) -> Iterator[Bench]:  # fmt: skip
    place = str(folder / "tty") if at == "pty" else "socket://127.0.0.1:0"
    with emulate(phantom, at=place) as served:
        yield Bench(
            name,
            {"port": served.address, **settings},
            unplug=partial(served.fail, "drop"),
            replug=partial(served.fail, None),
            clock=clock,
        )


@contextmanager
def modbus_tcp(phantom: Phantom, clock: WallClock, _folder: Path) -> Iterator[Bench]:
    with modbus.emulate(phantom, at="socket://127.0.0.1:0", framing="tcp") as served:
        port = int(served.address.rpartition(":")[2])
        settings = {"host": "127.0.0.1", "tcp_port": port, "register": [REGISTER]}
        unplug, replug = partial(served.fail, "drop"), partial(served.fail, None)
        yield Bench("modbus", settings, unplug, replug, clock=clock)


@contextmanager
def net_ft(phantom: Phantom, clock: WallClock, _folder: Path) -> Iterator[Bench]:
    pytest.importorskip("pynetft")
    with netft.emulate(phantom, rdt_port=0, http_port=0) as box:
        ports = {"rdt_port": box.rdt_port, "http_port": box.http_port}
        settings = {"host": box.host, **ports, "silence_s": 2.0}
        unplug, replug = partial(box.fail, "drop"), partial(box.fail, None)
        yield Bench("netft", settings, unplug, replug, clock=clock)


@contextmanager
def lsl(phantom: Phantom, clock: WallClock, _folder: Path) -> Iterator[Bench]:
    pytest.importorskip("pylsl", reason="the extra `lsl` is not installed")
    with lsl_stream(phantom) as stream:
        settings = {"stream": stream.name, "rate_hz": RATE_HZ, "channel": [PRINTED["channel"][0]]}
        yield Bench("lsl", settings, partial(stream.fail, "drop"), clock=clock)


@contextmanager
def standa(_phantom: Phantom, clock: WallClock, folder: Path) -> Iterator[Bench]:
    pytest.importorskip("libximc.highlevel")
    uris = {f"{axis}_uri": f"xi-emu:///{folder}/{axis}.bin" for axis in "xz"}
    yield Bench("standa", uris, clock=clock)


@contextmanager
def virtual(phantom: Phantom, clock: WallClock, _folder: Path) -> Iterator[Bench]:
    yield Bench("virtual", {"phantom": phantom}, connected=False, clock=clock)


@contextmanager
def on_a_robot(
    settings: dict[str, Any], phantom: Phantom, clock: WallClock, _folder: Path
) -> Iterator[Bench]:
    pytest.importorskip("rtde_control")
    host = f"127.{1 + os.getpid() % 250}.{os.getpid() // 250 % 250}.{next(_hosts)}"
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(2e-4)  # as a scan does: this robot lives in the same interpreter
    try:
        with ur.emulate(phantom, at=host) as robot:
            # ... and beside other tests, which may hold it up; silence has tests of its own
            unplug, replug = partial(robot.fail, "drop"), partial(robot.fail, None)
            yield Bench(
                "ur", {"host": host, "silence_s": 2.0, **settings}, unplug, replug, clock=clock
            )
    finally:
        sys.setswitchinterval(before_s)


BOARD = {"origin_mm": grbl.ORIGIN_MM}
PATIENT = dict.fromkeys(("answer_s", "stop_s", "watchdog_s"), 2.0)  # limits have their own tests
homed = partial(grbl.emulate, homed=True)


def axes_of(emulator: Any) -> dict[str, Any]:
    """The rig file's keys of an emulated stage on a line."""
    return {**emulator.RIG_AXES, "origin_mm": emulator.RIG_ORIGIN_MM, "silent_s": 2.0}


STAGES: dict[str, Make] = {
    "virtual": virtual,
    "standa": standa,
    "grbl": partial(on_a_line, "grbl", homed, "pty", BOARD),
    "grbl over tcp": partial(on_a_line, "grbl", homed, "tcp", BOARD),
    "zaber": partial(on_a_line, "zaber", partial(zaber.emulate, homed=True), "pty", axes_of(zaber)),
    "pi": partial(on_a_line, "pi", partial(pi.emulate, homed=True), "tcp", axes_of(pi)),
    "tmcl": partial(on_a_line, "tmcl", partial(tmcl.emulate, homed=True), "pty", axes_of(tmcl)),
    "ur": partial(on_a_robot, {"origin_mm": (400.0, -20.0, 150.0), **PATIENT}),
}
SENSORS: dict[str, Make] = {
    "virtual": virtual,
    "ft300": partial(on_a_line, "ft300", ft300.emulate, "pty", {}),
    "ft300 polled": partial(on_a_line, "ft300", ft300.emulate, "pty", {"mode": "poll"}),
    "modbus rtu": partial(on_a_line, "modbus", modbus.emulate, "pty", {"register": [REGISTER]}),
    "modbus tcp": modbus_tcp,
    "netft": net_ft,
    "lines": partial(on_a_line, "lines", lines.emulate, "tcp", PRINTED),
    "taxels": partial(on_a_line, "taxels", taxels.emulate, "pty", ARRAY),
    "lsl": lsl,
    "ur": partial(on_a_robot, {}),
}


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    benches = STAGES if metafunc.function.__name__.startswith("test_stage") else SENSORS
    metafunc.parametrize("palpate_bench", benches.values(), ids=list(benches), indirect=True)


@pytest.fixture
def palpate_bench(
    request: pytest.FixtureRequest, winkler: Respond, tmp_path: Path
) -> Iterator[Bench]:
    clock = WallClock()
    phantom = Phantom(load_scene("TIHA"), clock, winkler, home=(0.032, 0.0, 0.002))
    with request.param(phantom, clock, tmp_path) as bench:
        yield bench
