"""The machine under a GRBL board: axes that carry the phantom's tip, switches, homing and probing.

Machine frame = scan frame + ``origin_mm``, travel from minus $130..$132 to 0 as GRBL homes it.
The probe input closes when the phantom pushes back with ``touch_n``.
"""

from collections import deque
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from sim_backend.phantom.phantom import Phantom

Point = tuple[float, float, float]
ORIGIN_MM: Point = (-80.0, -20.0, -52.0)
SETTINGS = {
    10: 1.0,  # status reports give the machine's position
    13: 0.0,  # reports in inches
    20: 1.0, 21: 1.0, 22: 1.0,  # soft limits, hard limits, homing
    25: 3000.0, 27: 1.0,  # homing: speed [mm/min], way back off the switches [mm]
    100: 80.0, 101: 80.0, 102: 400.0,  # steps of x, y, z to a mm
    110: 6000.0, 111: 6000.0, 112: 3000.0,  # greatest speed of x, y, z [mm/min]
    120: 1000.0, 121: 1000.0, 122: 1000.0,  # acceleration of x, y, z [mm/s2]
    130: 100.0, 131: 40.0, 132: 60.0,  # travel of x, y, z [mm]
}  # fmt: skip
SWITCH_MM = 0.5  # the limit switches sit this far beyond the soft limits
INCH_MM = 25.4
CRITICAL = (1, 2, 10)  # after these only a reset is listened to
STRAIGHT = 0.999999  # the cosine from which GRBL's planner takes a joint as straight
LATCH_S = 1e-5  # a step of 0.04 um at 4 mm/s
AT_ONCE_MM_S2 = 1e6  # an alarm cuts the motors: from the greatest speed to rest within 5 um


class Motion(NamedTuple):
    kind: Literal["Jog", "Run", "Probe", "Home", "Dwell", "Touched"]
    target: Point
    speed_mm_s: float


