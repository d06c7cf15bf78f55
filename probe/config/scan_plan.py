"""From a rig to what the engine works with: the plan of its presses and its limits, in SI."""

from probe.config.calibrated import compliance_of, surface_of
from probe.config.rig import Heights, Rig, RigError, pair
from probe.core.contact_stress import square_metres
from probe.planning.limits import Limits
from probe.planning.plan import Plan, check_reach, grid, repeated
from probe.planning.surfaces import Surface, level, through

DEPTH_SLACK_MM = 0.5  # beyond the deepest press, where the rig file gives no limit
ROUNDING_MM = 1e-6  # as `probe.planning.plan.check_reach` allows: 0.9 mm in metres and back is more


def plan_for(rig: Rig) -> Plan:
    """The scan as stations and one press.

    Reads the calibrations of surface and compliance, so call it once. Raises `CalibrationError`,
    and `RigError` if the surface's points do not make one.

    Examples
    --------
    >>> import palpate
    >>> plan = palpate.plan_for(palpate.default_rig())
    >>> len(plan.places), plan.indentation_m
    (15, 0.0025)
    """
    scan, files = rig.scan, rig.calibration
    (x, dx, columns), (y, dy, rows) = zip(
        pair(scan.start_mm, 0.0), pair(scan.pitch_mm, 0.0), pair(scan.stations, 1), strict=True
    )
    compliance_m_per_n = compliance_of(files["compliance"]) if "compliance" in files else 0.0
    places = grid((1e-3 * x, 1e-3 * y), (1e-3 * dx, 1e-3 * dy), (int(columns), int(rows)))
    return Plan(
        places=repeated(places, scan.repeats),
        indentation_m=1e-3 * scan.indentation_mm,
        ramp_s=scan.ramp_s,
        hold_s=scan.hold_s,
        clearance_m=1e-3 * rig.safety.retract_mm,
        travel_m_s=1e-3 * scan.travel_mm_s,
        approach_m_s=1e-3 * scan.approach_mm_s,
        settle_s=scan.settle_s,
        touch_n=scan.touch_n,
        search_m=1e-3 * scan.search_mm,
        surface=(
            surface_of(files["surface"])
            if "surface" in files
            else _surface("scan.surface_mm", scan.surface_mm)
        ),
        compliance_m_per_n=compliance_m_per_n,
        max_deflection_m=compliance_m_per_n * rig.safety.max_force_n,
    )


def limits_for(rig: Rig, plan: Plan) -> Limits:
    """The safety table.

    Raises `RigError` if the plan goes deeper than it allows, and `ConfigError` if a pose of the
    plan lies outside the workspace.

    Examples
    --------
    >>> import palpate
    >>> rig = palpate.Rig(safety={"max_force_n": 5.0})
    >>> palpate.limits_for(rig, palpate.plan_for(rig)).max_force_n
    5.0
    """
    safety = rig.safety
    deepest_mm = 1e3 * plan.deepest_below_m
    if safety.max_depth_mm is not None and safety.max_depth_mm < deepest_mm - ROUNDING_MM:
        raise RigError(
            f"safety.max_depth_mm = {safety.max_depth_mm:g}: the scan goes {deepest_mm:g} mm "
            "deep; allow that or press less"
        )
    box = safety.workspace_mm
    x, y, z = ((1e-3 * low, 1e-3 * high) for low, high in (box.x, box.y, box.z))
    check_reach(plan, (x, y, z))
    return Limits(
        max_force_n=safety.max_force_n,
        max_depth_m=1e-3 * max(safety.max_depth_mm or deepest_mm + DEPTH_SLACK_MM, deepest_mm),
        workspace_m=(x, y, z),
        max_speed_m_s=1e-3 * safety.max_speed_mm_s,
        silence_s=safety.silence_s,
        max_torque_nm=safety.max_torque_nm,
        late_s=safety.late_s,
        engine_s=safety.engine_s,
        same_readings=safety.same_readings,
        hardest_n_m=1e3 * safety.hardest_n_mm,
        face_m2=square_metres(rig.face_mm2),
    )


def true_surface(rig: Rig) -> Surface | None:
    """Where a simulated scene's surface truly lies, if the rig says so. Raises `RigError`."""
    if rig.scene is None or rig.scene.surface_mm is None:
        return None
    return _surface("scene.surface_mm", rig.scene.surface_mm)


def _surface(key: str, heights_mm: Heights) -> Surface:
    if not isinstance(heights_mm, tuple):
        return level(1e-3 * heights_mm)
    try:
        return through([(1e-3 * x, 1e-3 * y, 1e-3 * z) for x, y, z in heights_mm])
    except ValueError as error:
        raise RigError(f"{key}: {error}") from None
