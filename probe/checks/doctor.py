"""Is this machine, and is this rig, fit for a scan? Nothing is moved."""

import math
import platform
import sqlite3
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calibration.rounding import least_step
from drivers import Block, Clock, ConfigError, DeviceFault, Pose, Sensor, available, find_driver
from drivers.core import abilities
from drivers.core.extras import require_library
from drivers.core.registry import Kind
from probe.checks.preflight import Check
from probe.config.devices import Devices
from probe.config.rig import Rig, Workspace
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.core.screen import why_no_windows
from probe.guards.force_limit import SensorGuard
from probe.planning.limits import Limits
from sim_backend.fem import kernel

LISTEN_S = 2.0
WITHOUT_KERNEL = 3
"""Processor time of a press without the compiled kernel over that with it: 2.6 to 3.7 for presses
of TIHA in both planes and for its scan (in turn in one process, least of three to six)."""
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
    """What this computer has: Python, SQLite, windows, the kernel of the simulation, drivers."""
    yield Check("python", "ok", f"{platform.python_version()} ({sys.executable})")
    yield Check("sqlite", "ok", sqlite3.sqlite_version)
    why = why_no_windows()
    said = "they open on this screen" if why is None else why
    yield Check("windows", "ok" if why is None else "warning", said)
    if kernel.BUILT:
        yield Check("simulation", "ok", "the finite elements' kernel was compiled")
    else:
        yield Check(
            "simulation",
            "warning",
            f"simulated presses take {WITHOUT_KERNEL} times as long as they could: their kernel "
            "was not compiled. apt install gcc python3-dev, then install palpate again",
        )
    for kind in KINDS:
        for name in available(kind):
            try:
                find_driver(kind, name)
                require_library(name)
            except ConfigError as error:
                yield Check(f"{kind}: {name}", "warning", str(error))
            else:
                yield Check(f"{kind}: {name}", "ok", "installed")


def listen(
    devices: Devices, clock: Clock, rig: Rig, seconds: float = LISTEN_S
) -> Iterator[Check | Noise]:
    """Read the pose once and every sensor for ``seconds`` on the scan's clock; move nothing."""
    workspace, limits = rig.safety.workspace_mm, limits_for(rig, plan_for(rig))
    try:
        yield _pose(f"stage {devices.stage.name}", devices.stage.pose(), workspace)
    except DeviceFault as fault:
        homes = abilities.homes(devices.stage)
        text = f"{fault}; a scan homes it first" if homes else str(fault)
        yield Check(f"stage {devices.stage.name}", "warning" if homes else "fault", text)
    for sensor in devices.sensors:
        try:
            yield from _listen_to(sensor, clock, limits, seconds)
        except DeviceFault as fault:
            yield Check(f"sensor {sensor.name}", "fault", str(fault))


def _pose(name: str, pose: Pose, workspace: Workspace) -> Check:
    """Where the stage is, and whether a scan may begin there."""
    at_mm = [1e3 * at for at in pose[:3]]
    text = "at {:.2f}, {:.2f}, {:.2f} mm".format(*at_mm)
    for (axis, (low, high)), at in zip(workspace, at_mm, strict=True):
        if not low <= at <= high:
            text += (
                f": {axis} is outside the workspace, which allows {low:g} to {high:g} mm; "
                f"move it there by hand, or change safety.workspace_mm.{axis}"
            )
            return Check(name, "fault", text)
    return Check(name, "ok", text)


def _listen_to(
    sensor: Sensor, clock: Clock, limits: Limits, seconds: float
) -> Iterator[Check | Noise]:
    sensor.start()
    times, values, saturated, lost = [], [], [], 0
    until_s = clock.now() + seconds
    try:
        while clock.now() < until_s:
            clock.sleep_until(min(clock.now() + 0.02, until_s))
            block = sensor.read()
            times.append(block.time_s)
            values.append(block.values)
            saturated.append(block.saturated)
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
    heard = Block(time_s, readings, np.concatenate(saturated))
    if (why := SensorGuard(sensor.channels, limits).check(heard)) is not None:
        yield Check(name, "fault", f"at rest: {why}")
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
    return float(np.std(rest, ddof=2)), least_step(values)
