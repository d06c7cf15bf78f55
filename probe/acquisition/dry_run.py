"""What can be known before anything moves: reach, limits, time, disk, calibration, visibility.

Nothing is opened and nothing is sent to a device.
"""

import math
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from calibration import use
from calibration.errors import CalibrationError
from drivers import ConfigError, Sensor, SimulatedClock
from drivers.core.extras import needs
from drivers.core.registry import Kind
from probe.acquisition.force_limit import SensorGuard
from probe.acquisition.prepare import prepare
from probe.config.calibrated import calibrated, named
from probe.config.devices import Devices, World, check_names, make_device
from probe.config.rig import Device, Rig, RigError
from probe.config.scan_plan import limits_for, plan_for
from probe.detection.sensitivity import in_words, visibility
from probe.planning.limits import Limits
from probe.planning.plan import Plan
from sim_backend.phantom.phantom import Respond
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.slicing import section_at
from sim_backend.scene.waves import load_wave

DISK_RESERVE = 2.0
USUAL_BEAT_HZ = 1.2
WEAK_PULSE_PA = 1300.0  # the 5 % weakest of measured radial pulses, peak to peak
# (rms noise N, rate Hz) of sensors whose rig settings do not say, from makers and measurements.
KNOWN_NOISE = {"ft300": (0.1, 100.0), "ur": (0.5, 500.0), "netft": (6.25e-3, 1000.0)}
VIRTUAL_NOISE = (0.5e-3, 500.0)


@dataclass(frozen=True)
class Check:
    """One thing looked at; a ``fault`` would stop the scan, a ``warning`` would spoil it."""

    name: str
    level: Literal["ok", "warning", "fault"]
    text: str


@dataclass(frozen=True)
class DryRun:
    """All checks, the scan's duration [s] and the run file's size [bytes]."""

    checks: tuple[Check, ...]
    seconds: float
    size_bytes: float

    @property
    def can_scan(self) -> bool:
        """No check found a fault."""
        return all(check.level != "fault" for check in self.checks)

    def as_json(self) -> dict[str, Any]:
        """JSON-able, with the checks in order."""
        return asdict(self) | {"can_scan": self.can_scan}


def dry_run(rig: Rig, scene: Scene | None, out: Path, respond: Respond | None = None) -> DryRun:
    """Check a rig file's scan against its limits, the disk of ``out`` and the sensors' noise.

    With a ``scene`` and ``respond`` the expected pulse is solved for the station nearest to an
    artery; without, the weakest measured radial pulses are taken.
    """
    plan = plan_for(rig)
    seconds = scan_seconds(plan)
    rates = [known_noise(device)[1] for device in rig.sensor]
    size_bytes = 1.3 * seconds * (sum(24 * rate for rate in rates) + 32 * 125)
    checks = [
        _reach(rig, plan),
        *device_checks(rig, plan, scene, respond),
        Check("time", "ok", f"{len(plan.places)} presses in about {seconds:.0f} s"),
        _disk(out, size_bytes),
        *(_calibration(key, Path(file)) for key, file in rig.calibration.items()),
    ]
    if not rig.calibration:
        checks.append(Check("calibration", "warning", "none named: forces are the sensors' own"))
    pulse_n, source = expected_pulse(rig, scene, respond)
    beat_hz = scene.pulse.rate_bpm / 60 if scene is not None else USUAL_BEAT_HZ
    checks += [
        pulse_check(f"pulse on {device.driver}", *known_noise(device), plan.hold_s, beat_hz,
                    pulse_n, source)
        for device in rig.sensor
    ]  # fmt: skip
    return DryRun(tuple(checks), seconds, size_bytes)


def scan_seconds(plan: Plan) -> float:
    """How long the scan takes, without the stage's acceleration."""
    height = plan.travel_z_m
    drops = sum(height - plan.at_surface(place).z for place in plan.places)
    ways = sum(math.dist((a.x_m, a.y_m), (b.x_m, b.y_m)) for a, b in pairwise(plan.places))
    lifts = drops + len(plan.places) * plan.indentation_m
    each_s = plan.settle_s + plan.ramp_s + plan.hold_s
    moves_s = (ways + lifts) / plan.travel_m_s + drops / plan.approach_m_s
    return moves_s + len(plan.places) * each_s


