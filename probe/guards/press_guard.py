"""A press compared with its depth: the force rises with it, and no faster than is possible.

A sensor that clips below its full scale, gives way or lost its gain sends live, noisy readings, and
only the depth shows that they are not the force. And what grows faster than the hardest thing that
was said to lie beneath (`Limits.hardest_n_m`) makes every bound that rests on it untrue.
"""

import math
import threading
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from typing import NamedTuple

from drivers import ConfigError, Pose, Sensor
from probe.core.contact_stress import FORCE_ROLES
from probe.guards.device_facts import SensorFacts
from probe.guards.force_limit import SensorGuard
from probe.guards.pose_guard import POSE_SLACK_M
from probe.planning.limits import Limits
from probe.planning.plan import Plan

PERIODS = 5  # of a sensor: the fewest that are waited for, as readers and lines deliver in bursts
MIN_LIMIT_SHARE = 0.1  # share of the limit that a press must have reached before it can be judged
LITTLE_SHARE = 0.02  # of the limit: a press so soft is protected by no such limit
NOISE_SIGMAS = 10.0  # standard deviations of the sensor's noise that a change must have to count
# A force that moved by no more than this many stood still: noise alone may have moved it. It is a
# mean of `force_limit.SMOOTH` readings, of whose own standard deviation this is nine times.
STILL_SIGMAS = 4.0
FLAT = 0.1  # of the rise that the press so far foretells: soft tissue stiffens, it never stops
# A press is judged when it went on by a quarter of its way in contact: a pulse may fall while the
# tip goes on. Of TIHA's force it is 24 % at 0.3 mm and 16 % at 0.5 mm, but 7 % or less where a
# press is judged, from MIN_LIMIT_SHARE of the usual limit on (7 % at 1.5 mm; 5 % at 2.5 mm, 455 Pa
# of 8.7 kPa).
JUDGED_SHARE = 0.25
# Above SOFT_SHARE of the limit, a force that stays constant over SOFT_WAY_M also trips. Over a lone
# vessel the force stays constant for a quarter of a millimetre, where the vessel bulges.
SOFT_SHARE, SOFT_WAY_M = 0.005, 0.5e-3
# Over FAINT_WAY_M a force that barely exceeds the noise also trips, if the rise that should have
# followed would exceed it too. Below SOFT_SHARE of the limit the sensor may measure a cable that
# drags.
FAINT_WAY_M = 1e-3
# A press's end is judged once the tip rests: the force stood still over the last part of the way,
# and for as long again at rest. A beat or a relaxation that hid the rise of a true force would have
# moved it by then. That part is as long as noise needs to let a rise show; if that is more than
# this share of the way in contact, the end is not judged.
LAST_SHARE = 0.05
SLACK = 1.2  # a stage may be that much faster than it was ordered
WAY_M = 50e-6  # five of a GRBL board's digits
POLLS = 2.0  # a pose may be older than the newest by that many of the stage's periods
ROUNDING = 1e-9
RISE_S = 0.02  # shorter rises are noise, of which NOISE_SIGMAS knows


class ForceReading(NamedTuple):
    """The newest force of a sensor, and how old it is."""

    sensor: str
    age_s: float
    force_n: float
    rate_hz: float


def check_blind(
    limits: Limits, speed_m_s: float, readings: Sequence[ForceReading]
) -> tuple[str, str] | None:
    """Which sensor was silent too long for a way down at ``speed_m_s``, and why; else None.

    One at least must have been heard since the hardest thing beneath can have raised the force to
    the limit; `PERIODS` are allowed, for which `check_speed` answers, and `Limits.late_s` at most.
    """
    for one in readings:
        room_n = max(limits.max_force_n - abs(one.force_n), 0.0)
        most_s = min(limits.late_s, room_n / (limits.hardest_n_m * speed_m_s))
        if one.age_s <= max(most_s, PERIODS / one.rate_hz):
            return None
    latest = min(readings, key=lambda one: one.age_s)
    return latest.sensor, (
        f"silent for {latest.age_s:.3f} s on the way down at {1e3 * speed_m_s:.3g} mm/s: on "
        f"something as hard as safety.hardest_n_mm = {1e-3 * limits.hardest_n_m:g} the force may "
        "be at its limit; press slower, or see to the sensor's line"
    )


def press_speeds_m_s(plan: Plan) -> dict[str, float]:
    """Those of the way down, by the keys of the rig file that say them."""
    return {
        "scan.approach_mm_s": plan.approach_m_s,
        "scan.indentation_mm / scan.ramp_s": plan.indentation_m / plan.ramp_s,
    }


