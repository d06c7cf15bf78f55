"""What a scan with a rig may never exceed, in SI: the rig's own limits, and what holds without."""

from probe.config.rig import Rig, RigError
from probe.core.contact_stress import square_metres
from probe.planning.limits import Limits
from probe.planning.plan import Plan, check_reach

DEPTH_SLACK_MM = 0.5  # beyond the deepest press, where the rig file gives no limit
ROUNDING_MM = 1e-6  # as `probe.planning.plan.check_reach` allows: 0.9 mm in metres and back is more


def limits_for(rig: Rig, plan: Plan) -> Limits:
    """What must never be exceeded, from the rig's safety table.

    Parameters
    ----------
    rig
        Its `safety` table.
    plan
        What is to be pressed: its depth and places must be within the limits.

    Returns
    -------
    Limits
        In SI units.

    Raises
    ------
    RigError
        The plan goes deeper than the table allows.
    ConfigError
        A pose of the plan lies outside the workspace.

    Examples
    --------
    >>> import palpate
    >>> rig = palpate.Rig(safety={"max_force_n": 5.0})
    >>> palpate.limits_for(rig, palpate.plan_for(rig)).max_force_n
    5.0
    """
    if not (isinstance(rig, Rig) and isinstance(plan, Plan)):
        raise TypeError("a Rig and its Plan are needed; palpate.plan_for(rig) makes the plan")
    safety = rig.safety
    deepest_mm = 1e3 * plan.deepest_below_m
    if safety.max_depth_mm is not None and safety.max_depth_mm < deepest_mm - ROUNDING_MM:
        raise RigError(
            f"safety.max_depth_mm = {safety.max_depth_mm:g}: the scan goes {deepest_mm:g} mm "
            "deep; allow that or press less"
        )
    within_m = plan.indentation_m / 2
    if safety.contact_within_mm is not None:
        within_m = 1e-3 * safety.contact_within_mm
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
        contact_within_m=within_m,
        face_m2=square_metres(rig.face_mm2),
    )
