"""GRBL 1.1 and grblHAL: three axes that carry the probe, over serial, pty or TCP.

Moves are jogs (``$J=``): the board refuses one beyond its travel, and a jog can be cancelled at
any moment without losing the position. Machine frame = scan frame + ``origin_mm``; z up, as the
boards have it.
"""

import logging
import math
import time
from collections.abc import Sequence
from contextlib import suppress
from functools import partial

from drivers.core.abilities import StopMeans
from drivers.core.errors import ConfigError, DeviceAbsent, DeviceFault
from drivers.core.ports import PortName, nobody_else, open_port
from drivers.core.protocols import Clock, Pose
from drivers.core.segments import Place
from drivers.core.settings import Baud, Point, Positive, Settings
from drivers.core.stage_limits import Limits, check_speed, check_target, check_upright
from drivers.grbl.board import REPORT_MASK, BoardSettings, in_machine
from drivers.grbl.line import HOLD, Conversation, Status
from drivers.grbl.motion import HEARD_S, Motion
from drivers.grbl.words import STATES, pins_in_words

log = logging.getLogger("palpate")
LATE_LINE_S = 2.0  # a line that has waited this long in a board that works is lost
HELLO_S = 4.0  # an Arduino that resets when its port is opened needs two seconds
HOME_S = 120.0
SETTINGS_S = 2.0
OFFSET_REPORTS = 35  # GRBL 1.1 reports the offset every 10 to 30 reports
REPORT_S = 0.02  # between two reports, at least
LOST = (
    "it was reset while it moved, as no other stop was obeyed: where it is is known only once it "
    "was homed"
)
UNLOCKED_S = 0.5  # its greeting, and the answer to $X: as long as a line may take
UP_MM = 0.05  # sideways in a move that is called straight up: a report's rounding in inches, twice


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
        self._motion: Motion | None = None
        self._stops = 0

    def connect(self) -> None:
        """Open the port, greet the board, read its settings."""
        if self._talk is not None:
            return
        keys = self._settings
        line = open_port(self.name, keys.port, keys.baud)
        talk = Conversation(self.name, line, self._period_s)
        motion = Motion(self.name, talk, BoardSettings({}), self._period_s, keys.answer_s)
        try:
            status = talk.fresh(HELLO_S)
            self._read_settings(talk, motion, locked=status.state == "Alarm")
        except DeviceFault as fault:
            talk.close()
            if talk.unfit is not None:
                raise DeviceFault(self.name, talk.unfit) from None
            raise DeviceAbsent(
                self.name, f"no GRBL answers at {keys.port}: {fault.reason}"
                f"{nobody_else(keys.port)}. GRBL 1.1 is silent "
                "after a limit alarm until it is reset (its button, or power), and while it homes"
            ) from None  # fmt: skip
        motion.own_resets = talk.restarts  # opening the port resets an Arduino
        self._motion = motion
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
        talk, motion = self._line()
        status = self._fresh(talk)
        if status.state in STATES:
            raise DeviceFault(self.name, STATES[status.state])
        if pressed := pins_in_words(status.pins):
            raise DeviceFault(self.name, f"active at rest: {pressed}")
        if motion.lost:
            raise DeviceFault(self.name, LOST)
        return motion.board.notes() + ["its probe contact is closed"] * ("P" in status.pins)

    def _read_settings(self, talk: Conversation, motion: Motion, *, locked: bool) -> None:
        """After some alarms a board reports its settings only once it was reset, as homing does."""
        try:
            talk.command("$$", SETTINGS_S)
        except DeviceFault:
            if not locked:
                raise
            return
        motion.board = BoardSettings(talk.settings)
        speed_mm_s = self._settings.max_speed_mm_s
        for slow in motion.board.slower_than(speed_mm_s):
            log.warning("%s: %s, not max_speed_mm_s = %g", self.name, slow, speed_mm_s)

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
        talk, motion = self._line()
        status = self._fresh(talk)
        self._check(talk, motion, status)
        return self._scan_pose(self._place(motion, status))

    def unreachable(self, poses: Sequence[Pose]) -> dict[Pose, str]:
        """Those beyond the travel that the board's settings give. Raises `DeviceFault`."""
        talk, motion = self._line()
        here, origin_mm = self._place(motion, self._fresh(talk)), self._settings.origin_mm
        why = {p: motion.board.beyond_travel(here, in_machine(p, origin_mm)) for p in poses}
        return {pose: words for pose, words in why.items() if words is not None}

    def move(self, target: Pose, speed_m_s: float) -> None:
        """Set off. Raises `DeviceFault` if out of bounds, too fast, moving, or refused.

        The board gets the way in segments, and rests soon when no more of them come; see
        `drivers.core.segments`.
        """
        talk, motion = self._line()
        status = self._fresh(talk)
        self._check(talk, motion, status)
        if motion.moves():
            raise DeviceFault(self.name, "still moving; wait or stop before the next move")
        check_speed(self.name, self._settings.max_speed_mm_s, speed_m_s)
        check_upright(self.name, target)
        check_target(self.name, self.limits_mm, target)
        here, to = self._place(motion, status), in_machine(target, self._settings.origin_mm)
        if motion.lost and (to[2] < here[2] or math.dist(here[:2], to[:2]) > UP_MM):
            raise DeviceFault(self.name, LOST)
        if (beyond := motion.board.beyond_travel(here, to)) is not None:
            raise DeviceFault(self.name, beyond)
        stops = self._stops
        motion.begin(here, to, 1e3 * speed_m_s)
        if stops != self._stops:  # stopped while the board was thinking
            motion.stop()

    def keep_alive(self) -> None:
        """Whoever checks the force has just done so; without these calls a move is not gone on
        with, once there was one."""
        if (motion := self._motion) is not None:
            motion.guarded_s = time.monotonic()

    def probe(self, depth_m: float, speed_m_s: float, timeout_s: float = 60.0) -> Pose:
        """Go down by ``depth_m`` until the board's probe input closes; where it closed.

        Blocks. The board halts a little below, so this is its latched position, not the last
        one. Raises `DeviceFault` if there was no contact, or already one before.
        """
        talk, motion = self._line()
        if depth_m <= 0:
            raise ConfigError(f"depth_m = {depth_m:g}: must be above 0")
        talk.probed, motion.probing = None, True
        try:
            feed = 60e3 * speed_m_s
            talk.command(f"G21G91G38.2Z{-1e3 * depth_m:.4f}F{feed:.3f}", timeout_s)
            talk.command("G90", self._settings.answer_s)
            motion.moved_after = talk.asked
            talk.wait(lambda: talk.probed is not None, self._settings.answer_s, "no probe report")
        except DeviceFault as fault:
            raise DeviceFault(self.name, talk.alarm or fault.reason) from None
        finally:
            motion.probing = False
        assert talk.probed is not None
        position, hit = talk.probed
        if not hit:
            raise DeviceFault(self.name, talk.alarm or "probe: no contact within the move")
        x, y, z = (motion.board.unit_mm * at for at in position)
        return self._scan_pose((x, y, z))

    def home(self) -> None:
        """Run the homing cycle, then go to ``park_mm``; blocks. Raises `DeviceFault`.

        A `stop` breaks it off at any instant: during the cycle by a reset, the only thing that a
        board listens to then.
        """
        (talk, motion), stops = self._line(), self._stops
        if self._fresh(talk).state == "Alarm":  # after some alarms only a reset is listened to
            motion.reset()
            asked = motion.own_resets
            talk.wait(lambda: talk.restarts >= asked, HELLO_S, "no greeting after a reset")
            talk.fresh(HELLO_S)  # grblHAL reports ALARM:11, homing required, after its greeting
        talk.alarm = None
        self._read_settings(talk, motion, locked=False)
        motion.homing = True
        try:
            self._unless_stopped(stops)
            talk.command("$H", HOME_S)
            self._unless_stopped(stops)
        finally:
            motion.homing = False
        motion.own_resets = talk.restarts  # whatever restarted it before: it knows where it is
        motion.lost = False
        motion.moved_after = talk.asked
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
        """True until the last move has ended. Raises `MotionFault` if it was broken off, and
        `DeviceFault` on an alarm or a lost line."""
        talk, motion = self._line()
        if talk.status is not None:
            self._check(talk, motion, talk.status)
        return motion.moves()

    def stop(self) -> None:
        """Slow down at the board's acceleration and forget the rest of the move."""
        self._stops += 1
        if (motion := self._motion) is not None:
            motion.stop()

    def stop_means(self) -> tuple[StopMeans, ...]:
        """A jog cancel (its eighth bit is set: a 7-bit line loses it), a feed hold, a reset.

        A jog is cancelled by a hold, too. After a reset in motion the board is unlocked, and lifts.
        """
        motion = self._motion
        if motion is None:
            return (StopMeans("stop", self.stop, math.inf),)
        braking_s = motion.board.braking_s(self._settings.max_speed_mm_s)
        heard_s = HEARD_S + self._period_s
        return (
            StopMeans("jog cancel (0x85)", self.stop, heard_s + braking_s),
            StopMeans("feed hold (!)", partial(motion.stop, HOLD), heard_s + braking_s),
            StopMeans("reset (0x18)", motion.cut, heard_s + UNLOCKED_S),
        )

    def close(self) -> None:
        """Stop and release the port."""
        talk, motion, self._talk, self._motion = self._talk, self._motion, None, None
        if talk is None or motion is None:
            return
        if talk.gone is None:
            motion.stop()
        if talk.unanswered:  # a line that the board takes late must not move it unguarded
            with suppress(DeviceFault):
                talk.wait(lambda: not motion.stopping, LATE_LINE_S, "")
        talk.close()

    def _line(self) -> tuple[Conversation, Motion]:
        if self._talk is None or self._motion is None:
            raise DeviceFault(self.name, "not connected")
        return self._talk, self._motion

    def _fresh(self, talk: Conversation) -> Status:
        return talk.fresh(self._settings.silent_s)

    def _check(self, talk: Conversation, motion: Motion, status: Status) -> None:
        if talk.gone is not None:
            raise DeviceFault(self.name, f"connection lost ({talk.gone})")
        if talk.alarm is not None or status.state == "Alarm":
            raise DeviceFault(self.name, talk.alarm or "alarm; the board does not say which")
        if talk.restarts > motion.own_resets:
            raise DeviceFault(self.name, "the board restarted by itself; home again")
        age_s = time.monotonic() - status.arrival_s
        if age_s > self._settings.silent_s:
            allowed = f"silent_s = {self._settings.silent_s:g}"
            raise DeviceFault(self.name, f"silent for {age_s:.2f} s; allowed: {allowed}")

    def _place(self, motion: Motion, status: Status) -> Place:
        if (place := motion.place(status)) is None:
            raise DeviceFault(self.name, "has not reported where the machine is ($10)")
        return place

    def _scan_pose(self, place: Place) -> Pose:
        x, y, z = (1e-3 * (at - o) for at, o in zip(place, self._settings.origin_mm, strict=True))
        return Pose(x, y, z)


def open_stage(_clock: Clock, settings: GrblSettings) -> GrblStage:
    """The board at ``settings.port``, not yet connected."""
    return GrblStage(settings)
