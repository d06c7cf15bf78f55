"""GRBL 1.1 and grblHAL: three axes that carry the probe, over serial, pty or TCP.

Moves are jogs (``$J=``): the board refuses one beyond its travel, and a jog can be cancelled at
any moment without losing the position. Machine frame = scan frame + ``origin_mm``; z up, as the
boards have it.
"""

import logging
import math
import threading
import time
from contextlib import suppress

from drivers.core.errors import ConfigError, DeviceAbsent, DeviceFault, MotionFault
from drivers.core.ports import PortName, nobody_else, open_port
from drivers.core.protocols import Clock, Pose
from drivers.core.settings import Baud, Point, Positive, Settings
from drivers.core.stage_limits import Limits, check_speed, check_target, check_upright
from drivers.grbl.line import HOLD, JOG_CANCEL, RESET, Conversation, Status
from drivers.grbl.words import STATES, pins_in_words

log = logging.getLogger("palpate")
LATE_LINE_S = 2.0  # a line that has waited this long in a board that works is lost
HELLO_S = 4.0  # an Arduino that resets when its port is opened needs two seconds
HOME_S = 120.0
INCH_MM = 25.4
MOVING = ("Jog", "Run", "Hold", "Home", "Door")
SETTINGS_S = 2.0
OFFSET_REPORTS = 35  # GRBL 1.1 reports the offset every 10 to 30 reports
REPORT_S = 0.02  # between two reports, at least
REPORT_MASK = 10
REPORT_INCHES, SOFT_LIMITS, HOMING = 13, 20, 22
MAX_RATE = (110, 111, 112)  # mm/min


class GrblSettings(Settings):
    """``[stage] driver = "grbl"``: a GRBL or grblHAL board at ``port``.

    ``port`` is a path, ``COM3`` (untested), ``socket://host:port``. ``origin_mm``: where the scan's
    (0, 0, 0) lies in machine coordinates. With ``home`` a scan begins by moving the machine to its
    switches and then to ``park_mm`` in the scan frame, where ``limits_mm`` bounds the targets too;
    connecting moves nothing. ``status_hz``: position reports asked for a second. ``answer_s``: how
    long the board may take to accept a line; ``silent_s``: how old its newest report may be.
    """

    name: str = "grbl"
    port: PortName
    baud: Baud = 115200
    origin_mm: Point = (0.0, 0.0, 0.0)
    limits_mm: Limits | None = None
    max_speed_mm_s: Positive = 25.0
    home: bool = False
    park_mm: Point | None = None
    status_hz: Positive = 50.0
    answer_s: Positive = 0.5  # grblHAL takes 5 to 12 ms
    silent_s: Positive = 0.25