def draw_path(rig: Rig, file: Path) -> None:
    """A picture of the tip's way: from the side and, for grids, from above."""
    with needs("report", "the picture of the probe's way"):
        from matplotlib.figure import Figure

    plan, box = plan_for(rig), rig.safety.workspace_mm
    points = [
        (1e3 * pose.x, 1e3 * pose.y, 1e3 * (pose.z - depth))
        for place in plan.places
        for pose, depth in (
            (plan.above(place), 0.0),
            (plan.at_surface(place), plan.indentation_m),
            (plan.above(place), 0.0),
        )
    ]
    x, y, z = np.array(points).T
    figure = Figure(figsize=(8, 6), layout="constrained")
    side, top = figure.subplots(2, 1)
    side.plot(x, z, lw=1, label="tip")
    surface = [1e3 * plan.at_surface(place).z for place in plan.places]
    side.plot([1e3 * p.x_m for p in plan.places], surface, "k.-", lw=0.5, label="surface")
    side.set(xlabel="x [mm]", ylabel="z [mm]", title="from the side")
    side.legend(loc="upper right")
    top.plot(x, y, "o-", ms=3, lw=1)
    top.set(xlabel="x [mm]", ylabel="y [mm]", title="from above, with the workspace")
    top.plot(
        [box.x[0], box.x[1], box.x[1], box.x[0], box.x[0]],
        [box.y[0], box.y[0], box.y[1], box.y[1], box.y[0]],
        "r--", lw=1,
    )  # fmt: skip
    figure.savefig(file, dpi=120)


def _reach(rig: Rig, plan: Plan) -> Check:
    """The rig file was refused if a station were out of reach; here is what was allowed."""
    limits = limits_for(rig, plan)
    return Check(
        "reach and limits",
        "ok",
        f"all stations in the workspace; at most "
        f"{1e3 * limits.max_depth_m:g} mm deep, {1e3 * limits.max_speed_m_s:g} mm/s",
    )


def device_checks(
    rig: Rig, plan: Plan, scene: Scene | None, respond: Respond | None = None
) -> list[Check]:
    """Every device is made but not connected: driver, library, settings, scene, calibrations."""
    world = World(rig, plan, SimulatedClock(), scene, 0, respond)
    checks: list[Check] = []
    stage = _made(checks, "stages", "stage", rig.stage, world)
    sensors = [
        _made(checks, "sensors", f"sensor[{n}]", one, world) for n, one in enumerate(rig.sensor)
    ]
    if None in sensors:
        return checks
    limits = limits_for(rig, plan)
    face_mm2 = rig.face_mm2 or (scene.face_mm2 if scene is not None else None)
    face_m2 = None if face_mm2 is None else 1e-6 * face_mm2
    checks.append(_force_limit(sensors, replace(limits, face_m2=face_m2)))
    if stage is None:
        return checks
    try:
        check_names(sensors)
        stage, true, _ = calibrated(stage, sensors, rig.calibration)
        prepared = prepare(rig, plan, limits, scene, Devices(stage, true, world.phantom, ()), 0)
    except (ConfigError, RigError, CalibrationError) as error:
        return [*checks, Check("devices together", "fault", str(error))]
    return checks + [Check("rehearsal", "warning", note) for note in prepared.notes]


def _force_limit(sensors: Sequence[Sensor], limits: Limits) -> Check:
    """Whether ``max_force_n`` holds a sensor; pressures are forces only over a known face."""
    if any(SensorGuard(sensor.channels, limits).feels for sensor in sensors):
        return Check("force limit", "ok", f"at most {limits.max_force_n:g} N")
    text = (
        f"max_force_n = {limits.max_force_n:g} would hold nothing: no sensor of force, and none "
        "of pressure over a known face; add one, or say face_mm2 = 100"
    )
    return Check("force limit", "fault", text)


