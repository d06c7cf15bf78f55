"""Trinamic modules by TMCL in direct mode: nine bytes there, nine bytes back, with a check sum.

Commands, axis parameters and status codes: Trinamic, "TMCL Firmware Manual" (TMCM-1140, -3110,
-6110 and others). Why not the maker's library: docs/decisions/0030-line-stages.md.
"""

import math
import secrets
import struct
import time
from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from drivers.core.abilities import StopMeans
from drivers.core.axes import LineStageSettings, Reading, check_axes
from drivers.core.errors import DeviceFault
from drivers.core.line import Line, NoAnswer
from drivers.core.line_stage import LineStage
from drivers.core.protocols import Clock
from drivers.core.settings import Baud, Positive
from drivers.core.stage_limits import AXES
from drivers.core.table import Table

MST, MVP, SAP, GAP, SGP, GGP, RFS = 3, 4, 5, 6, 9, 10, 13
ABSOLUTE = 0
POSITION, SPEED, MAX_SPEED, MAX_CURRENT, STANDBY_CURRENT = 1, 3, 4, 6, 7
REACHED, RIGHT_SWITCH, LEFT_SWITCH = 8, 10, 11
SEARCH, ABANDON, SEARCHING = 0, 1, 2
USER_VARIABLES, MARK = 2, 55  # bank, and the last variable: 0 again after a power failure
DONE = 100
LENGTH = 9
STATUS = {
    1: "wrong check sum", 2: "invalid command", 3: "wrong type", 4: "invalid value",
    5: "configuration locked", 6: "command not available",
}  # fmt: skip
SETS_OFF_S = 0.2  # an accepted move shows as a speed within a few milliseconds


class TmclAxis(Table):
    """One axis: its module's address, its motor there, microsteps to a mm.

    ``microsteps_per_mm`` is negative where positions grow against the scan's axis.
    """

    module: Annotated[int, Field(ge=1, le=255)] = 1
    motor: Annotated[int, Field(ge=0, le=5)] = 0
    microsteps_per_mm: float


class TmclSettings(LineStageSettings):
    """``[stage] driver = "tmcl"``: motors of modules on one line at ``port``.

    ``speed_unit_hz``: microsteps a second to one unit of speed. Modules with a TMC428 or TMC429
    count 16 MHz / (2^pulse divisor * 2048 * 32), others microsteps a second.
    """

    name: str = "tmcl"
    baud: Baud = 9600
    speed_unit_hz: Positive = 1.0
    x: TmclAxis | None = None
    y: TmclAxis | None = None
    z: TmclAxis | None = None


