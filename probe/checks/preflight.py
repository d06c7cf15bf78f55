"""Checks of a rig's devices before a scan, shared by ``doctor``, ``plan`` and ``scan --dry-run``.

Nothing is opened and nothing is sent to a device.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from calibration import use
from calibration.errors import CalibrationError
from drivers import Clock, ConfigError, DeviceFault, Sensor, SimulatedClock, Stage
from drivers.core.registry import Kind
from probe.config.calibrated import calibrated, named, owner
from probe.config.devices import Devices, World, check_names, check_units, make_device
from probe.config.rig import Device, Rig, RigError
from probe.config.scan_limits import limits_for
from probe.config.snapshot import face_mm2_of
from probe.core.contact_stress import square_metres
from probe.guards.force_limit import SensorGuard
from probe.guards.force_speed import most_n
from probe.guards.prepare import prepare
from probe.planning.limits import Limits
from probe.planning.plan import Plan
from sim_backend.phantom.devices import VirtualSensor
from sim_backend.phantom.phantom import Respond
from sim_backend.scene.scene_file import Scene, SceneError

TOGETHER = "devices together"
REST_S = 2.0  # at 500 Hz ten times the equal readings that are a stuck sensor's (`same_readings`)


@dataclass(frozen=True)
class Check:
    """One thing looked at; a ``fault`` would stop the scan, a ``warning`` would spoil it."""

    name: str
    level: Literal["ok", "warning", "fault"]
    text: str


def device_checks(
    rig: Rig, plan: Plan, scene: Scene | None, respond: Respond | None = None
) -> tuple[list[Check], Stage | None, list[Sensor]]:
    """Every device is made but not connected: driver, library, settings, scene, calibrations.

    With what was found, the stage where every device could be made, and the sensors that could.
    """
    world = World(rig, plan, SimulatedClock(), scene, 0, respond)
    checks: list[Check] = []
    if rig.real and "stage" not in rig.model_fields_set:
        text = "[stage] is missing: a simulated one moves instead, and no force comes of it"
        checks.append(Check("rig", "warning", text))
    stage = _made(checks, "stages", "stage", rig.stage, world)
    every = [
        _made(checks, "sensors", f"sensor[{n}]", one, world) for n, one in enumerate(rig.sensor)
    ]
    sensors = [one for one in every if one is not None]
    if len(sensors) < len(every):
        return checks, None, sensors
    face_m2 = square_metres(face_mm2_of(rig, scene))
    limits = replace(limits_for(rig, plan), face_m2=face_m2)
    checks.append(_force_limit(sensors, limits))
    if stage is None:
        return checks, None, sensors
    try:
        check_names(sensors)
        moved, true, _ = calibrated(stage, sensors, rig.calibration)
        check_units(true)
        prepared = prepare(rig, plan, limits, scene, Devices(moved, true, world.phantom, ()), 0)
    except (ConfigError, RigError, CalibrationError) as error:
        return [*checks, Check(TOGETHER, "fault", str(error))], stage, sensors
    checks += [Check("note", "warning", note) for note in prepared.notes]
    if rig.stage.driver == "virtual":
        virtual = (sensor for sensor in sensors if isinstance(sensor, VirtualSensor))
        checks += [check for sensor in virtual for check in _at_rest(sensor, world.clock, limits)]
    return checks, stage, sensors


def _at_rest(sensor: VirtualSensor, clock: Clock, limits: Limits) -> Iterator[Check]:
    """What would end a scan before its first press."""
    sensor.start()
    clock.sleep_until(clock.now() + REST_S)
    if (why := SensorGuard(sensor.channels, limits).check(sensor.read())) is not None:
        yield Check(f"sensor {sensor.name}", "fault", f"at rest in the air: {why}")


def calibration_check(
    key: str, file: Path, stage: Stage | None, sensors: Sequence[Sensor]
) -> Check:
    """Whether a calibration can be used with these devices, and its age by its own date.

    Without a ``stage`` not every device is known, and whose it is remains open.
    """
    name = f"calibration {key}"
    try:
        one = named(key, file)
        if stage is not None:
            owner(key, file, stage.name, [sensor.name for sensor in sensors])
        _, warnings = use(file, one.device)
    except CalibrationError as error:
        return Check(name, "fault", str(error))
    if warnings:
        return Check(name, "warning", "; ".join(warnings))
    days = (datetime.now(UTC) - one.date_utc).total_seconds() / 86400
    return Check(name, "ok", f"of {one.device}, {days:.1f} days old, meant for {one.valid_days:g}")


def _force_limit(sensors: Sequence[Sensor], limits: Limits) -> Check:
    """Whether ``max_force_n`` holds a sensor, and one can read so much; pressures are forces only
    over a known face."""
    limit_n = limits.max_force_n
    feeling = [one for one in sensors if SensorGuard(one.channels, limits).feels]
    if not feeling:
        text = (
            f"max_force_n = {limit_n:g} would hold nothing: no sensor of force, and none "
            "of pressure over a known face; add one, or say face_mm2 = 100"
        )
        return Check("force limit", "fault", text)
    full_n, name = max((most_n(one, limits.face_m2), one.name) for one in feeling)
    if limit_n > full_n:
        text = (
            f"safety.max_force_n = {limit_n:g}: {name} reads up to {full_n:.3g} N, and no force "
            "beyond is ever seen; allow less, 5 is usual"
        )
        return Check("force limit", "warning", text)
    return Check("force limit", "ok", f"at most {limit_n:g} N")


def _made(checks: list[Check], kind: Kind, where: str, device: Device, world: World) -> Any:
    """The device, with a check of it appended; None if it cannot be made."""
    try:
        made = make_device(kind, where, device, world, {})
    except (ConfigError, DeviceFault, RigError, SceneError) as error:
        checks.append(Check(where, "fault", str(error).removeprefix(f"{where}.")))
        return None
    checks.append(
        Check(where, "ok", f"driver {device.driver} is installed and its settings are right")
    )
    return made