def check_speed(plan: Plan, limits: Limits, sensors: Sequence[Sensor | SensorFacts]) -> None:
    """Refuse a press that `PERIODS` of the fastest sensor, and its low pass, could hide from the
    limit.

    Raises `ConfigError` with the greatest speed that is allowed.
    """
    hidden = {
        PERIODS / s.rate_hz + limits.filter_s.get(s.name, 0.0): s
        for s in sensors
        if any(c.role in FORCE_ROLES for c in s.channels)
    }
    if not hidden or limits.in_the_air:
        return
    sensor = hidden[min(hidden)]
    most_m_s = limits.max_force_n / (limits.hardest_n_m * min(hidden))
    filter_s = limits.filter_s.get(sensor.name, 0.0)
    behind = f" with a low pass of {filter_s:g} s (filter_s)" if filter_s else ""
    for key, speed in press_speeds_m_s(plan).items():
        if speed > most_m_s * (1 + ROUNDING):
            raise ConfigError(
                f"{key} = {1e3 * speed:g} mm/s: on something as hard as safety.hardest_n_mm = "
                f"{1e-3 * limits.hardest_n_m:g} the force would pass safety.max_force_n = "
                f"{limits.max_force_n:g} within {PERIODS} readings of a sensor of "
                f"{sensor.rate_hz:g} Hz{behind}; at most {1e3 * most_m_s:.3g} mm/s is allowed, or "
                "say how hard at most what lies beneath can be"
            )


