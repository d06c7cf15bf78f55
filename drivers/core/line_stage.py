"""What every stage on a line shares: one thread that talks, a frame, limits, stops and deadlines.

A driver gives `Axes`: the open controller, used by that one thread only. The thread reads where
the axes are without end, and leads them on by segments (`drivers.core.segments`): a controller that
hears no more comes to rest. A stop goes first, between two exchanges, and is repeated until then.
"""

import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from drivers.core.abilities import StopMeans
from drivers.core.axes import Axes, LineStageSettings, Reading
from drivers.core.errors import DeviceAbsent, DeviceFault, MotionFault, as_fault
from drivers.core.leading import Lead
from drivers.core.line import NoAnswer
from drivers.core.protocols import Pose
from drivers.core.segments import AHEAD_S, Place, SegmentedMove
from drivers.core.stage_limits import (
    AXES,
    STILL_MM,
    check_speed,
    check_target,
    check_upright,
    check_way,
)

log = logging.getLogger("palpate")
HOMING_ORDER = "zxy"  # the probe goes up before anything goes sideways
JOIN_S = 2.0
BRAKES_S = 0.2  # to rest from 10 mm/s at 50 mm/s2; what is led by segments rests by then anyway
LATER_S = 5e-3  # after a wrong answer: asked on and on, a controller's buffer would fill


class _Job(NamedTuple):
    """Something to be done by the thread that talks, and what became of it."""

    do: Callable[[Axes], object]
    done: threading.Event
    found: list[object]


