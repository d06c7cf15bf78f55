"""A scan checked without moving: reach, limits, time, disk, calibration, sensitivity.

Nothing is opened and nothing is sent to a device.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from drivers import available
from probe.checks.expected_press import known_noise, pulse_checks
from probe.checks.preflight import Check, calibration_check, device_checks
from probe.checks.run_size import room, run_bytes, scan_seconds, search_seconds
from probe.checks.unusual import unusual
from probe.config.rig import RASTER, Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import beside_the_block, plan_for
from probe.guards.force_speed import slowed
from probe.planning.limits import ARRIVED_M
from probe.planning.plan import Plan
from sim_backend.phantom.phantom import Respond
from sim_backend.scene.scene_file import Scene


@dataclass(frozen=True)
class DryRun:
    """All checks, the scan's duration [s] (see `scan_seconds`) and the run file's size [bytes]."""

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
    """Check a rig file's scan against its limits, the disk of ``out`` and the sensors' noise."""
    plan = plan_for(rig)
    known = available("sensors")
    noises = [known_noise(device) for device in rig.sensor if device.driver in known]
    of_devices, stage, sensors = device_checks(rig, plan, scene, respond)
    if not any(check.level == "fault" for check in of_devices):
        plan, _ = slowed(plan, limits_for(rig, plan), sensors)
    seconds, search_s = scan_seconds(plan), search_seconds(plan)
    size_bytes = run_bytes(plan, sensors)
    checks = [
        _reach(rig, plan),
        *_too_shallow(plan),
        *unusual(rig, scene),
        *_beside(rig, plan, scene),
        *of_devices,
        Check("time", "ok", _time_words(rig, len(plan.places), seconds, search_s)),
        _disk(out, size_bytes),
        *(
            calibration_check(key, Path(file), stage, sensors)
            for key, file in rig.calibration.items()
        ),
    ]
    if not rig.calibration:
        checks.append(Check("calibration", "warning", "none named: forces are the sensors' own"))
    if not any(check.name == "scene" and check.level == "fault" for check in checks):
        checks += pulse_checks(rig, scene, respond, noises)  # beside a block none can be solved
    return DryRun(tuple(checks), seconds, size_bytes)


def _time_words(rig: Rig, presses: int, seconds: float, search_s: float) -> str:
    ends = rig.scan.planner == RASTER and rig.scan.force_n is None
    at_most = "" if ends else "at most "
    count = f"{at_most}{presses} press{'es' * (presses != 1)}"
    text = f"{count} in {at_most or 'about '}{seconds:.0f} s from above the first station on"
    if search_s:
        text += f", and up to {search_s:.0f} s more where the surface lies deeper than planned"
    return text


def _reach(rig: Rig, plan: Plan) -> Check:
    """The rig file was refused if a station were out of reach; here is what was allowed."""
    limits = limits_for(rig, plan)
    return Check(
        "reach and limits",
        "ok",
        f"all stations in the workspace; at most "
        f"{1e3 * limits.max_depth_m:g} mm deep, {1e3 * limits.max_speed_m_s:g} mm/s",
    )


def _too_shallow(plan: Plan) -> Iterator[Check]:
    """A warning for a press that a stage may take for none; metres given for millimetres are."""
    if plan.indentation_m < ARRIVED_M:
        yield Check(
            "indentation",
            "warning",
            f"scan.indentation_mm = {1e3 * plan.indentation_m:g}: a stage that is within "
            f"{1e3 * ARRIVED_M:g} mm of where it was sent has arrived, so that such a press may "
            "not be made at all; the key is in millimetres, 2.5 is usual",
        )


def _beside(rig: Rig, plan: Plan, scene: Scene | None) -> Iterator[Check]:
    """A fault for a simulated press beside the scene's block, and a warning for each thing in the
    scene that no station presses over."""
    simulated = scene if rig.stage.driver == "virtual" else None
    if simulated is not None and (why := beside_the_block(plan, simulated)) is not None:
        yield Check("scene", "fault", why)
    x_mm = [1e3 * place.x_m for place in plan.places]
    for one in () if scene is None else scene.inclusion:
        path_mm = [x for _, x, _ in getattr(one, "path", ())] or [one.x_mm]
        if max(path_mm) < min(x_mm) or min(path_mm) > max(x_mm):
            yield Check(
                "scene",
                "warning",
                f"the stations reach from x = {min(x_mm):g} to {max(x_mm):g} mm; the {one.kind} at "
                f"x = {path_mm[0]:g} mm lies beside them: change scan.start_mm or scan.stations",
            )


def _disk(out: Path, size_bytes: float) -> Check:
    return Check("disk", *room(out, size_bytes))
