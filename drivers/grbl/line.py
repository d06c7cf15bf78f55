"""A conversation with GRBL or grblHAL: one thread reads, status is asked for without end.

Single real-time bytes (``?``, ``!``, 0x85, 0x18) may be sent in the middle of anything, so they
wait for no lock; lines wait for their ``ok``.
"""

import math
import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from drivers.core.errors import DeviceFault
from drivers.core.ports import READ_S, Port, read_some
from drivers.grbl.words import alarm_in_words, error_in_words

STATUS = b"?"
HOLD = b"!"
RESET = b"\x18"
JOG_CANCEL = b"\x85"

ASK_AGAIN_S = 0.1  # an unanswered `?` is repeated after this
LOOK_S = 0.001
PUZZLES = 5  # reports of another dialect with none of ours between: noise does not do that
LINE_MAX = 4096

Point = tuple[float, float, float]
_FIELD = re.compile(r"(MPos|WPos|WCO|Pn):([^|>]*)")
_STATE = re.compile(r"<([A-Za-z]+)(?::(\d+))?((?:\|[^|>]*)*)>")
_OLD_STATE = re.compile(r"<[A-Za-z]+,[MW]Pos:")
_NUMBER = r"(-?\d+(?:\.\d+)?)"
_PROBE = re.compile(rf"\[PRB:{_NUMBER},{_NUMBER},{_NUMBER}(?:,[-\d.]+)*:([01])\]")
_SETTING = re.compile(  # some explain each in brackets; grblHAL also has text settings
    r"\$(\d+)\s*=\s*(-?\d+(?:\.\d+)?)(?:[\s(].*)?"
)
OLD = (
    "it speaks GRBL 0.9 or older, which knows no jogs: a move could not be broken off where it is; "
    "load GRBL 1.1 or grblHAL onto the board"
)
TWO_AXES = (
    "it reports two axes, x and y, and the probe is pressed along z: load a GRBL that was built "
    "for three"
)


@dataclass(frozen=True)
class Status:
    """One status report. ``position`` is the machine's, in the report's unit.

    It is None as long as the board has reported only work positions, and not where their zero is.
    ``number`` counts the requests sent before the one it answers.
    """

    state: str
    substate: int | None
    position: Point | None
    pins: str
    number: int
    arrival_s: float


