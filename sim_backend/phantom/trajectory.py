"""Where the tip was, is and will be: straight moves with a trapezoid of speed.

The future is known until the next command, so a simulated sensor can be asked for any time.
Positions are (x, y, z) in metres in the scan frame, times seconds on the scan's clock.
"""

import math
from bisect import bisect_left, bisect_right
from itertools import pairwise
from threading import Lock
from typing import NamedTuple

import numpy as np

from sim_backend.arrays import Array

Point = tuple[float, float, float]


class Rest(NamedTuple):
    """The tip came to rest at ``point`` at ``time_s``."""

    time_s: float
    point: Point


class Leg(NamedTuple):
    """Speed up for ``rise_s``, cruise at ``speed`` for ``cruise_s``, slow down for ``fall_s``.

    A halt is a leg that only slows down, a recorded piece one that only cruises; one that goes on
    in the middle of another begins with the speed ``entry``.
    """

    start_s: float
    origin: Point
    direction: Point
    speed: float
    acceleration: float
    rise_s: float
    cruise_s: float
    fall_s: float
    entry: float = 0.0

    @property
    def end_s(self) -> float:
        return self.start_s + self.rise_s + self.cruise_s + self.fall_s

    def travelled(self, time_s: float) -> float:
        """Distance from the origin [m]."""
        t = max(time_s - self.start_s, 0.0)
        rise = min(t, self.rise_s)
        cruise = min(max(t - self.rise_s, 0.0), self.cruise_s)
        fall = min(max(t - self.rise_s - self.cruise_s, 0.0), self.fall_s)
        return (
            self.entry * rise
            + 0.5 * self.acceleration * rise * rise
            + self.speed * (cruise + fall)
            - 0.5 * self.acceleration * fall * fall
        )

    def speed_at(self, time_s: float) -> float:
        """Speed along the leg [m/s]."""
        t = time_s - self.start_s
        if t < self.rise_s:
            return max(self.entry + self.acceleration * t, 0.0)
        return max(self.speed - self.acceleration * max(t - self.rise_s - self.cruise_s, 0.0), 0.0)

    def points(self, time_s: Array) -> Array:
        """Positions (n, 3) at ``time_s`` (n,)."""
        t = np.maximum(time_s - self.start_s, 0.0)
        rise = np.minimum(t, self.rise_s)
        cruise = np.clip(t - self.rise_s, 0.0, self.cruise_s)
        fall = np.clip(t - self.rise_s - self.cruise_s, 0.0, self.fall_s)
        half = 0.5 * self.acceleration
        s = self.entry * rise + half * rise * rise
        s += self.speed * (cruise + fall) - half * fall * fall
        placed: Array = np.array(self.origin) + s[:, None] * np.array(self.direction)
        return placed

    def point(self, time_s: float) -> Point:
        """Position at one time; the end of the leg for ``math.inf``."""
        s = self.travelled(time_s)
        (x, y, z), (u, v, w) = self.origin, self.direction
        return (x + s * u, y + s * v, z + s * w)


