"""Is this machine, and is this rig, fit for a scan? Nothing is moved."""

import importlib
import math
import platform
import sqlite3
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drivers import Clock, ConfigError, DeviceFault, Sensor, available, find_driver
from drivers.registry import Kind
from probe.devices import Devices
from probe.dryrun import Check

LISTEN_S = 2.0
KINDS: tuple[Kind, ...] = ("stages", "sensors")


@dataclass(frozen=True)
class Noise:
    """A channel of an unloaded sensor: its noise's standard deviation about a straight line.

    ``rate_hz`` is as measured; ``step`` is the smallest difference between readings (0: none
    seen). In the channel's ``unit``.
    """

    sensor: str
    channel: str
    unit: str
    role: str
    rate_hz: float
    std: float
    step: float
    simulated: bool


def machine() -> Iterator[Check]:
    """What this computer has: Python, SQLite, windows, drivers."""
    yield Check("python", "ok", f"{platform.python_version()} ({sys.executable})")
    yield Check("sqlite", "ok", sqlite3.sqlite_version)
    try:
        importlib.import_module("PySide6.QtWidgets")
        yield Check("windows", "ok", "Qt is there")
    except ImportError as error:
        yield Check("windows", "warning", f"palpate live, replay and feel cannot open: {error}")
    for kind in KINDS:
        for name in available(kind):
            try:
                find_driver(kind, name)
            except (ConfigError, ImportError) as error:
                yield Check(f"{kind}: {name}", "warning", str(error))
            else:
                yield Check(f"{kind}: {name}", "ok", "installed")


def listen(devices: Devices, clock: Clock, seconds: float = LISTEN_S) -> Iterator[Check | Noise]:
    """Read the pose once and every sensor for ``seconds`` on the scan's clock; move nothing."""
    try:
        x, y, z = (1e3 * at for at in devices.stage.pose()[:3])
        yield Check(f"stage {devices.stage.name}", "ok", f"at {x:.2f}, {y:.2f}, {z:.2f} mm")
    except DeviceFault as fault:
        yield Check(f"stage {devices.stage.name}", "fault", str(fault))
    for sensor in devices.sensors:
        try:
            yield from _listen_to(sensor, clock, seconds)
        except DeviceFault as fault:
            yield Check(f"sensor {sensor.name}", "fault", str(fault))


def _listen_to(sensor: Sensor, clock: Clock, seconds: float) -> Iterator[Check | Noise]:
    sensor.start()
    times, values, lost = [], [], 0
    until_s = clock.now() + seconds
    try:
        while clock.now() < until_s:
            clock.sleep_until(min(clock.now() + 0.02, until_s))
            block = sensor.read()
            times.append(block.time_s)
            values.append(block.values)
            lost += block.lost
    finally:
        sensor.stop()
    time_s, readings = np.concatenate(times), np.concatenate(values)
    name = f"sensor {sensor.name}"
    if len(time_s) < 10:
        yield Check(name, "fault", f"{len(time_s)} samples in {seconds:g} s")
        return
    rate_hz = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    slow = rate_hz < 0.95 * sensor.rate_hz
    text = f"{rate_hz:.1f} Hz of {sensor.rate_hz:g} Hz, {lost} samples lost"
    yield Check(name, "warning" if slow or lost else "ok", text)
    for n, channel in enumerate(sensor.channels):
        std, step = _spread(time_s, readings[:, n])
        yield Noise(
            sensor.name, channel.name, channel.unit, channel.role, rate_hz, std, step,
            channel.simulated,
        )  # fmt: skip


def _spread(time_s: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Standard deviation about the straight line, and the smallest step between readings."""
    if not np.isfinite(values).all():
        return math.nan, 0.0
    rest = values - np.polynomial.Polynomial.fit(time_s, values, 1)(time_s)
    steps = np.diff(np.unique(values))
    return float(np.std(rest, ddof=2)), float(steps.min()) if len(steps) else 0.0
