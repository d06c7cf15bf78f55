"""GRBL 1.1 and grblHAL: three axes that carry the probe, over serial, pty or TCP.

Moves are jogs (``$J=``): the board refuses one beyond its travel, and a jog can be cancelled at
any moment without losing the position. Machine frame = scan frame + ``origin_mm``; z up, as the
boards have it.
"""

import logging
import math
import threading
import time

from drivers.errors import ConfigError, DeviceAbsent, DeviceFault
from drivers.grbl_line import HOLD, JOG_CANCEL, RESET, Conversation, Point, Status
from drivers.ports import open_port
from drivers.protocols import Clock, Pose

log = logging.getLogger("palpate")
ANSWER_S = 0.5
STALE_S = 0.25
HELLO_S = 4.0  # an Arduino that resets when its port is opened needs two seconds
HOME_S = 120.0
INCH_MM = 25.4
MOVING = ("Jog", "Run", "Hold", "Home", "Door")
REPORT_INCHES, HARD_LIMITS, SOFT_LIMITS, HOMING = 13, 21, 20, 22
MAX_RATE = (110, 111, 112)  # mm/min

Limits = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


class GrblStage:
    """A stage on a GRBL board."""

    def __init__(
        self,
        name: str,
        port: str,
        baud: int,
        origin_mm: Point,
        limits_mm: Limits | None,
        max_speed_mm_s: float,
        home: bool,
        park_mm: Point | None,
        period_s: float,
        simulated: bool,
    ) -> None:
        self.name = name
        self.simulated = simulated
        self._port = port
        self._baud = baud
        self._origin_mm = origin_mm
        self._limits_mm = limits_mm
        self._max_speed_mm_s = max_speed_mm_s
        self._home = home
        self._park_mm = park_mm
        self._period_s = period_s
        self._talk: Conversation | None = None
        self._unit_mm = 1.0
        self._probing = False
        self._stops = 0
        self._stopping = threading.Event()
        self._moved_after = 0  # status requests sent before the last move was accepted
        self._restarts = 0  # those we asked for

    def connect(self) -> None:
        """Open the port, greet the board, read its settings, home it if the rig says so."""
        if self._talk is not None:
            return
        line = open_port(self.name, self._port, self._baud)
        talk = Conversation(self.name, line, self._period_s)
        try:
            status = talk.fresh(HELLO_S)
            talk.command("$$", 2.0)
        except DeviceFault as fault:
            talk.close()
            raise DeviceAbsent(
                self.name, f"no GRBL answers at {self._port}: {fault.reason}"
            ) from None
        self._unit_mm = INCH_MM if talk.settings.get(REPORT_INCHES) else 1.0
        self._tell_slow_axes(talk)
        self._stopping.clear()
        self._restarts = talk.restarts  # opening the port resets an Arduino
        talk.after_status = self._finish_stop
        self._moved_after = 0
        self._talk = talk
        try:
            if self._home:
                self.home()
                self._park()
            elif status.state == "Alarm":
                why = talk.alarm or "locked"
                raise DeviceFault(
                    self.name, f"{why}; home it (home = true in the rig file) or clear it with $X"
                )
        except BaseException:
            self.close()
            raise

    def pose(self) -> Pose:
        """The tip as the board reports it, asked for now."""
        talk = self._line()
        status = talk.fresh(STALE_S)
        self._check(talk, status)
        return Pose(*self._scan_m(status.position))

    def move(self, target: Pose, speed_m_s: float) -> None:
        """Set off. Raises `DeviceFault` if out of bounds, too fast, moving, or refused."""
        talk = self._line()
        self._check(talk, talk.fresh(STALE_S))
        if self.moving():
            raise DeviceFault(self.name, "still moving; wait or stop before the next move")
        self._check_speed(target, speed_m_s)
        machine = self._machine_mm(target)
        words = "".join(f"{axis}{at:.4f}" for axis, at in zip("XYZ", machine, strict=True))
        stops = self._stops
        talk.command(f"$J=G21G90G53{words}F{60e3 * speed_m_s:.3f}", ANSWER_S)
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
            talk.command("G90", ANSWER_S)
            self._moved_after = talk.asked
            talk.wait(lambda: talk.probed is not None, ANSWER_S, "no probe report")
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
        """Run the homing cycle; blocks. Raises `DeviceFault`."""
        talk = self._line()
        if talk.fresh(STALE_S).state == "Alarm":  # after some alarms only a reset is listened to
            self._reset(talk)
            asked = self._restarts
            talk.wait(lambda: talk.restarts >= asked, HELLO_S, "no greeting after a reset")
            talk.fresh(HELLO_S)  # grblHAL tells ALARM:11, homing required, after its greeting
        talk.alarm = None
        talk.command("$H", HOME_S)
        self._moved_after = talk.asked

    def unlock(self) -> None:
        """Leave an alarm whose cause is gone. The position may be wrong until homed again."""
        talk = self._line()
        talk.alarm = None
        talk.command("$X", ANSWER_S)

    def _park(self) -> None:
        """From the switches to where the scan's workspace begins."""
        if self._park_mm is None:
            return
        here, target = self.pose(), Pose(*(1e-3 * v for v in self._park_mm))
        speed_m_s = 1e-3 * self._max_speed_mm_s
        self.move(target, speed_m_s)
        end = time.monotonic() + 2 * math.dist(here[:3], target[:3]) / speed_m_s + 2.0
        while self.moving():
            if time.monotonic() > end:
                raise DeviceFault(self.name, "has not reached park_mm")
            time.sleep(self._period_s)

    def moving(self) -> bool:
        """True until the last move has ended. Raises `DeviceFault` on an alarm or a lost line."""
        talk = self._line()
        status = talk.status
        if status is not None:
            self._check(talk, status)
        new = talk.newer(self._moved_after)
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
            talk.close()

    def _send_stop(self, talk: Conversation) -> None:
        self._stopping.set()
        talk.realtime(HOLD if self._probing else JOG_CANCEL)

    def _reset(self, talk: Conversation) -> None:
        self._restarts += 1
        talk.realtime(RESET)

    def _tell_slow_axes(self, talk: Conversation) -> None:
        """The board itself slows a move that is too fast for an axis, and says nothing."""
        for axis, number in zip("xyz", MAX_RATE, strict=True):
            rate_mm_s = talk.settings.get(number, math.inf) / 60
            if rate_mm_s < self._max_speed_mm_s * (1 - 1e-6):
                log.warning(
                    "%s: the board moves %s at %.4g mm/s at most ($%d), not max_speed_mm_s = %g",
                    self.name, axis, rate_mm_s, number, self._max_speed_mm_s,
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
        elif status.state != "Hold":
            self._stopping.clear()

    def _line(self) -> Conversation:
        if self._talk is None:
            raise DeviceFault(self.name, "not connected")
        return self._talk

    def _check(self, talk: Conversation, status: Status) -> None:
        if talk.gone is not None:
            raise DeviceFault(self.name, f"connection lost ({talk.gone})")
        if talk.alarm is not None or status.state == "Alarm":
            raise DeviceFault(self.name, talk.alarm or "alarm; the board does not say which")
        if talk.restarts > self._restarts:
            raise DeviceFault(self.name, "the board restarted by itself; home again")
        age_s = time.monotonic() - status.arrival_s
        if age_s > STALE_S:
            raise DeviceFault(self.name, f"silent for {age_s:.2f} s")

    def _check_speed(self, target: Pose, speed_m_s: float) -> None:
        speed = 1e3 * speed_m_s
        if not 0 < speed <= self._max_speed_mm_s * (1 + 1e-9):
            raise DeviceFault(
                self.name, f"speed {speed:g} mm/s; allowed: up to {self._max_speed_mm_s:g} mm/s"
            )
        if any(target[3:]):
            raise DeviceFault(self.name, "has no axes to tilt the probe")

    def _machine_mm(self, target: Pose) -> Point:
        if self._limits_mm is not None:
            for axis, at, (low, high) in zip("xyz", target, self._limits_mm, strict=False):
                if not low <= 1e3 * at <= high:
                    raise DeviceFault(
                        self.name, f"{axis} = {1e3 * at:g} mm; allowed: {low:g} to {high:g} mm"
                    )
        x, y, z = (1e3 * at + o for at, o in zip(target, self._origin_mm, strict=False))
        return (x, y, z)

    def _scan_m(self, reported: Point) -> Point:
        x, y, z = (
            1e-3 * (self._unit_mm * at - o) for at, o in zip(reported, self._origin_mm, strict=True)
        )
        return (x, y, z)


def open_stage(
    _clock: Clock,
    *,
    port: str,
    baud: int = 115200,
    name: str = "grbl",
    simulated: bool = False,
    origin_mm: Point = (0.0, 0.0, 0.0),
    limits_mm: Limits | None = None,
    max_speed_mm_s: float = 25.0,
    home: bool = False,
    park_mm: Point | None = None,
    status_hz: float = 50.0,
) -> GrblStage:
    """A GRBL or grblHAL board at ``port`` (a path, ``COM3`` or ``socket://host:port``).

    ``origin_mm``: where the scan's (0, 0, 0) lies in machine coordinates. ``home`` moves the
    machine to its switches at connection, and then to ``park_mm`` in the scan frame, where
    ``limits_mm`` bounds the targets too. ``simulated``: an emulated board is at the other end.
    Raises `ConfigError`.
    """
    for key, value in (
        ("baud", baud),
        ("max_speed_mm_s", max_speed_mm_s),
        ("status_hz", status_hz),
    ):
        if not (math.isfinite(value) and value > 0):
            raise ConfigError(f"{key} = {value:g}: must be above 0")
    return GrblStage(
        name,
        port,
        baud,
        origin_mm,
        limits_mm,
        max_speed_mm_s,
        home,
        park_mm,
        1 / status_hz,
        simulated,
    )
