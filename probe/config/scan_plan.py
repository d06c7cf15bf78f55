"""From a rig to what the engine works with: the plan of its presses, in SI."""

from probe.config.calibrated import compliance_of, surface_of
from probe.config.rig import Heights, Rig, RigError, pair
from probe.planning.plan import Place, Plan, grid, repeated
from probe.planning.press_direction import pressed
from probe.planning.surfaces import Surface, level, through
from sim_backend.scene.scene_file import Scene

SLACK_MM = 1e-6
"""Rounding of places, and how far inside its ends a solid is pressed at least."""


def plan_for(rig: Rig) -> Plan:
    """The scan as stations and one press.

    Parameters
    ----------
    rig
        Its `scan` table, and the calibrations of surface and compliance, which are read
        here: call it once.

    Returns
    -------
    Plan
        Stations in the order of the scan, in SI units.

    Raises
    ------
    CalibrationError
        A calibration file cannot be read.
    RigError
        The surface's points do not make one.

    Examples
    --------
    >>> import palpate
    >>> plan = palpate.plan_for(palpate.default_rig())
    >>> len(plan.places), plan.indentation_m
    (15, 0.0025)
    """
    if not isinstance(rig, Rig):
        raise TypeError("a Rig is needed; palpate.load_rig reads one from a file")
    scan, files = rig.scan, rig.calibration
    (x, dx, columns), (y, dy, rows) = zip(
        pair(scan.start_mm, 0.0), pair(scan.pitch_mm, 0.0), pair(scan.stations, 1), strict=True
    )
    compliance_m_per_n = compliance_of(files["compliance"]) if "compliance" in files else 0.0
    places = grid((1e-3 * x, 1e-3 * y), (1e-3 * dx, 1e-3 * dy), (int(columns), int(rows)))
    steps_m = tuple(1e-3 * step_mm for step_mm in scan.steps_mm)
    return Plan(
        places=_only(repeated(places, scan.repeats), scan.only),
        indentation_m=steps_m[-1] if steps_m else 1e-3 * scan.indentation_mm,
        ramp_s=scan.ramp_s,
        hold_s=scan.hold_s,
        clearance_m=1e-3 * rig.safety.retract_mm,
        travel_m_s=1e-3 * scan.travel_mm_s,
        approach_m_s=1e-3 * scan.approach_mm_s,
        settle_s=scan.settle_s,
        force_n=max(scan.forces_n, default=None),
        steps_m=steps_m[:-1],
        steps_n=scan.forces_n[:-1],
        step_hold_s=scan.step_hold_s,
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


def _only(places: tuple[Place, ...], numbers: tuple[int, ...]) -> tuple[Place, ...]:
    """The stations with these ``numbers``, which keep them; all without any."""
    if beyond := [n for n in numbers if n > len(places)]:
        raise RigError(f"scan.only = {beyond[0]}: the scan has the stations 1 to {len(places)}")
    return tuple(place for place in places if not numbers or place.index + 1 in numbers)


def beside_the_block(plan: Plan, scene: Scene) -> str | None:
    """Which station's press lies beside the block of a simulated scene, and what is allowed; None
    where none does. Beside a lone vessel, on its support, a press feels nothing, and is allowed."""
    if scene.tissue is None:
        return None
    from sim_backend.models.press_range import along_mm, reach_mm

    (left, right), (low, high) = reach_mm(scene), along_mm(scene)
    for place in plan.places:
        start = plan.at_surface(place)
        for pose in (start, pressed(start, plan.indentation_m)):
            x_mm, y_mm = 1e3 * pose.x, 1e3 * pose.y
            if not (left - SLACK_MM <= x_mm <= right + SLACK_MM):
                axis, at_mm, ends = "x", x_mm, (left, right)
            elif not (low + SLACK_MM <= y_mm <= high - SLACK_MM):
                axis, at_mm, ends = "y", y_mm, (low, high)
            else:
                continue
            return (
                f"station {place.index + 1} presses at {axis} = {at_mm:g} mm, beside the block of "
                f"{scene.name}: it must lie between {ends[0]:g} and {ends[1]:g} mm; "
                "change scan.start_mm, scan.pitch_mm or scan.stations"
            )
    return None


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
