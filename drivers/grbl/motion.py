"""The move under way, as the thread sees it that hears every report: fed, watched, and stopped."""

import math
import time
from typing import Literal

from drivers.core.errors import DeviceFault, MotionFault
from drivers.core.segments import AHEAD_S, RESTS_S, Place, SegmentedMove
from drivers.grbl.board import BoardSettings
from drivers.grbl.line import HOLD, JOG_CANCEL, RESET, Conversation, Status
from drivers.grbl.words import DOOR, STATES, alarm_in_words

MOVING = ("Jog", "Run", "Hold", "Home", "Door")
HEARD_S = 0.1
"""A stop shows within this and the braking: grblHAL's last step came 66 ms after it (20 mm/s,
500 mm/s2), its report up to 12 ms later."""
CUT_AGAIN_S = 1.0  # a board that is reset again and again does nothing else
WHILE_MOVING = alarm_in_words(3)


class Motion:
    """Of one board. ``moved_after`` is the number of reports asked for before the last order."""

    def __init__(
        self, name: str, talk: Conversation, board: BoardSettings, period_s: float, answer_s: float
    ) -> None:
        self.moved_after = 0
        self.own_resets = talk.restarts  # opening the port resets an Arduino
        self.lost = False  # reset while it moved: where it is is known only once it was homed
        self.guarded_s: float | None = None  # when somebody last checked the force
        self.probing = self.homing = False
        self.board = board
        self._name, self._talk = name, talk
        self._period_s, self._answer_s = period_s, answer_s
        self._way: SegmentedMove | None = None
        self._trouble: str | None = None
        self._still: tuple[float, Place] | None = None  # since when it stands where
        self._cut_s = -math.inf  # when it was reset in motion
        self._unlock: Literal["", "wanted", "asked"] = ""
        self.stopping = False  # repeated until it is seen to rest
        talk.after_status, talk.after_reply = self._heard, self._confirmed

    def begin(self, start: Place, target: Place, speed_mm_s: float) -> None:
        """Set off [machine, mm]; only the first segment is waited for. Raises `DeviceFault`.

        A move straight up is given whole: it leads out of whatever is below, also with nobody
        there to send the rest.
        """
        way = (target[0] - start[0], target[1] - start[1], target[2] - start[2])
        ahead_mm = (AHEAD_S + self._period_s) * speed_mm_s + self.board.braking_mm(speed_mm_s, way)
        up = way[2] > 0 and max(map(abs, way[:2])) < self.board.two_steps_mm()
        move = SegmentedMove(
            start, target, speed_mm_s, ahead_mm=math.inf if up else ahead_mm,
            shortest_mm=self.board.two_steps_mm(),
        )  # fmt: skip
        self.stopping = False  # the move before: it rests, or its line is lost
        self._trouble, self._still = None, None
        self._talk.command(_jog(move.next(start) or target, speed_mm_s), self._answer_s)
        with self._talk.arrived:
            self.moved_after, self._way = self._talk.asked, move
            self._feed()

    def stop(self, order: bytes = JOG_CANCEL) -> None:
        """Send no more, and have it stop; from any thread. Only a hold ends a probe."""
        self._way, self._trouble = None, None
        if self.homing:  # a board listens to nothing else then
            self.reset()
        else:
            self.stopping = True
            self._talk.realtime(HOLD if self.probing else order)

    def cut(self) -> None:
        """The steps end at once, and with them what is known of the place."""
        self._way, self._trouble = None, None
        if time.monotonic() - self._cut_s > CUT_AGAIN_S:
            self._cut_s, self.lost, self._unlock = time.monotonic(), True, "wanted"
            self.reset()

    def reset(self) -> None:
        """At rest, so that the place is kept; or while homing."""
        self.own_resets += 1
        self._talk.realtime(RESET)

    def moves(self) -> bool:
        """Whether it does, or still has some way to go. Raises `MotionFault` where it does not."""
        talk = self._talk
        if self._trouble is not None:
            raise MotionFault(self._name, self._trouble)
        if self._way is not None and talk.unanswered and self._late_s() > self._answer_s:
            raise DeviceFault(self._name, f"no answer to a jog within {self._answer_s:g} s")
        new = talk.newer(self.moved_after)
        if new is None:
            return True
        if (why := _held(new)) is not None and new.state != "Hold" and not self.probing:
            raise MotionFault(self._name, why)
        if self._way is None and not self.probing and self._stood_s(new) > RESTS_S:
            return False
        if new.state in MOVING or (self._way is not None and not self._way.whole):
            return True
        self._way = None
        return False

    def _late_s(self) -> float:
        return time.monotonic() - self._talk.sent_s

    def _stood_s(self, status: Status) -> float:
        return status.arrival_s - self._still[0] if self._still is not None else 0.0

    def place(self, status: Status) -> Place | None:
        """In machine coordinates [mm]."""
        if status.position is None:
            return None
        x, y, z = (self.board.unit_mm * at for at in status.position)
        return (x, y, z)

    # --- in the thread that hears the board ------------------------------------------------------

    def _heard(self, status: Status) -> None:
        place = self.place(status)
        if place is not None and (self._still is None or place != self._still[1]):
            self._still = (status.arrival_s, place)
        if self.stopping:
            self._see_to_the_stop(status)
        elif self._way is not None and place is not None:
            self._watch(self._way, status, place)
            self._feed()
        if self._unlock and status.state == "Alarm" and not self._talk.unanswered:
            self._see_to_the_lock()

    def _confirmed(self) -> None:
        """The board has taken a line, or refused it."""
        if self._way is not None:
            self.moved_after = self._talk.asked
            self._feed()

    def _feed(self) -> None:
        """The next segment, once the last is confirmed, and while somebody checks the force."""
        move, talk = self._way, self._talk
        if move is None or self.stopping or talk.unanswered:
            return
        if talk.refused is not None:
            self._trouble = f"a jog was refused: {talk.refused}"
        status, now_s = talk.status, time.monotonic()
        alone = self.guarded_s is not None and now_s - self.guarded_s > AHEAD_S
        if status is None or self._trouble is not None or alone:
            return
        place = self.place(status)
        if place is not None and (to := move.next(place)) is not None:
            talk.send(_jog(to, move.speed_mm_s))

    def _watch(self, move: SegmentedMove, status: Status, place: Place) -> None:
        """Whether somebody or something else has come between, even if it goes on again."""
        if (why := _held(status)) is not None:
            self._trouble = self._trouble or why
            return
        if move.way_mm(place) >= move.given_mm - move.shortest_mm:
            return
        stood_s, idle = self._stood_s(status), status.state == "Idle"
        if idle and not self._talk.unanswered and stood_s > RESTS_S:
            off_mm = math.dist(place, move.target)
            self._trouble = (
                f"came to rest {off_mm:.2f} mm from its target: somebody held it, or has cancelled "
                "its jog"
            )

    def _see_to_the_stop(self, status: Status) -> None:
        """Repeat one that was not heard; what is left of the move must not go on by itself."""
        hold = status.state == "Hold" and status.substate in (0, None)
        if hold or (status.state == "Door" and status.substate == 0):  # the door is shut again
            self.reset()  # at rest, so the place is kept
            self.stopping = False
        elif status.state in ("Jog", "Run"):
            self._talk.realtime(JOG_CANCEL if status.state == "Jog" else HOLD)
        elif status.state not in ("Hold", "Door") and not self._talk.unanswered:
            self.stopping = False

    def _see_to_the_lock(self) -> None:
        """Open it so that the probe can be lifted: it is of our own making."""
        talk = self._talk
        if self._unlock == "wanted" and talk.alarm == WHILE_MOVING:
            talk.alarm, self._unlock = None, "asked"
            talk.send("$X")
        elif self._unlock == "asked" and talk.refused is not None:
            self._unlock = ""
            talk.alarm = f"{WHILE_MOVING}; it cannot be unlocked ({talk.refused})"


def _jog(to: Place, speed_mm_s: float) -> str:
    words = "".join(f"{axis}{at:.4f}" for axis, at in zip("XYZ", to, strict=True))
    return f"$J=G21G90G53{words}F{60 * speed_mm_s:.3f}"


def _held(status: Status) -> str | None:
    """Who holds it, in words; grblHAL jogs on, at rest, while its door stands open."""
    if DOOR in status.pins:
        return STATES["Door"]
    return STATES.get(status.state) if status.state not in ("Run", "Check") else None
