"""A Trinamic module with three motors in TMCL's direct mode; address 1, motors 0 to 2 are x, y, z.

Trinamic, "TMCL Firmware Manual": commands of nine bytes, axis parameters, status codes. Positions
are microsteps from the reference switch, speeds microsteps a second.
"""

import struct
from collections.abc import Callable
from contextlib import AbstractContextManager

from sim_backend.emulators.carriage import IGNORES, ORIGIN_MM, SIGN, STOP_MM_S2, Carriage
from sim_backend.emulators.serving import Served, served
from sim_backend.phantom.phantom import Phantom
from sim_backend.phantom.trajectory import Point

MICROSTEPS_PER_MM = 5120.0  # 200 steps, 256 microsteps, a lead of 10 mm
ADDRESS, HOST = 1, 2
LENGTH = 9
OK, BAD_SUM, BAD_COMMAND, BAD_TYPE, BAD_VALUE = 100, 1, 2, 3, 4
FASTEST = 7_999_774  # the modules' own limit, microsteps a second
USER_VARIABLES = 56


class TmclModule:
    """Bytes in, bytes out; see `sim_backend.emulators.serving.Device`.

    ``ignores stop`` and ``ignores stops`` acknowledge the mildest, or all but the last means.
    Faults: ``limit switch`` (motors stop at one), ``restart`` (power): position 0, variables 0.
    """

    faults = ("limit switch", "restart", "ignores stop", "ignores stops")

    def __init__(self, carriage: Carriage) -> None:
        self._carriage = carriage
        self._bytes = b""
        self._speeds = dict.fromkeys("xyz", 50_000)
        self._targets = dict.fromkeys("xyz", 0)
        self._zero = dict.fromkeys("xyz", 0)  # microsteps that count as 0
        self._variables = [0] * USER_VARIABLES
        self._at_switch: set[str] = set()
        self._currents = {(axis, kind): 128 for axis in "xyz" for kind in (6, 7)}

    def received(self, data: bytes) -> bytes:
        """Nine bytes each; a wrong sum is answered, and the rest of what came forgotten."""
        self._bytes += data
        answer = b""
        while len(self._bytes) >= LENGTH:
            taken, self._bytes = self._bytes[:LENGTH], self._bytes[LENGTH:]
            address, command, kind, bank, value, check = struct.unpack(">BBBBiB", taken)
            if address != ADDRESS:
                continue
            if sum(taken[:-1]) & 0xFF != check:
                self._bytes = b""
                status, found = BAD_SUM, 0
            else:
                status, found = self._obey(command, kind, bank, value)
            reply = struct.pack(">BBBBI", HOST, ADDRESS, status, command, found & 0xFFFFFFFF)
            answer += reply + bytes([sum(reply) & 0xFF])
        return answer

    def due(self) -> bytes:
        """Nothing is said unasked."""
        self._carriage.go_on()
        return b""

    def fail(self, fault: str) -> None:
        """Begin one of `faults`."""
        moving = {axis for axis in "xyz" if self._carriage.moving(axis)}
        if fault in IGNORES:
            self._carriage.deaf = IGNORES[fault]
        elif fault == "restart":
            self._carriage.forget()
            self._variables = [0] * USER_VARIABLES
            self._zero = {axis: self._steps(axis) for axis in "xyz"}
            self._targets = dict.fromkeys("xyz", 0)
        else:
            self._carriage.block()
            self._at_switch = moving or {"z"}

    def _steps(self, axis: str) -> int:
        return round(self._carriage.place_mm(axis) * MICROSTEPS_PER_MM)

    def _obey(self, command: int, kind: int, bank: int, value: int) -> tuple[int, int]:
        if command in (9, 10):
            return self._variable(command, kind, bank, value)
        if bank > 2:
            return BAD_VALUE, value
        axis = "xyz"[bank]
        match command:
            case 3:  # MST
                self._carriage.stop(axis)
            case 4 if self._carriage.deaf > 1 and self._carriage.moving(axis):
                pass
            case 4 if kind == 0:  # MVP ABS
                self._at_switch.discard(axis)
                self._targets[axis] = value
                to_mm = (value + self._zero[axis]) / MICROSTEPS_PER_MM
                self._carriage.set_off(axis, to_mm, self._speeds[axis] / MICROSTEPS_PER_MM)
            case 5 if kind in (6, 7):  # SAP, the current while it moves and while it rests
                self._currents[axis, kind] = value
                if value == 0:
                    self._carriage.halt(axis, STOP_MM_S2)
            case 5 if kind == 4:  # SAP, the speed of positioning
                if not 0 <= value <= FASTEST:
                    return BAD_VALUE, value
                self._speeds[axis] = value
            case 6:  # GAP
                return self._parameter(axis, kind)
            case 13 if kind in (0, 1, 2):  # RFS: start, stop, status
                return OK, self._search(axis, kind)
            case 4 | 5 | 13:
                return BAD_TYPE, value
            case _:
                return BAD_COMMAND, value
        return OK, value

    def _search(self, axis: str, kind: int) -> int:
        if kind == 0:
            self._zero[axis] = self._targets[axis] = 0
            self._carriage.home(axis)
        elif kind == 1:
            self._carriage.halt(axis)
        return int(self._carriage.searching(axis))

    def _parameter(self, axis: str, kind: int) -> tuple[int, int]:
        at = self._steps(axis) - self._zero[axis]
        moving = self._carriage.moving(axis)
        values = {
            0: self._targets[axis],
            1: at,
            3: self._speeds[axis] if moving else 0,
            4: self._speeds[axis],
            6: self._currents[axis, 6],
            7: self._currents[axis, 7],
            8: int(not moving and abs(at - self._targets[axis]) <= 1),
            10: 0,
            11: int(axis in self._at_switch),
        }
        return (OK, values[kind]) if kind in values else (BAD_TYPE, 0)

    def _variable(self, command: int, kind: int, bank: int, value: int) -> tuple[int, int]:
        if bank != 2 or kind >= USER_VARIABLES:
            return BAD_TYPE, value
        if command == 9:
            self._variables[kind] = value
        return OK, self._variables[kind]


def emulate(
    phantom: Phantom,
    *,
    at: str = "pty",
    homed: bool = False,
    ready: Callable[[Point], bool] = lambda _target: True,
) -> AbstractContextManager[Served]:
    """Serve a module. Not ``homed`` it does not know where it is, as after switching on: 0."""
    module = TmclModule(Carriage(phantom, ready=ready, homed=homed))
    if not homed:
        module.fail("restart")
    return served(module, at, "tmcl")


RIG_AXES = {
    axis: {"module": ADDRESS, "motor": n, "microsteps_per_mm": SIGN[axis] * MICROSTEPS_PER_MM}
    for n, axis in enumerate("xyz")
}
RIG_ORIGIN_MM = tuple(SIGN[axis] * ORIGIN_MM[axis] for axis in "xyz")
"""What a rig file says of these axes."""
