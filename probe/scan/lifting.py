"""The beginning of a lift: a force that was constant in the hold must fall, or it was not measured.

A sensor that clips so near to a press's bottom that the stage's poses, milliseconds old, cannot
show it (`probe.guards.press_guard`) says the same a little higher, at rest.
"""

import math

from drivers import Pose
from probe.guards.levels import LEVEL_S, MAX_LEVEL_S, unreleased
from probe.guards.press_guard import WAY_M
from probe.planning.press_direction import pressed
from probe.scan.run_loop import RunLoop
from probe.scan.taring import next_level

RELEASED_SHARE = 0.03  # of the way in: what clips within it hides hardly more than that


def begin_lift(loop: RunLoop, surface: Pose, depth_m: float, hold_s: float) -> None:
    """Lift by `RELEASED_SHARE` of ``depth_m`` after a hold of ``hold_s``, see whether the force
    fell, and note it if not."""
    way_m = max(RELEASED_SHARE * depth_m, WAY_M)
    if loop.in_the_air or way_m > depth_m:
        return
    held_s = max(min(MAX_LEVEL_S, hold_s / 2), LEVEL_S)
    held = loop.monitor.levels(loop.status.seen_s - held_s)
    loop.go(pressed(surface, depth_m - way_m), loop.plan.travel_m_s)
    lifted = next_level(loop)
    usual = {name: loop.usual.error_n(name) * math.sqrt(LEVEL_S / held_s) for name in held}
    if (why := unreleased(held, lifted, usual, way_m / depth_m)) is not None:
        loop.bus.note("warning", "engine", f"{why} while the tip rose by {1e3 * way_m:.2f} mm: "
                      "the sensor clips there, or the stage has as much play; the forces of this "
                      "press may be too low")  # fmt: skip
