"""Physik Instrumente controllers by the General Command Set, GCS 2.0, in ASCII.

Commands and error numbers: PI, "GCS commands" chapter of the controllers' user manuals (C-863,
C-884, E-727). GCS has no check sum. Why not the maker's library:
docs/decisions/0030-line-stages.md.
"""

from collections.abc import Mapping
from contextlib import suppress
from typing import Annotated

from pydantic import Field

from drivers.core.abilities import StopMeans
from drivers.core.axes import LineStageSettings, Reading, check_axes
from drivers.core.errors import DeviceFault
from drivers.core.line import Line, NoAnswer
from drivers.core.line_stage import LineStage
from drivers.core.protocols import Clock
from drivers.core.stage_limits import AXES
from drivers.core.table import Table

STOP_ALL = b"\x18"  # at once, by a single character; as STP
MOTION = b"\x05"  # answered at once with the axes that move, as a hexadecimal mask
STOPPED = 10
ERRORS = {
    1: "parameter syntax error",
    2: "unknown command",
    5: "the axis has not been referenced, or its servo is off",
    7: "position out of limits",
    8: "velocity out of limits",
    15: "invalid axis identifier",
    17: "parameter out of range",
    24: "incorrect number of parameters",
    -1024: "position error too large: the servo was switched off",
}


class PiAxis(Table):
    """One axis: its identifier, and its units to a mm (1000 where it counts micrometres).

    ``units_per_mm`` is negative where positions grow against the scan's axis.
    """

    axis: Annotated[str, Field(pattern="^[A-Za-z0-9_-]{1,16}$")]
    units_per_mm: float = 1.0


class PiSettings(LineStageSettings):
    """``[stage] driver = "pi"``: axes of one controller at ``port``, serial, USB or TCP."""

    name: str = "pi"
    x: PiAxis | None = None
    y: PiAxis | None = None
    z: PiAxis | None = None


class PiAxes:
    """See `drivers.core.axes.Axes`."""

    retargets = True

    def __init__(self, settings: PiSettings) -> None:
        given = {axis: getattr(settings, axis) for axis in AXES}
        self._axes: dict[str, PiAxis] = {a: keys for a, keys in given.items() if keys}
        self.names = "".join(self._axes)
        self._all = " ".join(keys.axis for keys in self._axes.values())
        self._line = Line(settings.name, settings.port, settings.baud, settings.answer_s)
        self._device = settings.name
        self._off = False  # whether we have switched the servos off
        self.travel_mm: dict[str, tuple[float, float]] = {}
        self.harder = (
            StopMeans("stop all axes (#24)", lambda: self._line.say(STOP_ALL), 0.0),
            StopMeans("servo off (SVO)", self._switch_off, 0.0),
        )

    def read(self) -> Reading:
        """Positions, what moves, and the error that has come up since the last time."""
        moving = self._integer(self._line.ask(MOTION, end=b"\n"), 16) != 0  # first: see `Axes.read`
        units = self._query("POS?")
        error = self._error()
        places = {a: float(units[k.axis]) / k.units_per_mm for a, k in self._axes.items()}
        return Reading(places, moving, "" if error in (0, STOPPED) else in_words(error))

    def ready(self) -> list[str]:
        """Servos on, every axis referenced. Raises `DeviceFault`."""
        self._referenced_or_raise()
        with suppress(DeviceFault):  # it then refuses a place beyond on the way there
            lowest, highest = self._query("TMN?"), self._query("TMX?")
            for axis, keys in self._axes.items():
                ends = [float(units[keys.axis]) / keys.units_per_mm for units in (lowest, highest)]
                self.travel_mm[axis] = (min(ends), max(ends))
        self._error()  # of a controller that does not know these
        off = [a for a, on in self._query("SVO?").items() if on != "1"]
        for axis in off:
            self._do(f"SVO {axis} 1")
        return [f"servo switched on: {', '.join(off)}"] if off else []

    def move(self, places_mm: Mapping[str, float], speeds_mm_s: Mapping[str, float]) -> None:
        """All axes by one command."""
        if self._off:
            self._do("SVO " + " ".join(f"{keys.axis} 1" for keys in self._axes.values()))
            self._off = False
        per_mm = {a: k.units_per_mm for a, k in self._axes.items()}
        if speeds_mm_s:
            self._do("VEL " + self._each({a: abs(per_mm[a]) * v for a, v in speeds_mm_s.items()}))
        self._do("MOV " + self._each({a: per_mm[a] * at for a, at in places_mm.items()}))

    def home(self, axis: str) -> None:
        """Begin the move to the reference switch."""
        name = self._axes[axis].axis
        self._do(f"SVO {name} 1")
        self._do(f"FRF {name}")

    def stop(self) -> None:
        """Slow every axis down."""
        self._line.say(f"HLT {self._all}\n".encode())
        if (error := self._error()) not in (0, STOPPED):
            raise DeviceFault(self._device, f"'HLT' refused: {in_words(error)}")

    def _switch_off(self) -> None:
        """No servo, no force: where nothing else ends the motion."""
        self._off = True
        for keys in self._axes.values():
            self._line.say(f"SVO {keys.axis} 0\n".encode())

    def close(self) -> None:
        """Release the line."""
        self._line.close()

    def _referenced_or_raise(self) -> None:
        if unknown := [a for a, known in self._query("FRF?").items() if known != "1"]:
            raise DeviceFault(
                self._device, f"axis {', '.join(unknown)} is not referenced since power was "
                "switched on; home it (home = true in the rig file)"
            )  # fmt: skip

    def _each(self, values: Mapping[str, float]) -> str:
        return " ".join(f"{self._axes[a].axis} {value:.6f}" for a, value in values.items())

    def _do(self, command: str) -> None:
        """What is not answered; its error is asked for."""
        self._error()  # of something before
        self._line.say(command.encode("ascii") + b"\n")
        if (error := self._error()) != 0:
            raise DeviceFault(self._device, f"{command!r} refused: {in_words(error)}")

    def _error(self) -> int:
        return self._integer(self._line.ask(b"ERR?\n", end=b"\n"), 10)

    def _query(self, command: str) -> dict[str, str]:
        """One ``axis=value`` a line; a line that ends with a blank is followed by another."""
        line = self._line.ask(f"{command} {self._all}\n".encode(), end=b"\n")
        lines = [line]
        while line.endswith(b" "):
            line = self._line.listen(end=b"\n")
            lines.append(line)
        found: dict[str, str] = {}
        for text in b"\n".join(lines).decode("ascii", errors="replace").split("\n"):
            axis, equals, value = text.strip().partition("=")
            try:
                float(value if equals else "?")
            except ValueError:
                raise NoAnswer(self._device, f"{text!r} answers no {command}") from None
            found[axis] = value
        if set(found) != set(self._all.split()):
            raise NoAnswer(self._device, f"{command} answered for {', '.join(found)}")
        return found

    def _integer(self, answer: bytes, base: int) -> int:
        try:
            return int(answer, base)
        except ValueError:
            raise NoAnswer(self._device, f"{answer!r} is no number") from None


def in_words(error: int) -> str:
    """An error of GCS."""
    return f"{ERRORS.get(error, 'error')} ({error})"


def open_stage(_clock: Clock, settings: PiSettings) -> LineStage:
    """The axes at ``settings.port``, not yet connected. Raises `ConfigError`."""
    check_axes(settings, "units_per_mm")
    return LineStage(settings, lambda: PiAxes(settings))
