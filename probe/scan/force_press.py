"""A press to a force: down until it comes near, then on at rest by what the stiffness asks for.

The way down is stopped by what the force will be once the tip rests. The steps after it end at
commanded depths and are judged at rest, so that no latency enters the result.
"""

import math

from drivers import Pose
from probe.checks.touch_noise import SHOWN, force_in_noise
from probe.core.events import Finish
from probe.guards.force_speed import force_speed_m_s, late_by_s
from probe.guards.interruption import Interrupted
from probe.guards.levels import LEVEL_S
from probe.guards.press_guard import JUDGED_SHARE, NOISE_SIGMAS, STILL_SIGMAS, flat_words
from probe.planning.planner import Press
from probe.planning.press_direction import pressed
from probe.scan.mean_force import MeanForce, noise_of
from probe.scan.run_loop import RunLoop
from probe.scan.taring import level_at_rest

REACHED = 0.05  # a force at rest within this of what was asked for
STEPS = 16  # after the way down, at most; two are usual, and more where noise stopped it early
NEAR = 0.8  # share of the force that the way down is stopped for
# How much steeper the next step is than the last, at most: a sphere's force, as depth^1.5, rises
# from NEAR to the whole 1.22 times as steeply as from SHOWN to NEAR.
STIFFENS = 1.25
SMALLEST_STEP_M = 1e-6
# Of a sensor that clips. A pulse hides what one step adds in one of forty (its 30 mN beside the
# 0.8 mN that noise of 0.5 mN takes for none), two in a row in one of a thousand.
FLAT_STEPS = 2


class _WayDown:
    """When to stop: the force, and what it rises by in the ``late_s`` until the tip rests.

    ``rise_n`` is what is wanted beyond ``from_n``. What it rises by is as since a share `SHOWN` of
    that was first measured, ``most_n_s`` at most.
    """

    def __init__(
        self,
        loop: RunLoop,
        feels: MeanForce,
        from_n: float,
        rise_n: float,
        late_s: float,
        most_n_s: float,
    ) -> None:
        self._loop, self._feels, self._from_n, self._rise_n = loop, feels, from_n, rise_n
        self._late_s, self._most_n_s = late_s, most_n_s
        self._shown_s = math.nan
        self.shown_n = 0.0
        self.shown_at: Pose | None = None

    def near(self) -> bool:
        now, force_n = self._loop.clock.now(), self._feels.force_n()
        rose_n = force_n - self._from_n
        if self.shown_at is None:
            if rose_n < SHOWN * self._rise_n:
                return False
            self._shown_s, self.shown_n, self.shown_at = now, force_n, self._loop.monitor.pose()
        rise_n_s, since_s = self._most_n_s, now - self._shown_s
        if since_s > 0:
            rise_n_s = min(max(force_n - self.shown_n, 0.0) / since_s, rise_n_s)
        return rose_n + rise_n_s * self._late_s >= NEAR * self._rise_n


def press_to_force(
    loop: RunLoop, surface: Pose, press: Press, asked_n: float, from_n: float = 0.0
) -> tuple[float, float]:
    """Go in along the normal until the force at rest is ``asked_n``, from where it is ``from_n``;
    how far [m], and the force there [N].

    It is no deeper than ``press`` says and no faster than planned. Raises `Interrupted` where
    noise hides such a force; one that is not reached, or exceeded, is noted.
    """
    plan, hardest_n_m, rise_n = loop.plan, loop.limits.hardest_n_m, asked_n - from_n
    name, noise_n, rate_hz = noise_of(loop)
    if (why := force_in_noise(name, noise_n, rate_hz, rise_n)) is not None:
        raise Interrupted(Finish.FAULTED, why, "engine", retract=True)
    rest_error = math.sqrt(2 / max(LEVEL_S * rate_hz, 1.0))  # of a difference of two levels
    feels = MeanForce(loop, SHOWN * rise_n, loop.clock.now())
    late_s = late_by_s(rate_hz, feels.readings, loop.limits.filter_s.get(name, 0.0))
    speed = min(press.depth_m / plan.ramp_s, force_speed_m_s(rise_n, late_s, hardest_n_m))

    def rests() -> tuple[float, float]:
        force_n = level_at_rest(loop)[name][0]
        return math.dist(surface[:3], loop.monitor.pose()[:3]), force_n

    way = _WayDown(loop, feels, from_n, rise_n, late_s, hardest_n_m * speed)
    loop.go(pressed(surface, press.depth_m), speed, until=way.near)
    shown_m = 0.0 if way.shown_at is None else math.dist(surface[:3], way.shown_at[:3])
    before_m = shown_m
    before_n, doubt_n = way.shown_n, 2 * noise_n / math.sqrt(feels.readings)
    depth_m, force_n = rests()
    slope_n_m, flat = 0.0, 0
    for _ in range(STEPS):
        yielded_m = min(max(plan.compliance_m_per_n * force_n, 0.0), plan.max_deflection_m)
        room_m = press.depth_m + yielded_m - depth_m
        if force_n >= (1 - REACHED) * asked_n or room_m < SMALLEST_STEP_M:
            break
        secant_n_m = (force_n - before_n + doubt_n) / max(depth_m - before_m, SMALLEST_STEP_M)
        # tissue never softens by half; and what adds no force is tried again by half a step
        least_n_m = max((2 if flat else 0.5) * slope_n_m, asked_n / press.depth_m)
        slope_n_m = min(max(STIFFENS * secant_n_m, least_n_m), hardest_n_m)
        in_contact_m = depth_m - max(shown_m - way.shown_n / slope_n_m, 0.0)
        step_m = min((asked_n - force_n) / slope_n_m, JUDGED_SHARE * in_contact_m, room_m)
        before_m, before_n = depth_m, force_n
        loop.go(
            pressed(surface, depth_m + step_m), speed,
            until=lambda: feels.force_n() > (1 + REACHED) * asked_n,
        )  # fmt: skip
        depth_m, force_n = rests()
        foretold_n, error_n = (depth_m - before_m) * slope_n_m / STIFFENS, noise_n * rest_error
        still = abs(force_n - before_n) <= STILL_SIGMAS * error_n
        flat = flat + 1 if still and foretold_n > NOISE_SIGMAS * error_n else 0
        if flat == FLAT_STEPS:
            why = flat_words(force_n - before_n, depth_m - before_m, foretold_n)
            raise Interrupted(Finish.FAULTED, f"{name}: {why}", name, retract=True)
    deepest = depth_m > press.depth_m - SMALLEST_STEP_M
    _note_the_force(loop, depth_m, force_n, asked_n, deepest=deepest)
    return depth_m, force_n


def _note_the_force(
    loop: RunLoop, depth_m: float, force_n: float, asked_n: float, *, deepest: bool
) -> None:
    if abs(force_n - asked_n) <= REACHED * asked_n or loop.station is None:
        return
    why = "a pulse raised it, or what stiffened while the probe slowed down"
    if force_n < asked_n:
        why = "that is as deep as scan.indentation_mm allows"
        why = why if deepest else f"{STEPS} steps were not enough: the force is too unsteady"
    text = f"station {loop.station + 1}: pressed to {force_n:.3g} N, {1e3 * depth_m:.2f} mm deep, "
    loop.bus.note("warning", "engine", f"{text}and not to the {asked_n:g} N asked for: {why}")
