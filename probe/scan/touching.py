"""The surface found by touch: go down slowly until the force shows that it is there."""

import math

from drivers import Pose
from probe.checks.touch_noise import touch_in_noise
from probe.core.events import Finish
from probe.guards.interruption import Interrupted
from probe.guards.levels import LEVEL_S
from probe.planning.plan import TOUCH_GAP_M, TOUCH_M_S
from probe.scan.mean_force import MeanForce, noise_of
from probe.scan.run_loop import RunLoop


def find_surface(loop: RunLoop, planned: Pose, touch_n: float) -> Pose:
    """Go down from above ``planned`` until the force reaches ``touch_n``, or the stage itself has
    found contact; where that was.

    Where single readings do not distinguish ``touch_n`` from noise, the mean of the latest is
    asked, of up to `LEVEL_S`: it is late by half of that, 0.05 mm.
    """
    name, noise_n, rate_hz = noise_of(loop)
    if (why := touch_in_noise(name, noise_n, rate_hz, touch_n, LEVEL_S * rate_hz)) is not None:
        raise Interrupted(Finish.FAULTED, why, "engine", retract=True)
    loop.go(planned._replace(z=planned.z + TOUCH_GAP_M), loop.plan.approach_m_s)
    feels = MeanForce(loop, touch_n, loop.clock.now())
    lowest = planned._replace(z=planned.z - loop.plan.search_m)
    if loop.go(lowest, TOUCH_M_S, until=lambda: feels.force_n() >= touch_n, search=True):
        felt_n, _ = next(iter(loop.monitor.levels(loop.status.seen_s - LEVEL_S).values()))
        raise Interrupted(
            Finish.FAULTED,
            f"no touch of {touch_n:g} N down to {1e3 * loop.plan.search_m:g} mm below the planned "
            f"surface, where the force is {felt_n:.2g} N; let it search deeper (scan.search_mm) or "
            "for less (scan.touch_n)",
            "engine", retract=True,
        )  # fmt: skip
    here = loop.monitor.pose()
    if loop.monitor.touched_n(feels.since_s, feels.readings) is not None:
        _check_contact(loop, 1e3 * (here.z - planned.z), feels, touch_n)
    return planned._replace(z=here.z)


def _check_contact(loop: RunLoop, height_mm: float, feels: MeanForce, touch_n: float) -> None:
    """A stage may have gone back to where contact began; before, the force must have been there:
    else the contact is none, and the press would be too shallow."""
    rests_s = loop.clock.now()
    while loop.status.seen_s < rests_s:
        loop.tick(math.inf)
    most_n = loop.monitor.touched_n(feels.since_s, feels.readings) or 0.0
    if most_n < touch_n:
        reason = (
            f"{loop.stage.name}: found contact {height_mm:+.2f} mm from the planned surface, "
            f"where the sensor measured at most {most_n:.3f} N (scan.touch_n = {touch_n:g}): "
            "the probe may be in the air"
        )
        raise Interrupted(Finish.FAULTED, reason, loop.stage.name, retract=True)
