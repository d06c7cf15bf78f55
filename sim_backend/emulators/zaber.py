"""A chain of Zaber devices with one axis each, speaking the ASCII protocol.

Zaber, "ASCII Protocol Manual": `/device axis id command:check`, `@device axis id OK IDLE -- data`.
Device 1 carries x, 2 y, 3 z. Positions are microsteps from the home sensor.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager

from sim_backend.emulators.carriage import IGNORES, ORIGIN_MM, SIGN, STOP_MM_S2, TRAVEL_MM, Carriage
from sim_backend.emulators.serving import Served, served
from sim_backend.phantom.phantom import Phantom
from sim_backend.phantom.trajectory import Point

MICROSTEPS_PER_MM = 2015.748  # a 6.35 mm lead, 200 steps, 64 microsteps
SPEED_UNIT = 1.6384
FASTEST = round(100 * MICROSTEPS_PER_MM * SPEED_UNIT)
DEVICES = {1: "x", 2: "y", 3: "z"}
FIRMWARE, DEVICE_ID = "7.38", "50081"


class ZaberChain:
    """Bytes in, bytes out; see `sim_backend.emulators.serving.Device`.

    ``ignores stop`` and ``ignores stops`` acknowledge the mildest, or all but the last means.
    Faults: ``stall`` (the motors are blocked), ``driver off`` (overheated), ``restart`` (power).
    """

    faults = ("stall", "driver off", "restart", "ignores stop", "ignores stops")

    def __init__(self, carriage: Carriage, *, check_sums: bool) -> None:
        self._carriage = carriage
        self._check_sums = check_sums
        self._text = b""
        self._flags = dict.fromkeys(DEVICES.values(), "")
        self._enabled = True
        self._speeds = dict.fromkeys(DEVICES.values(), FASTEST // 4)

    def received(self, data: bytes) -> bytes:
        """Whole lines are obeyed."""
        *lines, self._text = (self._text + data).replace(b"\r", b"\n").split(b"\n")
        return b"".join(self._line(line.decode("ascii", "replace").strip()) for line in lines)

    def due(self) -> bytes:
        """Nothing is said unasked."""
        self._carriage.go_on()
        return b""

    def fail(self, fault: str) -> None:
        """Begin one of `faults`."""
        if fault in IGNORES:
            self._carriage.deaf = IGNORES[fault]
            return
        moving = [axis for axis in DEVICES.values() if self._carriage.moving(axis)]
        if fault == "restart":
            self._carriage.forget()
            return
        self._carriage.block()
        if fault == "driver off":
            self._enabled = False
            self._flags = dict.fromkeys(self._flags, "FD")
        else:
            self._flags |= dict.fromkeys(moving or self._flags, "FS")

    def _line(self, line: str) -> bytes:
        """A damaged command is not answered, nor is one for a device that is not there."""
        if not line.startswith("/"):
            return b""
        text, colon, sum_sent = line[1:].partition(":")
        if colon and sum_sent.strip().upper() != lrc(text):
            return b""
        words = text.split()
        numbers: list[str] = []
        while words and words[0].isdigit() and len(numbers) < 3:
            numbers.append(words.pop(0))
        device, axis, *identity = [*numbers, *["0"] * (2 - len(numbers))]
        asked = [int(device)] if int(device) else list(DEVICES)
        return b"".join(
            self._reply(address, axis, identity, " ".join(words))
            for address in asked
            if address in DEVICES
        )

    def _reply(self, address: int, axis: str, identity: list[str], command: str) -> bytes:
        if int(axis) > 1:
            verdict, data = "RJ", "BADAXIS"
        else:
            verdict, data = self._obey(DEVICES[address], command)
        state = "BUSY" if self._carriage.moving(DEVICES[address]) else "IDLE"
        number = f" {int(identity[0]):02d}" if identity else ""
        text = f"{address:02d} {axis}{number} {verdict} {state} {self._flag(address)} {data}"
        return f"@{text}{':' + lrc(text) if self._check_sums else ''}\r\n".encode()

    def _warnings(self, name: str) -> list[str]:
        """The most important first."""
        return [self._flags[name] or "--", "--" if self._carriage.homed[name] else "WR"]

    def _flag(self, address: int) -> str:
        return next((f for f in self._warnings(DEVICES[address]) if f != "--"), "--")

    def _obey(self, name: str, command: str) -> tuple[str, str]:
        match command.split():
            case []:
                return "OK", "0"
            case ["get", setting]:
                return self._get(name, setting)
            case ["set", "maxspeed", value] if value.isdigit() and 0 < int(value) <= FASTEST:
                self._speeds[name] = int(value)
            case ["set", *_]:
                return "RJ", "BADDATA"
            case ["move", "abs", value]:
                return self._move(name, value)
            case ["home"] if self._enabled:
                self._carriage.home(name)
            case ["stop"]:
                self._carriage.stop(name)
            case ["estop"]:
                self._carriage.stop(name, STOP_MM_S2)
            case ["driver", ("enable" | "disable") as what]:
                self._enabled = what == "enable"
                self._flags[name] = "" if self._enabled else "FO"
                if not self._enabled:
                    self._carriage.block()
            case ["warnings", *clear] if clear in ([], ["clear"]):
                flags = [flag for flag in self._warnings(name) if flag != "--"]
                if clear:
                    self._flags[name] = "" if self._enabled else "FD"
                return "OK", " ".join([f"{len(flags):02d}", *flags])
            case _:
                return "RJ", "BADCOMMAND"
        return "OK", "0"

    def _get(self, name: str, setting: str) -> tuple[str, str]:
        values: dict[str, object] = {
            "pos": round(self._carriage.place_mm(name) * MICROSTEPS_PER_MM),
            "maxspeed": self._speeds[name],
            "version": FIRMWARE,
            "device.id": DEVICE_ID,
            "limit.min": 0,
            "limit.max": round(TRAVEL_MM[name] * MICROSTEPS_PER_MM),
            "comm.checksum": int(self._check_sums),
            "system.axiscount": 1,
        }
        return ("OK", str(values[setting])) if setting in values else ("RJ", "BADCOMMAND")

    def _move(self, name: str, value: str) -> tuple[str, str]:
        if not self._enabled:
            return "RJ", "DRIVERDISABLED"
        if not value.lstrip("-").isdigit():
            return "RJ", "BADDATA"
        to_mm = int(value) / MICROSTEPS_PER_MM
        if not self._carriage.within(name, to_mm):
            return "RJ", "BADDATA"
        self._carriage.set_off(name, to_mm, self._speeds[name] / SPEED_UNIT / MICROSTEPS_PER_MM)
        return "OK", "0"


def lrc(text: str) -> str:
    """The longitudinal redundancy check of a message between its type and its colon."""
    total = 0
    for byte in text.encode("ascii", "replace"):
        total = (total + byte) & 0xFF
    return f"{(total ^ 0xFF) + 1 & 0xFF:02X}"


def emulate(
    phantom: Phantom,
    *,
    at: str = "pty",
    homed: bool = False,
    check_sums: bool = True,
    ready: Callable[[Point], bool] = lambda _target: True,
) -> AbstractContextManager[Served]:
    """Serve a chain of three devices; `Carriage` says what they carry and how."""
    carriage = Carriage(phantom, ready=ready, homed=homed)
    return served(ZaberChain(carriage, check_sums=check_sums), at, "zaber")


RIG_AXES = {
    axis: {"device": address, "microsteps_per_mm": SIGN[axis] * MICROSTEPS_PER_MM}
    for address, axis in DEVICES.items()
}
RIG_ORIGIN_MM = tuple(SIGN[axis] * ORIGIN_MM[axis] for axis in "xyz")
"""What a rig file says of these axes."""
