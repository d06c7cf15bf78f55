"""One thousand random byte-level corruptions of every serial and Modbus sensor, over live lines.

    python benchmarks/corruption.py [CORRUPTIONS]

Each sensor reads an emulated device whose every answer is damaged (a byte changed, lost, added,
doubled, a burst). The force is constant and known, so a wrong number shows. All run at once, until
the last one has had its corruptions; Modbus waits after each, and takes some three minutes. The
table is kept in `docs/results/corruption.csv` (delete it to measure anew).
"""

import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from importlib import import_module

import numpy as np
from kept import ROOT, Row, fill, read

from drivers import DeviceFault, WallClock, ft300, lines, modbus, taxels
from drivers.core.reader import LineSensor
from drivers.lines import TextChannel
from drivers.modbus import Register
from sim_backend import emulators, load_scene
from sim_backend.emulators.serving import Served
from sim_backend.models.station_response import respond
from sim_backend.phantom.phantom import Phantom

OUT = ROOT / "docs" / "results" / "corruption.csv"
ANSWERS = ("check sum", "corruptions", "read right", "read wrong", "lost", "faults", "crashes")
TCP = "socket://127.0.0.1:0"
PRESSED = (0.032, 0.0, -0.001)
REGISTERS = [Register(name="force", address=100, unit="N", type="int32", scale=1e-3, role="force")]
PRINTED = r"(?P<time>[0-9]+) (?P<force>[-+0-9.eE]+) N"
Emulate = Callable[[Phantom], AbstractContextManager[Served]]
Open = Callable[[WallClock, str], LineSensor]


@dataclass
class Tally:
    """``wrong`` rows differ from what the device measured; ``crashes`` are not of the line."""

    corruptions: int = 0
    right: int = 0
    wrong: int = 0
    lost: int = 0
    faults: int = 0
    crashes: int = 0


def trial(emulate: Emulate, open_sensor: Open, corruptions: int) -> Tally:
    """One sensor: a clean second gives the truth, then every answer is damaged."""
    clock, tally = WallClock(), Tally()
    phantom = Phantom(load_scene("TI"), clock, respond, home=PRESSED)
    phantom.prepare([PRESSED[:2]])
    with emulate(phantom) as served:
        sensor = open_sensor(clock, served.address)
        truth = clean_row(sensor)
        served.fail("noise")
        while served.spoilt < corruptions:
            try:
                sensor.connect()
                sensor.start()
                while served.spoilt < corruptions:
                    count(sensor, truth, tally)
                    time.sleep(0.01)
            except DeviceFault as fault:
                tally.faults += 1
                tally.crashes += fault.reason.startswith("driver:")
                sensor.close()
        sensor.close()
        tally.corruptions = served.spoilt
    return tally


def clean_row(sensor: LineSensor) -> np.ndarray:
    """The one row that a sensor without noise reads."""
    sensor.connect()
    sensor.start()
    time.sleep(0.5)
    values = sensor.read().values
    assert len(values), "nothing was read on a clean line"
    assert (values == values[0]).all(), "the load is not constant"
    return np.asarray(values[0])


def count(sensor: LineSensor, truth: np.ndarray, tally: Tally) -> None:
    """Read once."""
    block = sensor.read()
    same = (block.values == truth).all(axis=1)
    tally.right += int(same.sum())
    tally.wrong += int((~same).sum())
    tally.lost += block.lost


def serve_tcp(name: str, **keys: object) -> Emulate:
    """An emulator of that name on loopback."""
    module = import_module(f"{emulators.__name__}.{name}")
    return lambda phantom: module.emulate(phantom, at=TCP, **keys)


def open_modbus_tcp(clock: WallClock, address: str) -> LineSensor:
    """The TCP framing on the emulator's port."""
    port = int(address.rpartition(":")[2])
    return modbus.open_sensor(
        clock,
        modbus.ModbusSettings(host="127.0.0.1", tcp_port=port, register=REGISTERS, timeout_ms=20),
    )


TRIALS: dict[str, tuple[str, Emulate, Open]] = {
    "FT-300 stream": (
        "CRC-16",
        serve_tcp("ft300", noise_n=0.0),
        lambda clock, port: ft300.open_sensor(clock, ft300.Ft300Settings(port=port)),
    ),
    "FT-300 polled": (
        "CRC-16",
        serve_tcp("ft300", noise_n=0.0),
        lambda clock, port: ft300.open_sensor(clock, ft300.Ft300Settings(port=port, mode="poll")),
    ),
    "Modbus RTU": (
        "CRC-16",
        serve_tcp("modbus"),
        lambda clock, port: modbus.open_sensor(
            clock, modbus.ModbusSettings(port=port, register=REGISTERS, timeout_ms=20)
        ),
    ),
    "Modbus TCP": ("none but TCP's", serve_tcp("modbus", framing="tcp"), open_modbus_tcp),
    "taxels": (
        "CRC-16",
        serve_tcp("taxels", noise_pa=0.0),
        lambda clock, port: taxels.open_sensor(
            clock, port=port, rows=4, columns=7, header="AA55", rate_hz=100.0, counter=True,
            check="crc16-modbus", scale=10.0,
        ),
    ),
    "text lines": (
        "none",
        serve_tcp("lines", noise_n=0.0),
        lambda clock, port: lines.open_sensor(
            clock, port=port, pattern=PRINTED, rate_hz=80.0, time_unit_s=1e-3,
            channel=[TextChannel(name="force", unit="N", role="force")],
        ),
    ),
}  # fmt: skip


def main(corruptions: int) -> None:
    """Run all trials at once, keep and print the table."""
    with ThreadPoolExecutor(len(TRIALS)) as pool:
        running = {
            name: pool.submit(partial(trial, emulate, open_sensor, corruptions))
            for name, (_, emulate, open_sensor) in TRIALS.items()
        }
        fill(OUT, ("sensor",), ANSWERS, [(name,) for name in TRIALS],
             lambda name: row(TRIALS[name][0], running[name].result()))  # fmt: skip
    for one in read(OUT):
        print(", ".join(f"{key} {value}" for key, value in one.items()))


def row(check: str, tally: Tally) -> Row:
    """What is kept of a sensor."""
    counted = (tally.corruptions, tally.right, tally.wrong, tally.lost, tally.faults, tally.crashes)
    return dict(zip(ANSWERS, (check, *counted), strict=True))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