class LineStage:
    """A `Stage` over `Axes`; ``open_axes`` raises `DeviceAbsent` if there is none."""

    def __init__(self, settings: LineStageSettings, open_axes: Callable[[], Axes]) -> None:
        self.name = settings.name
        self.simulated = settings.simulated
        self.homes = settings.home
        self.max_speed_m_s = 1e-3 * settings.max_speed_mm_s
        self.limits_mm, self.park_mm = settings.limits_mm, settings.park_mm
        self._settings = settings
        self._open = open_axes
        self._axes: Axes | None = None  # used by the thread that talks alone, but for its facts
        self._names = ""
        self._origin = dict(zip(AXES, settings.origin_mm, strict=True))
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._end = threading.Event()
        self._fault: DeviceFault | None = None
        self._reading: Reading | None = None
        self._read_s = 0.0
        self._asked = self._answered = 0  # readings begun, and the newest that is here
        self._moved_after = 0
        self._job: _Job | None = None
        self._stopping = False
        self._harder: StopMeans | None = None  # what is taken where `stop` is not obeyed
        self._stops = 0
        self._homed = False
        self._target: Pose | None = None
        self._lead: Lead | None = None
        self._between_s = 0.0  # the newest reading and the one before
        self._guarded_s: float | None = None  # when somebody last checked the force

    def connect(self) -> None:
        """Open the line and wait for a first reading; nothing moves. Raises `DeviceAbsent`."""
        if self._thread is not None:
            return
        try:
            axes = self._open()
        except OSError as error:  # unplugged while it is opened
            raise DeviceAbsent(self.name, f"lost while it was opened ({error})") from None
        except DeviceAbsent:
            raise
        except DeviceFault as fault:
            raise DeviceAbsent(self.name, fault.reason) from None
        self._axes, self._names = axes, axes.names
        self._fault, self._reading, self._target = None, None, None
        self._job, self._stopping, self._lead, self._harder = None, False, None, None
        self._end = threading.Event()
        self._thread = threading.Thread(
            target=self._talk, args=(axes, self._end), name=f"palpate {self.name}", daemon=True
        )
        self._thread.start()
        try:
            self._fresh()
        except DeviceFault as fault:
            self.close()
            raise DeviceAbsent(self.name, fault.reason) from None

    def enable(self) -> list[str]:
        """Ask the controller whether it can move; what holds, in words. Raises `DeviceFault`.

        One that is homed first may not know yet where it is: `home` asks it again.
        """
        try:
            found = self._have(lambda axes: getattr(axes, "ready", list)())
        except DeviceFault:
            if self.homes and not self._homed:
                return []
            raise
        if not isinstance(found, list):
            raise DeviceFault(
                self.name,
                f"driver: ready() gave {found!r}; it gives a list of what holds, in words",
            )
        return found

    def pose(self) -> Pose:
        """The tip as the controller reports it, asked for now."""
        places = self._fresh().places_mm
        return Pose(*(1e-3 * (places[a] - self._origin[a]) if a in places else 0.0 for a in AXES))

    def move(self, target: Pose, speed_m_s: float) -> None:
        """Set off, each axis at such a speed that all arrive together. Raises `DeviceFault`."""
        stops = self._stops
        here = self.pose()
        self._check(here, target, speed_m_s)
        if self._reading is not None and self._reading.moving:
            raise DeviceFault(self.name, "still moving; wait or stop before the next move")
        start, end, speed_mm_s = _mm(here), _mm(target), 1e3 * speed_m_s
        aside_mm = math.dist(start[:2], end[:2])
        up = end[2] > start[2] and aside_mm < self._settings.arrived_mm  # finished by itself
        whole = up or not getattr(self._axes, "retargets", False)
        ahead_mm = math.inf if whole else (AHEAD_S + self._between_s) * speed_mm_s
        way = SegmentedMove(start, end, speed_mm_s, ahead_mm=ahead_mm)
        lead = Lead(way, self._names, self._origin, self._settings.arrived_mm)
        self._target, self._harder = target, None
        if lead.going:  # else it is there
            self._have(lead.set_off)
            self._lead = lead
        if stops != self._stops:  # stopped while the axes got their commands
            self.stop()

    def unreachable(self, poses: Sequence[Pose]) -> dict[Pose, str]:
        """Those beyond the travel that the controller gives."""
        why = {pose: self._beyond_travel(pose) for pose in poses}
        return {pose: words for pose, words in why.items() if words is not None}

    def keep_alive(self) -> None:
        """Whoever checks the force has just done so; without these calls a move is not gone on
        with, once there was one."""
        self._guarded_s = time.monotonic()

    def moving(self) -> bool:
        """True until the last move has ended. Raises `MotionFault` if it ended elsewhere."""
        reading = self._alive()
        if reading is None or self._answered <= self._moved_after or self._stopping:
            return True
        if why := reading.fault or (self._lead is not None and self._lead.trouble):
            raise MotionFault(self.name, why)
        if reading.moving or (self._lead is not None and not self._lead.whole):
            return True
        self._lead = None
        target, self._target = self._target, None
        if target is not None:
            off_mm = max(
                abs(reading.places_mm[a] - self._origin[a] - 1e3 * getattr(target, a))
                for a in self._names
            )
            if off_mm > self._settings.arrived_mm:
                raise MotionFault(self.name, f"came to rest {off_mm:.2f} mm from its target")
        return False

    def home(self) -> None:
        """Each axis to its reference switch, z first, then to ``park_mm``. Blocks; stoppable.

        Raises `DeviceFault`.
        """
        stops = self._stops
        for axis in (a for a in HOMING_ORDER if a in self._names):
            self._unless_stopped(stops)
            self._target = self._lead = None
            self._have(lambda axes, axis=axis: axes.home(axis))  # type: ignore[misc]
            self._arrive(stops)
        if self._settings.park_mm is not None:
            self.move(Pose(*(1e-3 * v for v in self._settings.park_mm)),
                      1e-3 * self._settings.max_speed_mm_s)  # fmt: skip
            self._arrive(stops)
        self._homed = True
        self.enable()

    def stop(self) -> None:
        """Slow down now; does not wait."""
        self._stops += 1
        self._target = self._lead = None
        with self._changed:
            self._stopping = self._thread is not None
            self._changed.notify_all()

    def stop_means(self) -> tuple[StopMeans, ...]:
        """`stop`, and what the controller has beside it."""
        within_s = self._between_s + self._settings.answer_s + BRAKES_S
        harder: Sequence[StopMeans] = getattr(self._axes, "harder", ())
        return (
            StopMeans("stop", self.stop, within_s),
            *(
                StopMeans(m.name, partial(self._stop_by, m), within_s + m.within_s, m.lifts)
                for m in harder
            ),
        )

    def close(self) -> None:
        """Stop and release the line."""
        self.stop()
        self._end.set()
        with self._changed:
            self._changed.notify_all()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join(timeout=JOIN_S)

    def _unless_stopped(self, stops: int) -> None:
        if stops != self._stops:
            raise DeviceFault(self.name, "stopped on the way to its home")

    def _arrive(self, stops: int) -> None:
        while self.moving():
            time.sleep(1 / self._settings.status_hz)
        self._unless_stopped(stops)

    def _check(self, here: Pose, target: Pose, speed_m_s: float) -> None:
        check_speed(self.name, self._settings.max_speed_mm_s, speed_m_s)
        check_upright(self.name, target)
        check_way(self.name, self._names, here, target)
        check_target(self.name, self.limits_mm, target)
        if (beyond := self._beyond_travel(target)) is not None:
            raise DeviceFault(self.name, beyond)

    def _beyond_travel(self, target: Pose) -> str | None:
        """A move that leads there would be refused on its way, where a press has begun."""
        travel_mm = getattr(self._axes, "travel_mm", {})
        for axis, to_mm in zip(AXES, _mm(target), strict=True):
            low, high = travel_mm.get(axis, (-math.inf, math.inf))
            if not low - STILL_MM <= to_mm + self._origin[axis] <= high + STILL_MM:
                low, high = low - self._origin[axis], high - self._origin[axis]
                return f"{axis} = {to_mm:g} mm: out of range; its travel: {low:g} to {high:g} mm"
        return None

    def _stop_by(self, means: StopMeans) -> None:
        self._harder = means
        self.stop()

    # --- between the threads -----------------------------------------------------------------

    def _alive(self) -> Reading | None:
        if self._fault is not None:
            raise self._fault
        if self._thread is None:
            raise DeviceFault(self.name, "not connected")
        age_s = time.monotonic() - self._read_s
        if self._reading is not None and age_s > self._settings.silent_s:
            allowed = f"silent_s = {self._settings.silent_s:g}"
            raise DeviceFault(self.name, f"silent for {age_s:.2f} s; allowed: {allowed}")
        return self._reading

    def _fresh(self) -> Reading:
        """A reading begun after this call."""
        self._alive()
        asked, wait_s = self._asked, self._settings.answer_s + self._settings.silent_s
        with self._changed:
            self._changed.wait_for(
                lambda: self._answered > asked or self._fault is not None, wait_s
            )
        reading = self._alive()
        if reading is None or self._answered <= asked:
            raise DeviceFault(self.name, f"no position within {wait_s:g} s")
        return reading

    def _have(self, do: Callable[[Axes], object]) -> object:
        """Have the other thread do something. Raises what it raised."""
        self._alive()
        job = _Job(do, threading.Event(), [])
        with self._changed:
            self._job = job
            self._changed.notify_all()
        wait_s = len(AXES) * 2 * self._settings.answer_s + self._settings.silent_s
        if not job.done.wait(wait_s):
            raise DeviceFault(self.name, f"did not take the command within {wait_s:g} s")
        (found,) = job.found
        if isinstance(found, Exception):
            raise found
        return found

    def _talk(self, axes: Axes, end: threading.Event) -> None:
        try:
            while not end.is_set():
                self._step(axes)
                with self._changed:
                    self._changed.wait_for(
                        lambda: self._job is not None or self._stopping or end.is_set(),
                        1 / self._settings.status_hz,
                    )
        except OSError as error:
            self._fault = DeviceFault(self.name, f"connection lost ({error})")
        except Exception as error:  # noqa: BLE001 - a dead thread must not look like silence
            self._fault = as_fault(self.name, error)
        finally:
            self._leave(axes)

    def _step(self, axes: Axes) -> None:
        """A stop, or else a job; then a reading, and the next segment."""
        try:
            if self._stopping:
                self._order_stop(axes)
            with self._changed:
                job, self._job = self._job, None
            if job is not None:
                self._do(axes, job)
            self._asked += 1
            number, stops = self._asked, self._stops
            reading = axes.read()
            self._take(reading, number, stops)
            if (lead := self._lead) is not None and not self._stopping:
                self._moved_after = (
                    number if lead.go_on(axes, reading, self._guarded_s) else self._moved_after
                )
        except NoAnswer:  # the reading's age shows it, if it lasts
            self._end.wait(LATER_S)

    def _take(self, reading: Reading, number: int, stops: int) -> None:
        with self._changed:
            now_s = time.monotonic()
            if self._reading is not None:
                self._between_s = min(now_s - self._read_s, self._settings.silent_s)
            self._read_s = now_s
            self._reading, self._answered = reading, number
            if self._stopping and stops == self._stops and not reading.moving:
                self._stopping = False
            self._changed.notify_all()

    def _order_stop(self, axes: Axes) -> None:
        """The usual one always; a harder one may be unknown to a controller."""
        axes.stop()
        if (means := self._harder) is not None:
            try:
                means.call()
            except NoAnswer:
                raise
            except DeviceFault as fault:
                log.warning("%s: %s: %s", self.name, means.name, fault.reason)

    def _do(self, axes: Axes, job: _Job) -> None:
        try:
            job.found.append(job.do(axes))
        except DeviceFault as fault:
            job.found.append(fault)
        except OSError as error:
            job.found.append(DeviceFault(self.name, f"connection lost ({error})"))
            raise
        except Exception as error:
            job.found.append(as_fault(self.name, error))
            raise
        finally:
            self._moved_after = self._asked
            job.done.set()

    def _leave(self, axes: Axes) -> None:
        try:
            axes.stop()
        except (OSError, DeviceFault):
            pass  # a line that is lost, or a device that does not answer: nothing more can be done
        finally:
            axes.close()
            with self._changed:
                self._stopping = False
                job, self._job = self._job, None
                self._changed.notify_all()
            if job is not None:
                job.found.append(self._fault or DeviceFault(self.name, "closed"))
                job.done.set()


def _mm(pose: Pose) -> Place:
    x, y, z = (1e3 * at for at in pose[:3])
    return (x, y, z)
