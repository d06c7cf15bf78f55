"""The way into the tissue: along the normal, as deep as planned though the rig itself yields."""

import math

from drivers import Pose
from probe.planning.plan import Place
from probe.planning.press_direction import pressed
from probe.scan.run_loop import RunLoop

TOP_UPS = 8  # moves after the ramp, at most, until a soft rig's tip is deep enough
DEEP_ENOUGH_M = 5e-6
# A ramp that is longer than planned by more than this is noted; nothing else depends on it. To
# gather speed and to slow down take a ramp's speed over the acceleration (2.5 mm/s at 50 mm/s2, the
# least that `drivers.core.line_stage` reckons with: 0.05 s), and its end is seen one report later.
RAMP_SHARE, RAMP_LATE_S = 0.1, 0.1


def press_to_depth(loop: RunLoop, surface: Pose, depth_m: float, ramp_s: float) -> float:
    """Go in along the normal, then on by what the rig itself has yielded; how far [m]."""
    plan, depth = loop.plan, depth_m
    bottom = pressed(surface, depth)
    speed = math.dist(loop.monitor.pose()[:3], bottom[:3]) / ramp_s
    loop.go(bottom, speed)
    for _ in range(TOP_UPS if plan.compliance_m_per_n else 0):
        yielded_m = max(plan.compliance_m_per_n * loop.status.force_n, 0.0)
        yielded_m = min(yielded_m, plan.max_deflection_m)
        if abs(depth_m + yielded_m - depth) < DEEP_ENOUGH_M:
            break
        depth = depth_m + yielded_m
        loop.go(pressed(surface, depth), speed)
    return depth


def note_the_ramp(loop: RunLoop, place: Place, took_s: float) -> None:
    """A press that stood still or was slowed relaxes the tissue in another way."""
    planned_s = loop.plan.ramp_s
    if took_s > (1 + RAMP_SHARE) * planned_s + RAMP_LATE_S:
        text = f"station {place.index + 1}: the press took {took_s:.2f} s, not ramp_s = "
        loop.bus.note("warning", loop.stage.name, f"{text}{planned_s:g}")