def _made(checks: list[Check], kind: Kind, where: str, device: Device, world: World) -> Any:
    """The device, with a check of it appended; None if it cannot be made."""
    try:
        made = make_device(kind, where, device, world, {})
    except (ConfigError, RigError, SceneError, ImportError) as error:
        checks.append(Check(where, "fault", str(error).removeprefix(f"{where}.")))
        return None
    checks.append(
        Check(where, "ok", f"driver {device.driver} is installed and its settings are right")
    )
    return made


def _disk(out: Path, size_bytes: float) -> Check:
    folder = next(p for p in (out.resolve(), *out.resolve().parents) if p.exists())
    free = shutil.disk_usage(folder).free
    level: Literal["ok", "fault"] = "ok" if free > DISK_RESERVE * size_bytes else "fault"
    return Check(
        "disk", level, f"needs {size_bytes / 1e6:.1f} MB, {folder} has {free / 1e6:.0f} MB"
    )


def _calibration(key: str, file: Path) -> Check:
    """Whether a calibration can be used, and its age by its own date."""
    name = f"calibration {key}"
    try:
        one = named(key, file)
        _, warnings = use(file, one.device)
    except CalibrationError as error:
        return Check(name, "fault", str(error))
    if warnings:
        return Check(name, "warning", "; ".join(warnings))
    days = (datetime.now(UTC) - one.date_utc).total_seconds() / 86400
    return Check(name, "ok", f"of {one.device}, {days:.1f} of {one.valid_days:g} days old")


def expected_pulse(
    rig: Rig, scene: Scene | None, respond: Respond | None
) -> tuple[float | None, str]:
    """Peak-to-peak force [N] of the pulse, and where the figure comes from."""
    if scene is not None and respond is not None:
        return _solved_pulse(plan_for(rig), scene, respond)
    if rig.face_mm2 is None:
        return None, "no scene and no face_mm2"
    return 1e-6 * rig.face_mm2 * WEAK_PULSE_PA, "the weakest 5 % of radial pulses"


def _solved_pulse(plan: Plan, scene: Scene, respond: Respond) -> tuple[float | None, str]:
    if not scene.arteries:
        return None, f"scene {scene.name} has no artery"
    artery_m = 1e-3 * scene.arteries[0].x_mm
    place = min(plan.places, key=lambda p: abs(p.x_m - artery_m))
    wave = load_wave(scene.pulse)
    beat = wave.pressure_pa(np.linspace(0, wave.period_s, 200))
    section = respond(section_at(scene, 1e3 * place.y_m), place.x_m, plan.indentation_m)
    depth = np.full(2, plan.indentation_m)
    low, high = section.force_n(depth, np.array([beat.min(), beat.max()]))
    return float(high - low), f"scene {scene.name} at x = {1e3 * place.x_m:g} mm"


def known_noise(device: Device) -> tuple[float, float]:
    """Rms noise [N] (NaN if unknown) and rate [Hz] by the rig's settings or the known table."""
    noise_n, rate_hz = KNOWN_NOISE.get(device.driver, (math.nan, 100.0))
    if device.driver == "virtual":
        noise_n, rate_hz = VIRTUAL_NOISE
    noise_n = 1e-3 * device.settings.get("noise_mn", 1e3 * noise_n)
    return float(noise_n), float(device.settings.get("rate_hz", rate_hz))


def pulse_check(
    name: str, noise_n: float, rate_hz: float, hold_s: float, beat_hz: float,
    pulse_n: float | None, source: str, face_m2: float | None = None,
) -> Check:  # fmt: skip
    """Whether a sensor sees the expected pulse in one hold."""
    if pulse_n is None:
        return Check(name, "ok", f"nothing to compare with: {source}")
    if not math.isfinite(noise_n):
        return Check(name, "warning", "this sensor's noise is not known; give noise_mn")
    seen = visibility(noise_n, rate_hz, hold_s, pulse_n, beat_hz)
    return Check(name, "ok" if seen.visible else "warning", f"{in_words(seen, face_m2)} ({source})")