class Trajectory:
    """All legs so far, in order. Appending and reading may happen in different threads."""

    def __init__(self, home: Point, start_s: float = 0.0) -> None:
        self._legs = [Leg(start_s, home, (0.0, 0.0, 0.0), 0.0, 1.0, 0.0, 0.0, 0.0)]
        self._starts = [-math.inf]
        self._rest_before = [Rest(start_s, home)]
        self._lock = Lock()
        self._seen_s = start_s
        self.changed_s = start_s
        self.revision = 0

    def move(self, time_s: float, target: Point, speed: float, acceleration: float) -> None:
        """Set off at ``time_s`` for ``target``, from rest."""
        origin = self.point(time_s)
        length = math.dist(origin, target)
        if length == 0.0:
            return
        direction = tuple((b - a) / length for a, b in zip(origin, target, strict=True))
        peak = min(speed, math.sqrt(length * acceleration))  # short moves never reach the speed
        rise_s = peak / acceleration
        cruise_s = max(length / peak - rise_s, 0.0)
        x, y, z = direction
        self._append(Leg(time_s, origin, (x, y, z), peak, acceleration, rise_s, cruise_s, rise_s))

    def extend(self, time_s: float, target: Point, speed: float, acceleration: float) -> None:
        """Go on to ``target`` without coming to rest, as a planner that looks ahead does.

        ``target`` lies on the way that it goes, not nearer than where it can come to rest.
        """
        leg = self._legs[-1]
        if time_s >= leg.end_s:
            self.move(time_s, target, speed, acceleration)
            return
        entry, origin = leg.speed_at(time_s), leg.point(time_s)
        length = math.dist(origin, target)
        x, y, z = ((b - a) / length for a, b in zip(origin, target, strict=True))
        peak = min(max(speed, entry), math.sqrt(length * acceleration + 0.5 * entry * entry))
        rise_s, fall_s = max(peak - entry, 0.0) / acceleration, peak / acceleration
        ramps = 0.5 * (entry + peak) * rise_s + 0.5 * peak * fall_s
        cruise_s = max(length - ramps, 0.0) / peak
        self._append(
            Leg(time_s, origin, (x, y, z), peak, acceleration, rise_s, cruise_s, fall_s, entry)
        )

    def halt(self, time_s: float, acceleration: float) -> None:
        """Slow down from ``time_s`` on, along the way it was going. At rest, do nothing."""
        leg = self._legs[-1]
        if time_s >= leg.end_s:
            return
        speed, at = leg.speed_at(time_s), leg.point(time_s)
        fall_s = speed / acceleration
        self._append(Leg(time_s, at, leg.direction, speed, acceleration, 0.0, 0.0, fall_s))

    def record(self, time_s: float, point: Point, still_m: float = 20e-6) -> None:
        """Follow a stage that moves by itself: it was seen at ``point``.

        Less than ``still_m`` from the last point counts as at rest, so that a stage's jitter is
        not taken for motion.
        """
        last = self._legs[-1]
        origin = last.point(math.inf)
        length = math.dist(origin, point)
        start_s = max(self._seen_s, last.end_s)
        if time_s <= start_s:
            return
        self._seen_s = time_s
        if length < still_m:
            return
        x, y, z = ((b - a) / length for a, b in zip(origin, point, strict=True))
        took_s = time_s - start_s
        self._append(Leg(start_s, origin, (x, y, z), length / took_s, 0.0, 0.0, took_s, 0.0))

    def moving(self, time_s: float) -> bool:
        """True until the last leg has ended."""
        return time_s < self._legs[-1].end_s

    def point(self, time_s: float) -> Point:
        """Position at one time."""
        return self._legs[bisect_right(self._starts, time_s) - 1].point(time_s)

    def velocity(self, time_s: float) -> Point:
        """Velocity at one time [m/s]."""
        leg = self._legs[bisect_right(self._starts, time_s) - 1]
        speed = leg.speed_at(time_s) if time_s < leg.end_s else 0.0
        u, v, w = leg.direction
        return (speed * u, speed * v, speed * w)

    def rest_before(self, time_s: float) -> Rest:
        """The last rest that began before ``time_s``; the start if there was none."""
        n = bisect_right(self._starts, time_s) - 1
        leg = self._legs[n]
        ended = Rest(leg.end_s, leg.point(math.inf))
        return ended if leg.end_s < time_s else self._rest_before[n]

    def all_legs(self) -> tuple[Leg, ...]:
        """Every leg so far."""
        return tuple(self._legs)

    def legs(self, time_s: Array) -> list[tuple[Leg, Rest, slice]]:
        """The legs under way at ascending ``time_s`` (n,), the rest before each, and its times."""
        if len(time_s) == 0:
            return []
        with self._lock:
            first = bisect_right(self._starts, time_s[0]) - 1
            last = bisect_right(self._starts, time_s[-1])
            bounds = [bisect_left(time_s, start_s) for start_s in self._starts[first + 1 : last]]
            edges = [0, *bounds, len(time_s)]
            return [
                (self._legs[n], self._rest_before[n], slice(a, b))
                for n, (a, b) in enumerate(pairwise(edges), start=first)
                if b > a
            ]

    def _append(self, leg: Leg) -> None:
        with self._lock:
            last = self._legs[-1]
            rested = last.end_s < leg.start_s
            rest = Rest(last.end_s, last.point(math.inf)) if rested else self._rest_before[-1]
            self._legs.append(leg)
            self._rest_before.append(rest)
            self._starts.append(leg.start_s)
            self.changed_s = leg.start_s
            self.revision += 1
