"""How fast a press may go that a force is to end: so that it rests before the force is exceeded."""

import math
from collections.abc import Sequence
from dataclasses import replace

from drivers import ConfigError, Sensor
from probe.core.contact_stress import FORCE_ROLES
from probe.guards.device_facts import SensorFacts
from probe.planning.limits import Limits
from probe.planning.plan import Plan

# From a force at the tip to a tip at rest, beside the sensor's readings: emulated boards, arms and
# sensors on a busy machine take 10 to 25 ms.
STOP_S = 0.05
# Share of the force that the hardest thing beneath adds meanwhile at most: a press of twice that
# latency still ends before the force is exceeded.
AT_ONCE = 0.5
# What a sensor is taken to read at most where neither driver nor rig says: as much as an FT-300,
# which reads the most of those that say.
MOST_N = 300.0


def late_by_s(rate_hz: float, readings: int, filter_s: float) -> float:
    """How long [s] after a force the tip rests that a mean of so many ``readings`` stops."""
    return STOP_S + readings / rate_hz + filter_s


def force_speed_m_s(force_n: float, late_s: float, hardest_n_m: float) -> float:
    """The fastest way down on which the hardest thing adds `AT_ONCE` of a force in ``late_s``."""
    return AT_ONCE * force_n / (hardest_n_m * late_s)


def most_n(sensor: Sensor | SensorFacts, face_m2: float | None) -> float:
    """The greatest force [N] that a sensor is taken to read; infinite if it feels none."""
    area_m2 = {"force": 1.0, "pressure": face_m2, "taxel": face_m2}
    return max(
        (MOST_N if one.full_scale is None else one.full_scale * (area_m2[one.role] or 0.0)
         for one in sensor.channels if one.role in FORCE_ROLES),
        default=math.inf,
    )  # fmt: skip


def slowed(
    plan: Plan, limits: Limits, sensors: Sequence[Sensor | SensorFacts]
) -> tuple[Plan, tuple[str, ...]]:
    """The plan with a way down that its force can end, and what is said of a slower one.

    Raises `ConfigError` where a sensor does not read such a force.
    """
    feeling = [s for s in sensors if any(c.role in FORCE_ROLES for c in s.channels)]
    if plan.force_n is None or not feeling:
        return plan, ()
    sensor, key = feeling[0], "the last of scan.steps_n" if plan.steps_n else "scan.force_n"
    if plan.force_n >= (full_n := most_n(sensor, limits.face_m2)):
        raise ConfigError(
            f"{key} = {plan.force_n:g}: {sensor.name} reads up to {full_n:.3g} N, and is "
            "saturated there; ask for less"
        )
    late_s = late_by_s(sensor.rate_hz, 1, limits.filter_s.get(sensor.name, 0.0))
    ramp_s = plan.indentation_m / force_speed_m_s(min(plan.rises_n), late_s, limits.hardest_n_m)
    if ramp_s <= plan.ramp_s:
        return plan, ()
    speed_mm_s, hardest_n_mm = 1e3 * plan.indentation_m / ramp_s, 1e-3 * limits.hardest_n_m
    text = (
        f"{key} = {plan.force_n:g}: a press goes down at {speed_mm_s:.2g} mm/s and takes up "
        f"to {ramp_s:.3g} s, not scan.ramp_s = {plan.ramp_s:g}, so that it can be stopped on "
        f"something as hard as safety.hardest_n_mm = {hardest_n_mm:g}; say less there if what lies "
        "beneath is softer"
    )
    return replace(plan, ramp_s=ramp_s), (text,)