class Conversation:
    """The open line. ``arrived`` is notified at every report, reply and fault."""

    def __init__(self, device: str, line: Port, period_s: float) -> None:
        self.status: Status | None = None
        self.probed: tuple[Point, bool] | None = None
        self.settings: dict[int, float] = {}
        self.alarm: str | None = None
        self.gone: str | None = None
        self.unfit: str | None = None  # why a board that answers cannot be used
        self.refused: str | None = None  # what it said against the last line, in words
        self.restarts = 0
        self.asked = 0
        self.unanswered = False  # the last line: the board may still carry it out
        self.sent_s = -math.inf  # when that was
        self.arrived = threading.Condition()
        self.after_status: Callable[[Status], None] = lambda _status: None
        self.after_reply: Callable[[], None] = lambda: None
        self._device = device
        self._line = line
        self._period_s = period_s
        self._answered = True
        self._puzzled = 0
        self._asked_s = -1.0
        self._offset: Point | None = None  # of work coordinates, once reported
        self._partial = b""
        self._replies: list[str] = []
        self._one_line = threading.Lock()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._follow, name=f"palpate {device}", daemon=True)
        self._thread.start()

    def realtime(self, byte: bytes) -> None:
        """Send one real-time byte now. Never raises: the reader notices a lost line."""
        try:
            self._line.write(byte)
        except (OSError, TypeError) as error:  # TypeError: closed under our hands
            self._lose(str(error))

    def command(self, text: str, timeout_s: float) -> None:
        """Send a line and wait for ``ok``. Raises `DeviceFault` with the error in words."""
        with self._one_line:
            alarm = self.alarm
            self.send(text)
            self.wait(
                lambda: bool(self._replies) or self.alarm is not alarm,
                timeout_s,
                f"no answer to {text!r}",
            )
            reply = self._replies[0] if self._replies else str(self.alarm)
        if reply != "ok":
            raise DeviceFault(self._device, f"{text!r} refused: {_in_words(reply)}")

    def send(self, text: str) -> None:
        """Send a line and do not wait: see `unanswered` and `refused`. Never raises."""
        with self.arrived:
            self._replies.clear()
            self.unanswered, self.refused, self.sent_s = True, None, time.monotonic()
        try:
            self._line.write(text.encode("ascii") + b"\n")
        except (OSError, TypeError) as error:
            self._lose(str(error))

    def wait(self, ready: Callable[[], bool], timeout_s: float, otherwise: str) -> None:
        """Wait until ``ready``. Raises `DeviceFault` if not, or if the line is lost meanwhile."""
        with self.arrived:
            self.arrived.wait_for(lambda: ready() or self.gone is not None, timeout_s)
        if self.gone is not None:
            raise DeviceFault(self._device, f"connection lost ({self.gone})")
        if not ready():
            raise DeviceFault(self._device, f"{otherwise} within {timeout_s:g} s")

    def fresh(self, timeout_s: float) -> Status:
        """A status asked for after this call. Raises `DeviceFault`."""
        asked = self.asked
        self.wait(
            lambda: self.newer(asked) is not None or self.unfit is not None, timeout_s, "no status"
        )
        status = self.newer(asked)
        if status is None:
            raise DeviceFault(self._device, str(self.unfit))
        return status

    def newer(self, asked: int) -> Status | None:
        """The latest status, if it answers a request after the first ``asked``."""
        status = self.status
        return status if status is not None and status.number >= asked else None

    def close(self) -> None:
        """End the thread, then close the line."""
        self._end.set()
        self._thread.join(timeout=2.0)
        self._line.close()

    def _lose(self, why: str) -> None:
        with self.arrived:
            self.gone = self.gone or why
            self.arrived.notify_all()

    def _follow(self) -> None:
        try:
            while not self._end.is_set():
                self._ask()
                # a read waits for `READ_S`, longer than until the next question may be due
                if self._line.in_waiting or self._due_in_s() > READ_S:
                    self._take(read_some(self._line))
                else:
                    time.sleep(LOOK_S)
        except (OSError, TypeError) as error:
            self._lose(str(error))
        except Exception as error:  # noqa: BLE001 - a dead reader must not look like silence
            self._lose(f"driver: {type(error).__name__}: {error}")

    def _due_in_s(self) -> float:
        waits_s = self._period_s if self._answered else ASK_AGAIN_S
        return self._asked_s + waits_s - time.monotonic()

    def _ask(self) -> None:
        if self._due_in_s() <= 0:
            self._answered = False
            self._asked_s = time.monotonic()
            self.asked += 1
            self._line.write(STATUS)

    def _take(self, got: bytes) -> None:
        *lines, self._partial = (self._partial + got).split(b"\n")
        self._partial = self._partial[-LINE_MAX:]
        for line in lines:
            self._understand(line.strip().decode("ascii", errors="replace"))

    def _understand(self, text: str) -> None:
        with self.arrived:
            if text.startswith("<"):
                self._report(text)
            elif text == "ok" or text.startswith("error:"):
                self._replies.append(text)
                self.unanswered = False
                self.refused = None if text == "ok" else _in_words(text)
                self.after_reply()
            elif text.startswith("ALARM:"):
                number = text[6:]
                self.alarm = alarm_in_words(int(number)) if number.isdigit() else text
            elif text.lower().startswith("grbl"):
                self.restarts += 1
                self.unanswered = False
                self._replies.append("the board was reset")
            elif found := _PROBE.fullmatch(text):
                x, y, z = (float(v) for v in found.groups()[:3])
                self.probed = ((x, y, z), found[4] == "1")
            elif found := _SETTING.fullmatch(text):
                self.settings[int(found[1])] = float(found[2])
            self.arrived.notify_all()

    def _puzzle(self, why: str | None) -> None:
        """Only a report that always looks like this is no damaged one."""
        self._puzzled += why is not None
        self.unfit = why if self._puzzled >= PUZZLES else self.unfit
        self._answered = self._answered or why is not None

    def _report(self, text: str) -> None:
        """A damaged report is none: the next one is a few milliseconds away."""
        if not (found := _STATE.fullmatch(text)):
            self._puzzle(OLD if _OLD_STATE.match(text) else None)
            return
        fields = dict(_FIELD.findall(found[3]))
        try:
            if "WCO" in fields:
                self._offset = _point(fields["WCO"])
            position: Point | None = None
            if "MPos" in fields:
                position = _point(fields["MPos"])
            else:
                x, y, z = _point(fields["WPos"])
                if (offset := self._offset) is not None:
                    position = (x + offset[0], y + offset[1], z + offset[2])
        except (KeyError, ValueError):
            two = str(fields.get("MPos", fields.get("WPos"))).count(",") == 1
            self._puzzle(TWO_AXES if two else None)
            return
        self.unfit, self._puzzled = None, 0
        substate = None if found[2] is None else int(found[2])
        status = Status(
            found[1], substate, position, fields.get("Pn", ""), self.asked - 1, time.monotonic()
        )
        self._answered = True
        self.status = status
        self.after_status(status)


def _in_words(reply: str) -> str:
    digits = reply.partition(":")[2]
    return error_in_words(int(digits)) if digits.isdigit() else reply


def _point(text: str) -> Point:
    """Raises `ValueError` for what is no place."""
    x, y, z = (float(v) for v in text.split(",")[:3])
    if not all(map(math.isfinite, (x, y, z))):
        raise ValueError(text)
    return (x, y, z)
