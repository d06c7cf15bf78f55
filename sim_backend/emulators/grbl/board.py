"""A GRBL 1.1 board as grblHAL answers: real-time bytes, lines, settings, alarms."""

import re
from collections.abc import Callable
from contextlib import AbstractContextManager

import numpy as np

from sim_backend.arrays import Array
from sim_backend.emulators.grbl.machine import (
    INCH_MM,
    ORIGIN_MM,
    SWITCH_MM,
    GrblMachine,
    Motion,
    Point,
)
from sim_backend.emulators.serving import Served, served
from sim_backend.phantom.phantom import Phantom

BOOT_S = 0.01
BANNER = "\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n"
WORD = re.compile(r"([A-Z])(-?\d*\.?\d+)")


class GrblBoard(GrblMachine):
    """Bytes in, bytes out; see `sim_backend.emulators.serving.Device`."""

    faults = ("alarm", "limit", "restart", "feed hold", "switch pressed", "other program",
              "check mode", "ignores 0x85", "ignores 0x85 and !", "door", "door while jogging",
              "sleep", "frozen reports")  # fmt: skip

    def received(self, data: bytes) -> bytes:
        """Real-time bytes act at once, wherever they stand; lines when they are whole."""
        if np.isfinite(self._locks_s):  # whatever comes waits until the board is up
            self._lock()
        for byte in data:
            match byte:
                case 0x3F:
                    self._said += self._report()
                case 0x21 if self._deaf < 2:
                    self._hold()
                case 0x7E:
                    self._resume()
                case 0x18:
                    self._reset()
                case 0x85 if self._deaf < 1:
                    self._cancel_jog()
                case 0x0A:
                    line, self._text = self._text.strip().upper(), ""
                    self._said += self._line(line)
                case _ if byte < 0x80:
                    self._text += chr(byte)
        return self._take()

    def due(self) -> bytes:
        """Let the machine move on."""
        if self._time() >= self._locks_s:
            self._lock()
        if self._held and self._now is not None:
            self._start(self._now)
        moving = self._held or self._frozen or self._phantom.tip.moving(self._time())
        if self._now is not None and self._now.kind == "Probe" and self._state == "Run":
            self._feel()
        if self._settings[21] and moving and self._beyond(self._place(), SWITCH_MM):
            self._alarm(1)
        if self._state == "Cancel" and not moving:
            self._state = "Idle"
        elif self._state in ("Jog", "Run", "Home") and not moving and not self._dwells():
            self._arrive()
        return self._take()

    def fail(self, fault: str) -> None:
        """``alarm``: emergency stop; ``limit``: a limit switch; ``restart``: power glitch.

        ``door`` as GRBL 1.1 has it: the jog is cancelled; ``door while jogging`` as grblHAL: it
        freezes, and goes on when the door is shut.
        """
        match fault:
            case "ignores 0x85":
                self._deaf = 1
            case "ignores 0x85 and !":
                self._deaf = 2
            case "door":
                self._halt(self._settings[120])
                self._queue.clear()
                self._now, self._state, self._door_open = None, "Door", True
            case "door while jogging":
                self._halt(self._settings[120])
                self._frozen = self._door_open = True
            case "sleep":
                self._halt(self._settings[120])
                self._queue.clear()
                self._now, self._state = None, "Sleep"
            case "frozen reports":
                self._same = self._report()
            case "alarm":
                self._alarm(10)
            case "limit":
                self._alarm(1)
            case "feed hold":  # somebody has pressed the button on the machine
                self._halt(self._settings[120])
                self._queue.clear()
                self._state = "Hold"
            case "switch pressed":
                self._pins = "Z"
            case "other program":
                self._state = "Run"
                self._now = Motion("Dwell", self._place(), 0.0)
            case "check mode":
                self._state = "Check"
            case "restart":
                self._halt(1e6)
                self._queue.clear()
                self._now, self._homed = None, False
                self._state = "Alarm"
                self._said += BANNER

    def mend(self) -> None:
        """Shut the door; hear and report again."""
        self._deaf, self._same, self._door_open = 0, "", False
        if self._frozen:
            self._frozen = False
            if self._now is not None:
                self._start(self._now)

    # --- real time ---------------------------------------------------------------------------

    def _report(self) -> str:
        if self._same:
            return self._same
        moving = self._phantom.tip.moving(self._time())
        door = 0 if not self._door_open else 2 if moving else 1
        state = {
            "Cancel": "Jog", "Hold": f"Hold:{int(moving)}", "Door": f"Door:{door}"
        }.get(self._state, self._state)  # fmt: skip
        scale = INCH_MM if self._settings[13] else 1.0
        touches = self._touching(self._time())
        pins = self._pins + "D" * self._door_open + "P" * touches
        self._reports += 1
        extra = f"|Pn:{pins}" if pins else ""
        if self._settings[10] in (0, 2):  # work positions; grblHAL then never reports their offset
            where = "WPos:" + _numbers((np.array(self._place()) - self._work) / scale)
        else:
            where = "MPos:" + _numbers(np.array(self._place()) / scale)
            if not pins and self._reports % 10 == 1:
                extra = "|WCO:" + _numbers(self._work / scale)
        return f"<{state}|{where}|Bf:100,1023|FS:0,0{extra}>\r\n"

    def _hold(self) -> None:
        if self._state == "Jog":
            self._cancel_jog()
        elif self._state in ("Run", "Idle"):
            self._halt(self._settings[120])
            self._state = "Hold"

    def _resume(self) -> None:
        if self._state != "Hold" and (self._state != "Door" or self._door_open):
            return
        self._state = "Idle"
        if self._now is not None:
            self._start(self._now)

    def _reset(self) -> None:
        if self._phantom.tip.moving(self._time()):
            self._said += "ALARM:3\r\n"
            self._state = "Alarm"
            self._halt(1e6)
        elif self._state == "Sleep":  # the motors were without current
            self._state = "Alarm"
        elif self._state != "Alarm":
            self._state = "Door" if self._door_open else "Idle"
        self._frozen = False
        self._critical = False
        self._queue.clear()
        self._now = None
        self._relative = self._inches = False
        self._text = ""
        self._said += BANNER
        if self._settings[22] and not self._homed:
            self._locks_s = self._time() + BOOT_S

    def _lock(self) -> None:
        """As grblHAL does a moment after its greeting."""
        self._locks_s = np.inf
        self._alarm(11)

    def _cancel_jog(self) -> None:
        if self._state == "Jog" and not self._frozen:
            self._halt(self._settings[120])
            self._queue.clear()
            self._now = None
            self._state = "Cancel"

    # --- lines -------------------------------------------------------------------------------

    def _line(self, line: str) -> str:
        if self._critical:  # only real-time bytes are listened to
            return "error:9\r\n"
        if line == "":
            return "ok\r\n"
        if line == "$$":
            return "".join(f"${n}={v:g}\r\n" for n, v in self._settings.items()) + "ok\r\n"
        if line == "$I":
            return "[VER:1.1f.20240101:]\r\n[OPT:VNMSL,100,1024,3,0]\r\nok\r\n"
        if line == "$X":
            if self._state == "Alarm":
                self._state = "Idle"
            return "ok\r\n"
        if line == "$H":
            return self._home()
        if found := re.fullmatch(r"\$(\d+)=(-?[\d.]+)", line):
            return self._set(int(found[1]), float(found[2]))
        if line.startswith("$J="):
            return self._jog(line[3:])
        if line.startswith("$"):
            return "error:3\r\n"
        return self._program(line)

    def _set(self, number: int, value: float) -> str:
        if number == 20 and value and not self._settings[22]:
            return "error:10\r\n"
        if self._state not in ("Idle", "Alarm"):
            return "error:8\r\n"
        self._settings[number] = value
        return "ok\r\n"

    def _home(self) -> str:
        if not self._settings[22]:
            return "error:5\r\n"
        if self._state not in ("Idle", "Alarm"):
            return "error:8\r\n"
        x, y, _ = self._place()
        pulled = -self._settings[27]
        speed = self._settings[25] / 60
        self._queue.extend(
            [Motion("Home", (x, y, pulled), speed), Motion("Home", (pulled,) * 3, speed)]
        )
        self._state = "Idle"
        self._next()
        return ""  # ``ok`` comes at the end of the cycle

    def _jog(self, words: str) -> str:
        if self._state not in ("Idle", "Jog"):
            return "error:9\r\n"
        pairs = WORD.findall(words)
        if "".join(a + b for a, b in pairs) != words.replace(" ", ""):
            return "error:16\r\n"
        given = {letter: float(value) for letter, value in pairs if letter != "G"}
        codes = [float(value) for letter, value in pairs if letter == "G"]
        if given.get("F", 0) <= 0:
            return "error:22\r\n"
        inches = 20 in codes or (self._inches and 21 not in codes)
        relative = 53 not in codes and (91 in codes or (self._relative and 90 not in codes))
        target = self._target(given, inches, relative)
        if self._settings[20] and self._homed and self._beyond(target, 0.0):
            return "error:15\r\n"
        self._queue.append(Motion("Jog", target, given["F"] * (INCH_MM if inches else 1) / 60))
        self._next()
        return "ok\r\n"

    def _program(self, line: str) -> str:
        if self._state not in ("Idle", "Run"):
            return "error:9\r\n"
        pairs = WORD.findall(line)
        given = {letter: float(value) for letter, value in pairs if letter != "G"}
        codes = [float(value) for letter, value in pairs if letter == "G"]
        for code in codes:
            if code in (20, 21):
                self._inches = code == 20
            elif code in (90, 91):
                self._relative = code == 91
            elif code not in (0, 1, 38.2, 53, 94):
                return "error:20\r\n"
        if not set(given) & set("XYZ"):
            return "ok\r\n"
        target = self._target(given, self._inches, self._relative)
        speed = given.get("F", self._settings[110]) * (INCH_MM if self._inches else 1) / 60
        if self._settings[20] and self._homed and self._beyond(target, 0.0):
            self._alarm(2)
            return self._taken("error:9\r\n")
        if 38.2 in codes:
            if self._touching(self._time()):
                self._alarm(4)
                return self._taken("ok\r\n")
            self._queue.append(Motion("Probe", target, speed))
            self._next()
            return ""  # ``ok`` comes at the end of the probe
        self._queue.append(Motion("Run", target, speed))
        self._next()
        return "ok\r\n"


def emulate(
    phantom: Phantom,
    *,
    at: str = "pty",
    origin_mm: Point = ORIGIN_MM,
    touch_n: float = 0.05,
    homed: bool = False,
    work_mm: Point = (0.0, 0.0, 0.0),
    ready: Callable[[Point], bool] = lambda _target: True,
) -> AbstractContextManager[Served]:
    """Serve a board; ``homed``: as if homed already, otherwise it starts locked.

    ``work_mm``: where the zero of work coordinates lies in the machine's. A move to a target (m,
    scan frame) that is not ``ready`` is held until it is.
    """
    return served(GrblBoard(phantom, origin_mm, touch_n, homed, work_mm, ready), at, "grbl")


def _numbers(place: Array) -> str:
    return ",".join(f"{v:.3f}" for v in place)