class TmclAxes:
    """See `drivers.core.axes.Axes`."""

    retargets = True

    def __init__(self, settings: TmclSettings) -> None:
        given = {axis: getattr(settings, axis) for axis in AXES}
        self._axes: dict[str, TmclAxis] = {a: keys for a, keys in given.items() if keys}
        self.names = "".join(self._axes)
        self._line = Line(settings.name, settings.port, settings.baud, settings.answer_s)
        self._device = settings.name
        self._speed_unit_hz = settings.speed_unit_hz
        self._set_off_s: dict[str, float] = {}
        self._homing: set[str] = set()
        self._marks: dict[int, int] = {}
        self._currents: dict[str, dict[int, int]] = {}  # of motors that we have switched off
        self.harder = (
            StopMeans("a move to where it is (MVP)", self._turn_back, 0.0),
            StopMeans("no current (SAP 6)", self._switch_off, 0.0),
        )

    def read(self) -> Reading:
        """Positions, speeds and flags. Raises `DeviceFault` after a power failure."""
        for module, mark in self._marks.items():
            if self._ask(module, GGP, MARK, USER_VARIABLES) != mark:
                raise DeviceFault(
                    self._device, f"module {module} has restarted: where its motors are is not "
                    "known; home it again"
                )  # fmt: skip
        moves = [self._moves(name) for name in self._axes]  # first: what rests is then read at rest
        moving = any(moves)
        places = {
            name: self._axis(name, GAP, POSITION) / keys.microsteps_per_mm
            for name, keys in self._axes.items()
        }
        return Reading(places, moving, "" if moving else self._why_not())

    def ready(self) -> list[str]:
        """Leave a mark in each module, by which a power failure shows."""
        for module in {keys.module for keys in self._axes.values()}:
            mark = 1 + secrets.randbelow(2**31 - 1)
            self._ask(module, SGP, MARK, USER_VARIABLES, mark)
            self._marks[module] = mark
        return ["a module does not report whether its motors were homed since power was on"]

    def move(self, places_mm: Mapping[str, float], speeds_mm_s: Mapping[str, float]) -> None:
        """Speeds first, so that all set off one right after the other."""
        for name, currents in self._currents.items():
            for kind, current in currents.items():
                self._axis(name, SAP, kind, current)
        self._currents.clear()
        for name, speed in speeds_mm_s.items():
            rate = abs(self._axes[name].microsteps_per_mm) * speed / self._speed_unit_hz
            self._axis(name, SAP, MAX_SPEED, max(round(rate), 1))
        for name, place in places_mm.items():
            steps = round(place * self._axes[name].microsteps_per_mm)
            self._axis(name, MVP, ABSOLUTE, steps)
            self._set_off_s[name] = time.monotonic()

    def home(self, axis: str) -> None:
        """Begin the reference search that the module is configured for."""
        self._set_off_s.pop(axis, None)
        self._axis(axis, RFS, SEARCH)
        self._homing.add(axis)

    def stop(self) -> None:
        """Slow every motor down."""
        for name in self._axes:
            if name in self._homing:
                self._axis(name, RFS, ABANDON)
            self._axis(name, MST, 0)
        self._homing.clear()
        self._set_off_s.clear()

    def _turn_back(self) -> None:
        """Another command than `stop`, which a module may have taken and not obey."""
        for name in self._axes:
            self._axis(name, MVP, ABSOLUTE, self._axis(name, GAP, POSITION))

    def _switch_off(self) -> None:
        """No current, no force: where nothing else ends the motion."""
        for name in set(self._axes) - set(self._currents):
            kinds = (MAX_CURRENT, STANDBY_CURRENT)
            self._currents[name] = {kind: self._axis(name, GAP, kind) for kind in kinds}
        for name, currents in self._currents.items():
            for kind in currents:
                self._axis(name, SAP, kind, 0)

    def close(self) -> None:
        """Release the line."""
        self._line.close()

    def _moves(self, name: str) -> bool:
        """A motor that does not turn has arrived, has not set off yet, or was held up."""
        if name in self._homing:
            if self._axis(name, RFS, SEARCHING):
                return True
            self._homing.discard(name)
        if self._axis(name, GAP, SPEED):
            return True
        since_s = time.monotonic() - self._set_off_s.get(name, -math.inf)
        return since_s < SETS_OFF_S and not self._axis(name, GAP, REACHED)

    def _why_not(self) -> str:
        """The limit switches that keep motors from their targets."""
        held = [n for n in self._set_off_s if not self._axis(n, GAP, REACHED)]
        switches = [(n, s) for n in held for s in (RIGHT_SWITCH, LEFT_SWITCH)]
        return ", ".join(
            f"{n}: at its {'right' if s == RIGHT_SWITCH else 'left'} limit switch"
            for n, s in switches
            if self._axis(n, GAP, s)
        )

    def _axis(self, name: str, command: int, kind: int, value: int = 0) -> int:
        keys = self._axes[name]
        return self._ask(keys.module, command, kind, keys.motor, value)

    def _ask(self, module: int, command: int, kind: int, bank: int, value: int = 0) -> int:
        """The value in the reply. Raises `NoAnswer` where it is damaged."""
        answer = self._line.ask(frame(module, command, kind, bank, value), size=LENGTH)
        _, address, status, answered, found, check = struct.unpack(">BBBBiB", answer)
        if check != sum(answer[:-1]) % 256 or (address, answered) != (module, command):
            raise NoAnswer(self._device, f"{answer.hex(' ')} is no reply")
        if status == 1:
            raise NoAnswer(self._device, f"module {module}: {STATUS[1]}")
        if status != DONE:
            why = STATUS.get(status, f"status {status}")
            raise DeviceFault(self._device, f"module {module}: command {command} refused: {why}")
        return int(found)


def frame(module: int, command: int, kind: int, bank: int, value: int) -> bytes:
    """A command: the value's most significant byte first, then the sum of all before."""
    data = struct.pack(">BBBBi", module, command, kind, bank, value)
    return data + bytes([sum(data) % 256])


def open_stage(_clock: Clock, settings: TmclSettings) -> LineStage:
    """The motors at ``settings.port``, not yet connected. Raises `ConfigError`."""
    check_axes(settings, "microsteps_per_mm")
    return LineStage(settings, lambda: TmclAxes(settings))
