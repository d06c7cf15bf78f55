"""The surface found by touch: go down slowly until the force shows that it is there."""

import math

from drivers import Pose
from probe.checks.touch_noise import least_touch_n, touch_in_noise, touch_readings
from probe.core.events import Finish
from probe.guards.interruption import Interrupted
from probe.guards.levels import LEVEL_S
from probe.planning.plan import TOUCH_GAP_M, TOUCH_M_S
from probe.scan.run_loop import RunLoop


def find_surface(loop: RunLoop, planned: Pose, touch_n: float) -> Pose:
    """Go down from above ``planned`` until the force reaches ``touch_n``, or the stage itself has
    found contact; where that was.

    Where single readings do not distinguish ``touch_n`` from noise, the mean of the latest is
    asked, of up to `LEVEL_S`: it is late by half of that, 0.05 mm.
    """
    name, (_, error_n) = next(iter((loop.known_levels or {"": (0.0, 0.0)}).items()))
    rate_hz = next((s.rate_hz for s in loop.sensors if s.name == name), 1 / LEVEL_S)
    noise_n = error_n * math.sqrt(LEVEL_S * rate_hz)
    if (why := touch_in_noise(name, noise_n, rate_hz, touch_n, LEVEL_S * rate_hz)) is not None:
        raise Interrupted(Finish.FAULTED, why, "engine", retract=True)
    readings = touch_readings(noise_n, rate_hz, touch_n)
    alone_n = max(touch_n, least_touch_n(noise_n, rate_hz, 1))
    loop.go(planned._replace(z=planned.z + TOUCH_GAP_M), loop.plan.approach_m_s)
    began_s = loop.clock.now()

    def touches() -> bool:
        from_s = loop.status.seen_s - readings / rate_hz
        return loop.status.force_n >= alone_n or (
            readings > 1 and from_s >= began_s and loop.monitor.levels(from_s)[name][0] >= touch_n
        )

    lowest = planned._replace(z=planned.z - loop.plan.search_m)
    if loop.go(lowest, TOUCH_M_S, until=touches):
        felt_n, _ = next(iter(loop.monitor.levels(loop.status.seen_s - LEVEL_S).values()))
        raise Interrupted(
            Finish.FAULTED,
            f"no touch of {touch_n:g} N down to {1e3 * loop.plan.search_m:g} mm below the planned "
            f"surface, where the force is {felt_n:.2g} N; let it search deeper (scan.search_mm) or "
            "for less (scan.touch_n)",
            "engine", retract=True,
        )  # fmt: skip
    here = loop.monitor.pose()
    if loop.monitor.touched_n(began_s, readings) is not None:
        _check_contact(loop, 1e3 * (here.z - planned.z), began_s, touch_n, readings)
    return planned._replace(z=here.z)


def _check_contact(
    loop: RunLoop, height_mm: float, began_s: float, touch_n: float, readings: int
) -> None:
    """A stage may have gone back to where contact began; before, the force must have been there:
    else the contact is none, and the press would be too shallow."""
    rests_s = loop.clock.now()
    while loop.status.seen_s < rests_s:
        loop.tick(math.inf)
    most_n = loop.monitor.touched_n(began_s, readings) or 0.0
    if most_n < touch_n:
        reason = (
            f"{loop.stage.name}: found contact {height_mm:+.2f} mm from the planned surface, "
            f"where the sensor measured at most {most_n:.3f} N (scan.touch_n = {touch_n:g}): "
            "the probe may be in the air"
        )
        raise Interrupted(Finish.FAULTED, reason, loop.stage.name, retract=True)
