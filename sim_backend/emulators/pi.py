"""A PI controller with three axes, ``1``, ``2`` and ``3``, speaking GCS 2.0.

PI, user manuals of C-863, C-884 and E-727, chapter "GCS Commands". Positions are mm from the
reference switch.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager

from sim_backend.emulators.carriage import IGNORES, ORIGIN_MM, SIGN, STOP_MM_S2, TRAVEL_MM, Carriage
from sim_backend.emulators.serving import Served, served
from sim_backend.phantom.phantom import Phantom
from sim_backend.phantom.trajectory import Point

AXES = {"1": "x", "2": "y", "3": "z"}
IDENTITY = "(c)2015 Physik Instrumente (PI) GmbH & Co. KG, C-884.DB, 118012345, 1.2.0.0"
SYNTAX, UNKNOWN, UNREFERENCED, POSITION, VELOCITY, STOPPED = 1, 2, 5, 7, 8, 10
BAD_AXIS, COUNT, MOTION_ERROR = 15, 24, -1024
FASTEST_MM_S = 100.0


class PiController:
    """Bytes in, bytes out; see `sim_backend.emulators.serving.Device`.

    ``ignores stop`` and ``ignores stops`` acknowledge the mildest, or all but the last means.
    Faults: ``motion error`` (an axis is blocked and its servo switches off), ``restart`` (power).
    """

    faults = ("motion error", "restart", "ignores stop", "ignores stops")

    def __init__(self, carriage: Carriage, *, servo: bool) -> None:
        self._carriage = carriage
        self._text = b""
        self._error = 0
        self._servo = dict.fromkeys(AXES, servo)
        self._speeds = dict.fromkeys(AXES, 10.0)

    def received(self, data: bytes) -> bytes:
        """Single characters act at once; commands when their line is whole."""
        answer = ""
        for byte in data:
            match byte:
                case 0x05:
                    moving = [self._carriage.moving(name) for name in AXES.values()]
                    answer += f"{sum(1 << n for n, on in enumerate(moving) if on):X}\n"
                case 0x07:
                    answer += "\xb1\n"
                case 0x18:
                    self._stop(list(AXES), hard=True)
                case 0x0A:
                    answer += self._line(self._text.decode("ascii", "replace").strip())
                    self._text = b""
                case _:
                    self._text += bytes([byte])
        return answer.encode("latin-1")

    def due(self) -> bytes:
        """Nothing is said unasked."""
        self._carriage.go_on()
        return b""

    def fail(self, fault: str) -> None:
        """Begin one of `faults`."""
        if fault in IGNORES:
            self._carriage.deaf = IGNORES[fault]
        elif fault == "restart":
            self._carriage.forget()
            self._servo = dict.fromkeys(AXES, False)
            self._error = 0
        else:
            self._carriage.block()
            self._servo = dict.fromkeys(AXES, False)
            self._error = MOTION_ERROR

    def _line(self, line: str) -> str:
        command, *words = line.split() or [""]
        command = command.upper()
        if command.endswith("?"):
            return self._query(command, words)
        axes, values = words[::2], words[1::2]
        if command in ("HLT", "FRF", "STP"):
            axes, values = words or list(AXES), []
        if any(axis not in AXES for axis in axes):
            self._error = BAD_AXIS
        elif command in ("MOV", "VEL", "SVO") and (not axes or len(axes) != len(values)):
            self._error = COUNT
        else:
            self._obey(command, axes, values)
        return ""

    def _obey(self, command: str, axes: list[str], values: list[str]) -> None:
        try:
            given = dict(zip(axes, map(float, values), strict=False))
        except ValueError:
            self._error = SYNTAX
            return
        match command:
            case "HLT" | "STP":
                self._stop(axes, hard=command == "STP")
            case "SVO":
                self._servo |= {axis: bool(on) for axis, on in given.items()}
                for axis in (axis for axis, on in given.items() if not on):
                    self._carriage.halt(AXES[axis], STOP_MM_S2)
            case "VEL" if all(0 <= v <= FASTEST_MM_S for v in given.values()):
                self._speeds |= given
            case "VEL":
                self._error = VELOCITY
            case "MOV":
                self._move(given)
            case "FRF" if all(self._servo[axis] for axis in axes):
                for axis in axes:
                    self._carriage.home(AXES[axis])
            case "FRF":
                self._error = UNREFERENCED
            case "":
                pass
            case _:
                self._error = UNKNOWN

    def _move(self, given: dict[str, float]) -> None:
        """All or none."""
        if not all(self._servo[a] and self._carriage.homed[AXES[a]] for a in given):
            self._error = UNREFERENCED
        elif not all(self._carriage.within(AXES[a], at) for a, at in given.items()):
            self._error = POSITION
        else:
            for axis, at in given.items():
                self._carriage.set_off(AXES[axis], at, self._speeds[axis])

    def _stop(self, axes: list[str], *, hard: bool) -> None:
        for axis in axes:
            self._carriage.stop(AXES[axis], STOP_MM_S2 if hard else None)
        self._error = STOPPED

    def _query(self, command: str, words: list[str]) -> str:
        if command == "ERR?":
            error, self._error = self._error, 0
            return f"{error}\n"
        if command == "*IDN?":
            return IDENTITY + "\n"
        if command == "SAI?":
            return " \n".join(AXES) + "\n"
        axes = words or list(AXES)
        if any(axis not in AXES for axis in axes):
            self._error = BAD_AXIS
            return ""
        values = [self._answer_of(command, axis) for axis in axes]
        if None in values:
            self._error = UNKNOWN
            return ""
        lines = [f"{axis}={value}" for axis, value in zip(axes, values, strict=True)]
        return " \n".join(lines) + "\n"

    def _answer_of(self, command: str, axis: str) -> str | None:
        name = AXES[axis]
        match command:
            case "POS?":
                return f"{self._carriage.place_mm(name):.7f}"
            case "VEL?":
                return f"{self._speeds[axis]:.7f}"
            case "ONT?":
                return str(int(not self._carriage.moving(name)))
            case "FRF?":
                return str(int(self._carriage.homed[name]))
            case "SVO?":
                return str(int(self._servo[axis]))
            case "TMN?":
                return "0.0000000"
            case "TMX?":
                return f"{TRAVEL_MM[name]:.7f}"
        return None


def emulate(
    phantom: Phantom,
    *,
    at: str = "pty",
    homed: bool = False,
    ready: Callable[[Point], bool] = lambda _target: True,
) -> AbstractContextManager[Served]:
    """Serve a controller; ``homed``: axes referenced and servos on, as after another program."""
    carriage = Carriage(phantom, ready=ready, homed=homed)
    return served(PiController(carriage, servo=homed), at, "pi")


RIG_AXES = {name: {"axis": axis, "units_per_mm": SIGN[name]} for axis, name in AXES.items()}
RIG_ORIGIN_MM = tuple(SIGN[axis] * ORIGIN_MM[axis] for axis in "xyz")
"""What a rig file says of these axes."""