class PressGuard:
    """Judges one sensor's force against the way that the tip goes down.

    Moves are ordered by one thread and poses come from another, also while the tip rests.
    """

    def __init__(self, feels: SensorGuard, limits: Limits, rate_hz: float) -> None:
        self._lock = threading.Lock()
        self._feels = feels
        self._limit_n = limits.max_force_n
        self._hardest_n_m = limits.hardest_n_m
        self._periods_s = PERIODS / rate_hz
        self._speed_m_s = self._first_n = 0.0
        self._noise_n = math.inf
        self._in_air_s, self._lifts = -math.inf, False  # since when the tip is out of the tissue
        self._began_m = self._z_m = self._contact_m = self._changed_s = 0.0
        # how long new poses took, and when they came, without those that a later one outlasts
        self._gaps_s: list[float] = []
        self._gap_ends_s: list[float] = []
        # since contact
        self._times: list[float] = []
        self._downs: list[float] = []
        self._forces: list[float] = []
        self._rest: list[float] = []  # since the tip rests

    def begin(self, start: Pose, target: Pose, speed_m_s: float) -> None:
        """A move has been ordered; one that does not go down is not judged.

        The noise is that of readings in the air: neither a press amid the rise of an approach that
        met the tissue early nor the fall of the lift before it is noise.
        """
        down = start.z - target.z > WAY_M
        with self._lock:
            if down:
                noise_n = self._feels.noise_n(self._in_air_s)
                self._noise_n = noise_n if math.isfinite(noise_n) else self._noise_n
                self._in_air_s = math.inf
            self._lifts = target.z - start.z > WAY_M
            self._speed_m_s = speed_m_s if down else 0.0
            self._first_n = self._feels.smooth_n
            self._began_m, self._z_m, self._changed_s = start.z, start.z, math.inf
            self._gaps_s, self._gap_ends_s = [], []
            self._times, self._downs, self._forces, self._rest = [], [], [], []

    def in_air_m(self, surface_m: float) -> float:
        """How far the tip has gone below a surface, or from where it set off if that is lower,
        without a force; 0.0 where noise hides what little tissue gives."""
        with self._lock:
            least_n = NOISE_SIGMAS * self._noise_n
            if self._times or self._speed_m_s == 0.0 or least_n > LITTLE_SHARE * self._limit_n:
                return 0.0
            return max(min(self._began_m, surface_m) - self._z_m, 0.0)

    def in_contact(self) -> bool:
        """Whether the force has risen on this way down."""
        return bool(self._times)

    def end(self) -> None:
        """The tip rests."""
        with self._lock:
            if self._lifts:
                self._in_air_s, self._lifts = self._feels.newest_s(), False
            self._speed_m_s = 0.0

    def check(self, pose: Pose, now: float) -> str | None:
        """Why the force does not belong to a pose on the way down, or to the rest after it."""
        with self._lock:
            if self._speed_m_s == 0.0:
                return self._stood_still(now) if self._times else None
            return self._judge(pose, now)

    def _judge(self, pose: Pose, now: float) -> str | None:
        if pose.z < self._z_m:
            self._keep_gap(now)
            self._z_m, self._changed_s = pose.z, now
        elif pose.z > self._z_m + POSE_SLACK_M:
            return None  # pulled up again: its force is not that of its deepest place
        force = self._feels.smooth_n
        if not self._times:
            if force - self._first_n < NOISE_SIGMAS * self._noise_n:
                return None  # in the air
            self._contact_m = self._z_m
        self._times.append(now)
        self._downs.append(self._contact_m - self._z_m)
        self._forces.append(force)
        clear_n = NOISE_SIGMAS * self._noise_n
        enough_n, soft_n = clear_n / JUDGED_SHARE, SOFT_SHARE * self._limit_n
        return (
            self._too_fast()
            or self._too_flat(WAY_M, max(self._least_n(), enough_n))
            or self._too_flat(SOFT_WAY_M, max(soft_n, enough_n), still=True)
            or self._too_flat(FAINT_WAY_M, max(soft_n, clear_n), enough_n, still=True)
        )

    def _least_n(self) -> float:
        return max(MIN_LIMIT_SHARE * self._limit_n, NOISE_SIGMAS * self._noise_n)

    def _before(self, time_s: float) -> int:
        """The newest row that is no newer; -1 if there is none."""
        return bisect_right(self._times, time_s) - 1

    def _keep_gap(self, now: float) -> None:
        gap_s = now - self._changed_s
        if gap_s < 0:  # the first: no pose came before it
            return
        while self._gaps_s and self._gaps_s[-1] <= gap_s:
            self._gaps_s.pop()
            self._gap_ends_s.pop()
        self._gaps_s.append(gap_s)
        self._gap_ends_s.append(now)

    def _before_pose(self, row: int) -> int:
        """The newest row whose force is from before the tip was where ``row`` says; -1 if none.

        That pose may be as old as it or any later one took to come. One that came late before it
        says nothing of it, and would hide the end of a press.
        """
        came_s = self._times[bisect_left(self._downs, self._downs[row])]
        since = min(bisect_left(self._gap_ends_s, came_s), len(self._gaps_s) - 1)
        return self._before(self._times[row] - POLLS * self._gaps_s[since])

    def _too_fast(self) -> str | None:
        """By time, not by poses: no tip went further than its speed allows."""
        now, force = self._times[-1], self._forces[-1]
        row = self._before(now - max(self._periods_s, RISE_S))
        if row < 0:
            return None
        # what is newest may be some readings old, then and now
        within_s = now - self._times[row] + self._periods_s
        rose_n = force - self._forces[row]
        if rose_n <= SLACK * self._hardest_n_m * self._speed_m_s * within_s + self._least_n():
            return None
        return (
            f"the force rose by {rose_n:.3f} N within {within_s:.3f} s: what lies beneath is "
            f"harder than safety.hardest_n_mm = {1e-3 * self._hardest_n_m:g}; say so if it is, "
            "and press slower"
        )

    def _too_flat(
        self, way_m: float, least_n: float, least_foretold_n: float = 0.0, *, still: bool = False
    ) -> str | None:
        """The newest part of the press, ``way_m`` at least, against ``least_n`` or more before it.

        That must foretell a rise of ``least_foretold_n``. ``still``: only noise may have moved the
        force meanwhile.

        The force at the beginning of that part is one from before.
        """
        down_m, force = self._downs[-1], self._forces[-1]
        row = bisect_right(self._downs, min(down_m / (1 + JUDGED_SHARE), down_m - way_m)) - 1
        if row < 0 or not self._gaps_s:
            return None
        began = self._before_pose(row)
        force_n = self._forces[began] - self._first_n
        if began < 0 or force_n < least_n:
            return None
        went_m = down_m - self._downs[row]
        rose_n = force - self._forces[began]
        foretold_n = force_n * went_m / max(self._downs[row], WAY_M)
        if rose_n >= FLAT * foretold_n or foretold_n < least_foretold_n:
            return None
        moved_n = max(self._forces[began:]) - min(self._forces[began:])
        if still and not 0 < moved_n <= STILL_SIGMAS * self._noise_n:
            return None  # none at all: a resolution so coarse that it hides what shows a live one
        return flat_words(rose_n, went_m, foretold_n)

    def _stood_still(self, now: float) -> str | None:
        """The end of the press and as long a time of rest, once; as `_too_flat` by noise alone."""
        down_m, most_n = self._downs[-1], NOISE_SIGMAS * self._noise_n
        risen_n = self._forces[-1] - self._first_n
        share = 2 * most_n / risen_n if risen_n > 0 else math.inf  # the least that noise lets show
        row = bisect_right(self._downs, min(down_m / (1 + share), down_m - WAY_M)) - 1
        began = self._before_pose(row) if row >= 0 and self._gaps_s else -1
        self._rest.append(self._feels.smooth_n)
        if began >= 0 and now < 2 * self._times[-1] - self._times[began]:
            return None
        judged, force_n = self._forces[began:] + self._rest, self._forces[began] - self._first_n
        self._times = []
        if began < 0 or force_n < self._least_n() or share > LAST_SHARE:
            return None
        went_m = down_m - self._downs[row]
        foretold_n = force_n * went_m / max(self._downs[row], WAY_M)
        if not 0 < max(judged) - min(judged) <= most_n:
            return None  # moved: a live one rises by nearly twice that
        return flat_words(judged[-1] - judged[0], went_m, foretold_n)


def flat_words(rose_n: float, went_m: float, foretold_n: float) -> str:
    """What is said of a force that stood still while the tip went on."""
    return (
        f"the force changed by {rose_n:+.3f} N while the tip went {1e3 * went_m:.2f} mm "
        f"deeper, where {foretold_n:.3f} N were to be expected: the sensor clips or does not "
        "feel, or what is pressed gives way"
    )
