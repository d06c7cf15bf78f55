"""A GRBL 1.1 board that carries the tip of a `World`; bytes in, bytes out.

Written from the protocol's own description (gnea/grbl: "Interface", "Jogging").
Machine millimetres are the scan's millimetres plus `ORIGIN_MM`. It starts homed and idle.
"""

import re
from dataclasses import dataclass, field

from campaign.world import Point, World

ORIGIN_MM: Point = (-80.0, -20.0, -52.0)
TRAVEL_MM = (100.0, 40.0, 60.0)
SETTINGS = {
    0: 10, 1: 25, 10: 1, 13: 0, 20: 1, 21: 1, 22: 1, 27: 1, 110: 6000, 111: 6000, 112: 3000,
    120: 1000, 121: 1000, 122: 1000, 130: TRAVEL_MM[0], 131: TRAVEL_MM[1], 132: TRAVEL_MM[2],
}  # fmt: skip
BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
RUN_ON_M = 1.5e-3
LOCKED = 99  # an alarm state that no ALARM line names
_WORD = re.compile(r"([A-Z])(-?\d+(?:\.\d*)?)")


@dataclass
class Ills:
    """What is wrong with the board at the moment; each field is one fault."""

    deaf: bool = False  # lines and stops are not heard, status is answered
    mute_until_s: float = 0.0  # nothing is answered; what was told is done
    late_s: float = 0.0  # every answer comes this much later
    slow: float = 1.0  # of the speed that was asked for
    runs_on: bool = False  # the next move ends beyond its target
    lost_stops: int = 0  # so many are still not heard
    stop_delay_s: float = 0.0
    blind: Point | None = None  # the place that is reported, wherever the tip is
    garbage: int = 0  # so many answers are still to be damaged


@dataclass
class Board:
    """The board: `received` takes bytes and answers, `due` says what it says by itself."""

    world: World
    ills: Ills = field(default_factory=Ills)
    said: list[tuple[float, bytes]] = field(default_factory=list)  # due when, what
    stops: list[float] = field(default_factory=list)  # when each order to stop came over the wire
    jogs: list[tuple[float, Point, float]] = field(default_factory=list)
    dead: bool = False
    _text: bytes = b""
    _alarm: int = 0
    _held: bool = False
    _reports: int = 0
    _stop_at_s: float | None = None

    def received(self, data: bytes) -> None:
        """Real-time bytes act wherever they stand, lines when they are whole."""
        for value in data:
            byte = bytes([value])
            if byte == b"?":
                self._say(self._report())
            elif byte in (b"\x85", b"!", b"\x18"):
                self.order(byte)
            elif byte == b"~":
                self._held = False
            elif byte == b"\n":
                line, self._text = self._text, b""
                if not self.ills.deaf:
                    self._line(line.decode("ascii", "replace").strip().upper())
            elif value < 0x80:
                self._text += byte

    def due(self) -> bytes:
        """What is to be sent by now."""
        now = self.world.time_s
        if self._stop_at_s is not None and now >= self._stop_at_s:
            self._stop_at_s = None
            self.world.halt()
        if self._held and not self.world.moving:
            self._held = False
        out = b""
        while self.said and self.said[0][0] <= now:
            out += self.said.pop(0)[1]
        return out

    def restart(self, *, homing: bool = True) -> None:
        """The board's power fails for a moment; with homing on it then waits to be homed."""
        self.world.halt()
        self._alarm = LOCKED if homing else 0
        self._say(BANNER + (b"[MSG:'$H'|'$X' to unlock]\r\n" if homing else b""))

    def alarm(self, number: int) -> None:
        """A limit switch, an emergency stop."""
        self.world.halt()
        self._alarm = number
        self._say(b"ALARM:%d\r\n" % number)

    @property
    def alarmed(self) -> bool:
        """True until somebody unlocks it."""
        return self._alarm != 0

    def jog(self, target_mm: Point, speed_m_s: float) -> None:
        """Set off to a place in the scan's millimetres."""
        x, y, z = (1e-3 * v for v in target_mm)
        self.jogs.append((self.world.time_s, (x, y, z), speed_m_s))
        if self.ills.runs_on:
            z -= RUN_ON_M if z < self.world.place[2] else -RUN_ON_M
        self.world.move((x, y, z), self.ills.slow * speed_m_s)

    def order(self, byte: bytes) -> None:
        """One of the real-time bytes that end a motion."""
        now = self.world.time_s
        if byte != b"\x18" or self.world.moving:
            self.stops.append(now)
        if self.ills.deaf:
            return
        if self.ills.lost_stops > 0:
            self.ills.lost_stops -= 1
            return
        if byte == b"\x18":
            if self.world.moving:
                self.alarm(3)
            self._text = b""
            self._say(BANNER)
            return
        if not self.world.moving:
            return
        self._held = byte == b"!"
        if self.ills.stop_delay_s == 0:
            self.world.halt()
        elif self._stop_at_s is None:
            self._stop_at_s = now + self.ills.stop_delay_s

    def _line(self, line: str) -> None:
        if line == "$$":
            self._say(b"".join(b"$%d=%g\r\n" % pair for pair in SETTINGS.items()) + b"ok\r\n")
        elif line == "$I":
            self._say(b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n")
        elif line == "$X":
            self._alarm = 0
            self._say(b"ok\r\n")
        elif line.startswith("$J="):
            self._say(self._jog(line[3:]))
        elif line.startswith("$"):
            self._say(b"error:3\r\n")
        else:
            self._say(b"ok\r\n" if set(line) <= set("GM0123456789 .") else b"error:20\r\n")

    def _jog(self, words: str) -> bytes:
        if self._alarm:
            return b"error:9\r\n"
        pairs = _WORD.findall(words)
        if "".join(a + b for a, b in pairs) != words.replace(" ", ""):
            return b"error:2\r\n"
        given = {letter: float(value) for letter, value in pairs if letter in "XYZF"}
        if given.get("F", 0.0) <= 0:
            return b"error:22\r\n"
        if {float(v) for a, v in pairs if a == "G"} != {21.0, 90.0, 53.0}:
            return b"error:20\r\n"
        here = self._machine_mm()
        target = [given.get(axis, at) for axis, at in zip("XYZ", here, strict=True)]
        if any(not -t <= v <= 0 for v, t in zip(target, TRAVEL_MM, strict=True)):
            return b"error:15\r\n"
        x, y, z = (v - o for v, o in zip(target, ORIGIN_MM, strict=True))
        self.jog((x, y, z), 1e-3 * given["F"] / 60)
        return b"ok\r\n"

    def _report(self) -> bytes:
        if self._alarm:
            state = "Alarm"
        elif self.world.moving:
            state = "Hold:1" if self._held else "Jog"
        else:
            state = "Idle"
        self._reports += 1
        extra = "|WCO:0.000,0.000,0.000" if self._reports % 10 == 1 else ""
        place = ",".join(f"{v:.3f}" for v in self._machine_mm())
        return f"<{state}|MPos:{place}|Bf:15,128|FS:0,0{extra}>\r\n".encode()

    def _machine_mm(self) -> Point:
        shown = self.ills.blind or self.world.place
        x, y, z = (1e3 * v + o for v, o in zip(shown, ORIGIN_MM, strict=True))
        return (x, y, z)

    def _say(self, text: bytes) -> None:
        now = self.world.time_s
        if now < self.ills.mute_until_s:
            return
        if self.ills.garbage > 0:
            self.ills.garbage -= 1
            text = bytes((b * 7 + 13) % 256 for b in text)
        self.said.append((now + self.ills.late_s, text))
