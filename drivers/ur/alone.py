"""The client's process lifts where the process that guards has died.

It holds the only connection to the robot's program. It stops the arm, waits until the arm is seen
at rest, lifts the tip straight up to where the scan travels, and ends the program: nobody is left
who would check a force, and nothing moves afterwards.
"""

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

ALONE_S = 20.0  # for all of it; see `Lift`: at the default speeds a lift takes one to two seconds
REST_S = 1.0  # a stop that has not worked by then is not obeyed: the program's end stops the arm
STILL_M, STILL_S = 5e-6, 0.03
ASIDE_M = 0.5e-3  # a lift that strays so far, or sinks by it, is no lift
LOOK_S = 2e-3
ARRIVED_M = 0.1e-3

Point = tuple[float, ...]


class Lift(NamedTuple):
    """Up along ``normal`` (3,), a unit vector of the base frame, to where ``normal . place`` is
    ``height_m``."""

    normal: tuple[float, float, float]
    height_m: float
    speed_m_s: float
    acceleration_m_s2: float

    def way_m(self, place: Point) -> float:
        """How far ``place`` is below; negative above."""
        x, y, z = (along * at for along, at in zip(self.normal, place, strict=False))
        return self.height_m - (x + y + z)


class Replaced(RuntimeError):
    """The program ended: by a person, by safety, or because another client runs its own now."""


def lift_alone(control: Any, receive: Any, playing: Callable[[], bool], lift: Lift) -> str:
    """Stop and lift; how it went, in words. Raises `Replaced`: then nothing may be ordered any
    more, not even the end of the program."""
    end_s = time.monotonic() + ALONE_S

    def place() -> Point:
        if not playing():
            raise Replaced
        control.kickWatchdog()
        return tuple(receive.getActualTCPPose())

    control.stopL(lift.acceleration_m_s2, True)
    if not _rests(place, time.monotonic() + REST_S):
        return "its arm did not stop; its program was ended: THE PROBE WAS NOT LIFTED"
    start = place()
    way_m = lift.way_m(start)
    if way_m <= ARRIVED_M:
        return "the probe was up already"
    top = [at + way_m * along for at, along in zip(start, lift.normal, strict=False)]
    control.moveL([*top, *start[3:]], lift.speed_m_s, lift.acceleration_m_s2, True)
    while time.monotonic() < end_s:
        here = place()
        risen_m = way_m - lift.way_m(here)
        aside_m = math.sqrt(max(math.dist(here[:3], start[:3]) ** 2 - risen_m**2, 0.0))
        if risen_m < -ASIDE_M or aside_m > ASIDE_M:
            return "commanded to lift, the arm went another way: THE PROBE WAS NOT LIFTED"
        if lift.way_m(here) < ARRIVED_M:
            return f"the probe was lifted by {1e3 * risen_m:.1f} mm"
        time.sleep(LOOK_S)
    return "the arm has not come up: THE PROBE WAS NOT LIFTED"


def _rests(place: Callable[[], Point], until_s: float) -> bool:
    """The place has not changed over `STILL_S`."""
    since_s, last = time.monotonic(), place()
    while time.monotonic() < until_s:
        time.sleep(LOOK_S)
        here = place()
        if math.dist(here[:3], last[:3]) > STILL_M:
            since_s, last = time.monotonic(), here
        elif time.monotonic() - since_s > STILL_S:
            return True
    return False