class GrblStage:
    """A stage on a GRBL board; see `GrblSettings`."""

    def __init__(self, settings: GrblSettings) -> None:
        self.name = settings.name
        self.simulated = settings.simulated
        self.homes = settings.home
        self.max_speed_m_s = 1e-3 * settings.max_speed_mm_s
        self.limits_mm, self.park_mm = settings.limits_mm, settings.park_mm
        self._settings = settings
        self._period_s = 1 / settings.status_hz
        self._talk: Conversation | None = None
        self._unit_mm = 1.0
        self._probing = self._homing = False
        self._stops = self._stops_before = 0  # now, and when the last move was sent
        self._stopping = threading.Event()
        self._moved_after = 0  # status requests sent before the last move was accepted
        self._restarts = 0  # those we asked for

    def connect(self) -> None:
        """Open the port, greet the board, read its settings."""
        if self._talk is not None:
            return
        keys = self._settings
        line = open_port(self.name, keys.port, keys.baud)
        talk = Conversation(self.name, line, self._period_s)
        try:
            status = talk.fresh(HELLO_S)
            self._read_settings(talk, locked=status.state == "Alarm")
        except DeviceFault as fault:
            talk.close()
            raise DeviceAbsent(
                self.name, f"no GRBL answers at {keys.port}: {fault.reason}"
                f"{nobody_else(keys.port)}. GRBL 1.1 is silent "
                "after a limit alarm until it is reset (its button, or power), and while it homes"
            ) from None  # fmt: skip
        self._stopping.clear()
        self._restarts = talk.restarts  # opening the port resets an Arduino
        talk.after_status = self._finish_stop
        self._moved_after = 0
        self._talk = talk
        try:
            if status.state == "Alarm" and not self.homes:
                why = talk.alarm or "locked"
                raise DeviceFault(
                    self.name, f"{why}; home it (home = true in the rig file) or clear it with $X"
                )
            if not self.homes:
                self._find_position(talk)
        except BaseException:
            self.close()
            raise

    def enable(self) -> list[str]:
        """See that nobody else is in command of the board; what its settings mean for a scan.

        Raises `DeviceFault`.
        """
        talk = self._line()
        status = self._fresh(talk)
        if status.state in STATES:
            raise DeviceFault(self.name, STATES[status.state])
        if pressed := pins_in_words(status.pins):
            raise DeviceFault(self.name, f"active at rest: {pressed}")
        notes = []
        if not talk.settings.get(HOMING, 1.0):
            notes.append("homing is off ($22=0): the board does not know where its travel ends")
        elif not talk.settings.get(SOFT_LIMITS, 1.0):
            notes.append("soft limits are off ($20=0): nothing but limits_mm bounds the travel")
        if "P" in status.pins:
            notes.append("its probe contact is closed")
        return notes

    def _read_settings(self, talk: Conversation, *, locked: bool) -> None:
        """After some alarms a board reports its settings only once it was reset, as homing does."""
        try:
            talk.command("$$", SETTINGS_S)
        except DeviceFault:
            if not locked:
                raise
            return
        self._unit_mm = INCH_MM if talk.settings.get(REPORT_INCHES) else 1.0
        self._tell_slow_axes(talk)

    def _find_position(self, talk: Conversation) -> None:
        """Wait until the machine's position is known: some boards say it in every 30th report."""
        wait_s = self._settings.answer_s + OFFSET_REPORTS * max(self._period_s, REPORT_S)
        try:
            talk.wait(
                lambda: talk.status is not None and talk.status.position is not None, wait_s, ""
            )
        except DeviceFault:
            mask = talk.settings.get(REPORT_MASK, 0.0)
            raise DeviceFault(
                self.name, f"reports work positions only, not where the machine is ($10={mask:g}); "
                "set $10=1"
            ) from None  # fmt: skip

    def pose(self) -> Pose:
        """The tip as the board reports it, asked for now."""
        talk = self._line()
        status = self._fresh(talk)
        self._check(talk, status)
        if status.position is None:
            raise DeviceFault(self.name, "has not reported where the machine is ($10)")
        return Pose(*self._scan_m(status.position))

    def move(self, target: Pose, speed_m_s: float) -> None:
        """Set off. Raises `DeviceFault` if out of bounds, too fast, moving, or refused."""
        talk = self._line()
        self._check(talk, self._fresh(talk))
        if self.moving():
            raise DeviceFault(self.name, "still moving; wait or stop before the next move")
        if talk.unanswered:  # a stop of the move before waits for it no longer
            self._stopping.clear()
        check_speed(self.name, self._settings.max_speed_mm_s, speed_m_s)
        check_upright(self.name, target)
        machine = self._machine_mm(target)
        words = "".join(f"{axis}{at:.4f}" for axis, at in zip("XYZ", machine, strict=True))
        stops = self._stops_before = self._stops
        talk.command(f"$J=G21G90G53{words}F{60e3 * speed_m_s:.3f}", self._settings.answer_s)
        self._moved_after = talk.asked
        if stops != self._stops:  # stopped while the board was thinking
            self._send_stop(talk)

    def probe(self, depth_m: float, speed_m_s: float, timeout_s: float = 60.0) -> Pose:
        """Go down by ``depth_m`` until the board's probe input closes; where it closed.

        Blocks. The board halts a little below, so this is its latched position, not the last
        one. Raises `DeviceFault` if there was no contact, or already one before.
        """
        talk = self._line()
        if depth_m <= 0:
            raise ConfigError(f"depth_m = {depth_m:g}: must be above 0")
        talk.probed, self._probing = None, True
        try:
            feed = 60e3 * speed_m_s
            talk.command(f"G21G91G38.2Z{-1e3 * depth_m:.4f}F{feed:.3f}", timeout_s)
            talk.command("G90", self._settings.answer_s)
            self._moved_after = talk.asked
            talk.wait(lambda: talk.probed is not None, self._settings.answer_s, "no probe report")
        except DeviceFault as fault:
            raise DeviceFault(self.name, talk.alarm or fault.reason) from None
        finally:
            self._probing = False
        assert talk.probed is not None
        position, hit = talk.probed
        if not hit:
            raise DeviceFault(self.name, talk.alarm or "probe: no contact within the move")
        return Pose(*self._scan_m(position))

    def home(self) -> None:
        """Run the homing cycle, then go to ``park_mm``; blocks. Raises `DeviceFault`.

        A `stop` breaks it off at any instant: during the cycle by a reset, the only thing that a
        board listens to then.
        """
        talk, stops = self._line(), self._stops
        if self._fresh(talk).state == "Alarm":  # after some alarms only a reset is listened to
            self._reset(talk)
            asked = self._restarts
            talk.wait(lambda: talk.restarts >= asked, HELLO_S, "no greeting after a reset")
            talk.fresh(HELLO_S)  # grblHAL reports ALARM:11, homing required, after its greeting
        talk.alarm = None
        self._read_settings(talk, locked=False)
        self._homing = True
        try:
            self._unless_stopped(stops)
            talk.command("$H", HOME_S)
            self._unless_stopped(stops)
        finally:
            self._homing = False
        self._restarts = talk.restarts  # whatever restarted it before: it knows where it is
        self._moved_after = talk.asked
        self._find_position(talk)
        self._park(stops)

    def _unless_stopped(self, stops: int) -> None:
        if stops != self._stops:
            raise DeviceFault(self.name, "stopped on the way to its home")

    def _park(self, stops: int) -> None:
        """From the switches to where the scan's workspace begins."""
        if self._settings.park_mm is None:
            return
        here, target = self.pose(), Pose(*(1e-3 * v for v in self._settings.park_mm))
        speed_m_s = 1e-3 * self._settings.max_speed_mm_s
        self._unless_stopped(stops)
        self.move(target, speed_m_s)
        end = time.monotonic() + 2 * math.dist(here[:3], target[:3]) / speed_m_s + 2.0
        while self.moving():
            if time.monotonic() > end:
                raise DeviceFault(self.name, "has not reached park_mm")
            time.sleep(self._period_s)
        self._unless_stopped(stops)

    def moving(self) -> bool:
        """True until the last move has ended. Raises `DeviceFault` on an alarm or a lost line."""
        talk = self._line()
        status = talk.status
        if status is not None:
            self._check(talk, status)
        new = talk.newer(self._moved_after)
        held = new is not None and new.state == "Hold"
        if held and not self._probing and self._stops == self._stops_before:
            raise MotionFault(self.name, STATES["Hold"])
        return new is None or new.state in MOVING

    def stop(self) -> None:
        """Slow down at the board's acceleration and forget the rest of the move."""
        self._stops += 1
        if (talk := self._talk) is not None:
            self._send_stop(talk)

    def close(self) -> None:
        """Stop and release the port."""
        talk, self._talk = self._talk, None
        if talk is not None:
            if talk.gone is None:
                self._send_stop(talk)
            if talk.unanswered:  # a line that the board takes late must not move it unguarded
                self._talk = talk
                with suppress(DeviceFault):
                    talk.wait(lambda: not self._stopping.is_set(), LATE_LINE_S, "")
                self._talk = None
            talk.close()

    def _send_stop(self, talk: Conversation) -> None:
        if self._homing:
            self._reset(talk)
            return
        self._stopping.set()
        talk.realtime(HOLD if self._probing else JOG_CANCEL)

    def _reset(self, talk: Conversation) -> None:
        self._restarts += 1
        talk.realtime(RESET)

    def _tell_slow_axes(self, talk: Conversation) -> None:
        """The board itself slows a move that is too fast for an axis, and says nothing."""
        for axis, number in zip("xyz", MAX_RATE, strict=True):
            rate_mm_s = talk.settings.get(number, math.inf) / 60
            if rate_mm_s < self._settings.max_speed_mm_s * (1 - 1e-6):
                log.warning(
                    "%s: the board moves %s at %.4g mm/s at most ($%d), not max_speed_mm_s = %g",
                    self.name, axis, rate_mm_s, number, self._settings.max_speed_mm_s,
                )  # fmt: skip

    def _finish_stop(self, status: Status) -> None:
        """In the reader's thread: repeat a stop that was not heard; flush what a hold left."""
        talk = self._talk
        if talk is None or not self._stopping.is_set():
            return
        if status.state == "Hold" and status.substate in (0, None):
            self._reset(talk)  # at rest, so the position is kept
            self._stopping.clear()
        elif status.state in ("Jog", "Run"):
            talk.realtime(JOG_CANCEL if status.state == "Jog" else HOLD)
        elif status.state != "Hold" and not talk.unanswered:
            self._stopping.clear()

    def _line(self) -> Conversation:
        if self._talk is None:
            raise DeviceFault(self.name, "not connected")
        return self._talk

    def _fresh(self, talk: Conversation) -> Status:
        return talk.fresh(self._settings.silent_s)

    def _check(self, talk: Conversation, status: Status) -> None:
        if talk.gone is not None:
            raise DeviceFault(self.name, f"connection lost ({talk.gone})")
        if talk.alarm is not None or status.state == "Alarm":
            raise DeviceFault(self.name, talk.alarm or "alarm; the board does not say which")
        if talk.restarts > self._restarts:
            raise DeviceFault(self.name, "the board restarted by itself; home again")
        age_s = time.monotonic() - status.arrival_s
        if age_s > self._settings.silent_s:
            allowed = f"silent_s = {self._settings.silent_s:g}"
            raise DeviceFault(self.name, f"silent for {age_s:.2f} s; allowed: {allowed}")

    def _machine_mm(self, target: Pose) -> Point:
        check_target(self.name, self.limits_mm, target)
        x, y, z = (1e3 * at + o for at, o in zip(target, self._settings.origin_mm, strict=False))
        return (x, y, z)

    def _scan_m(self, reported: Point) -> Point:
        x, y, z = (
            1e-3 * (self._unit_mm * at - o)
            for at, o in zip(reported, self._settings.origin_mm, strict=True)
        )
        return (x, y, z)


def open_stage(_clock: Clock, settings: GrblSettings) -> GrblStage:
    """The board at ``settings.port``, not yet connected."""
    return GrblStage(settings)