class GrblMachine:
    """What moves and what stops it. It knows no commands; what it has to say is kept as lines for
    the board, which sends them."""

    def __init__(
        self,
        phantom: Phantom,
        origin_mm: Point,
        touch_n: float,
        homed: bool,
        work_mm: Point,
        ready: Callable[[Point], bool] = lambda _target: True,
    ) -> None:
        self._ready = ready
        self._held = False
        self._phantom = phantom
        self._origin = np.array(origin_mm)
        self._touch_n = touch_n
        self._work = np.array(work_mm)
        self._settings = dict(SETTINGS)
        self._homed = homed
        self._state = "Idle" if homed else "Alarm"
        self._critical = False
        self._text = ""
        self._said = ""
        self._queue: deque[Motion] = deque()
        self._now: Motion | None = None
        self._looked_s = 0.0  # when a probe's contact was last looked at
        self._relative = False
        self._inches = False
        self._reports = 0
        self._pins = ""  # inputs that are active, beside the probe's and the door's
        self._deaf = 0  # 1: to a jog cancel; 2: to a feed hold, too
        self._door_open = self._frozen = False  # frozen: a jog that goes on once the door is shut
        self._same = ""  # the report that is given for ever
        self._locks_s = np.inf  # when a board that was reset will have asked to be homed

    def _dwells(self) -> bool:
        """A program that waits goes on until the board is reset."""
        return self._now is not None and self._now.kind == "Dwell"

    def _next(self) -> None:
        if self._now is None and self._queue:
            self._start(self._queue.popleft())
        while self._now is not None and self._queue and self._goes_on(self._now, self._queue[0]):
            self._now = self._queue.popleft()
            self._extend(self._now)

    def _goes_on(self, now: Motion, then: Motion) -> bool:
        """Whether the planner passes without a stop from one jog to the next: along one line."""
        if self._held or {now.kind, then.kind} != {"Jog"} or now.speed_mm_s != then.speed_mm_s:
            return False
        here, joint, end = (np.array(p) for p in (self._place(), now.target, then.target))
        before, after = joint - here, end - joint
        ways = float(np.linalg.norm(before) * np.linalg.norm(after))
        aligned = ways > 0 and float(before @ after) > STRAIGHT * ways
        x, y, z = (1e-3 * (end - self._origin)).tolist()
        return aligned and self._phantom.tip.moving(self._time()) and self._ready((x, y, z))

    def _extend(self, motion: Motion) -> None:
        x, y, z = (1e-3 * (np.array(motion.target) - self._origin)).tolist()
        speed = self._speed_mm_s(motion)
        self._phantom.tip.extend(self._time(), (x, y, z), 1e-3 * speed, 1e-3 * self._settings[120])

    def _start(self, motion: Motion) -> None:
        self._now = motion
        self._state = "Run" if motion.kind == "Probe" else motion.kind
        target = 1e-3 * (np.array(motion.target) - self._origin)
        x, y, z = target.tolist()
        self._looked_s = self._time()
        self._held = not self._ready((x, y, z))
        if self._held:
            return
        speed = 1e-3 * self._speed_mm_s(motion)
        self._phantom.tip.move(self._time(), (x, y, z), speed, 1e-3 * self._settings[120])

    def _speed_mm_s(self, motion: Motion) -> float:
        """What was asked for, unless an axis is too slow."""
        way = np.abs(np.array(motion.target) - np.array(self._place()))
        share = way / max(float(np.linalg.norm(way)), 1e-9)
        rates = np.array([self._settings[n] / 60 for n in (110, 111, 112)])
        return min(motion.speed_mm_s, float(np.min(rates / np.maximum(share, 1e-9))))

    def _arrive(self) -> None:
        done, self._now = self._now, None
        self._state = "Idle"
        if done is not None and done.kind == "Probe":
            self._alarm(5)
            self._said += self._probe_report(self._place(), hit=False) + "ok\r\n"
        elif done is not None and done.kind == "Home" and not self._queue:
            self._homed = True
            self._said += "ok\r\n"
        elif done is not None and done.kind == "Touched":
            self._said += "ok\r\n"
        self._next()

    def _feel(self) -> None:
        """A board latches in its steps' interrupt, this one when it looks: the contact between two
        looks, which a busy machine takes far apart, is found by halving."""
        before_s, now_s = self._looked_s, self._time()
        self._looked_s = now_s
        if not self._touching(now_s):
            return
        while now_s - before_s > LATCH_S:
            middle_s = (before_s + now_s) / 2
            if self._touching(middle_s):
                now_s = middle_s
            else:
                before_s = middle_s
        self._said += self._probe_report(self._place_at(now_s), hit=True)
        self._halt(self._settings[122])
        self._now = Motion("Touched", self._place(), 0.0)

    def _probe_report(self, place: Point, *, hit: bool) -> str:
        scale = INCH_MM if self._settings[13] else 1.0
        return f"[PRB:{','.join(f'{v / scale:.3f}' for v in place)}:{int(hit)}]\r\n"

    def _alarm(self, number: int) -> None:
        if number in CRITICAL:
            self._halt(AT_ONCE_MM_S2)
            self._critical = True
        self._queue.clear()
        self._now = None
        self._state = "Alarm"
        self._said += f"ALARM:{number}\r\n"

    def _halt(self, acceleration_mm_s2: float) -> None:
        self._held = False
        self._phantom.tip.halt(self._time(), 1e-3 * acceleration_mm_s2)

    def _touching(self, time_s: float) -> bool:
        return self._phantom.force_at(time_s) >= self._touch_n

    def _target(self, given: dict[str, float], inches: bool, relative: bool) -> Point:
        scale = INCH_MM if inches else 1.0
        last = self._queue[-1] if self._queue else self._now
        start = self._place() if last is None else last.target
        x, y, z = (
            (here + scale * given[axis] if relative else scale * given[axis])
            if axis in given
            else here
            for axis, here in zip("XYZ", start, strict=True)
        )
        return (x, y, z)

    def _beyond(self, place: Point, slack_mm: float) -> bool:
        travel = [self._settings[n] for n in (130, 131, 132)]
        return any(
            not -t - slack_mm - 1e-6 <= v <= slack_mm + 1e-6
            for v, t in zip(place, travel, strict=True)
        )

    def _place(self) -> Point:
        return self._place_at(self._time())

    def _place_at(self, time_s: float) -> Point:
        x, y, z = (1e3 * np.array(self._phantom.tip.point(time_s)) + self._origin).tolist()
        return (x, y, z)

    def _time(self) -> float:
        return self._phantom.clock.now()

    def _taken(self, more: str) -> str:
        said, self._said = self._said, ""
        return said + more

    def _take(self) -> bytes:
        return self._taken("").encode("ascii")
