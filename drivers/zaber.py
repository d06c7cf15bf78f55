"""Zaber axes over their ASCII protocol: a chain of devices on one line, each with its axes.

Commands and flags: Zaber, "ASCII Protocol Manual" (firmware 6.06 and later). Why not the maker's
own library: docs/decisions/0030-line-stages.md.
"""

from collections.abc import Mapping
from contextlib import suppress
from typing import Annotated, NamedTuple

from pydantic import Field

from drivers.core.abilities import StopMeans
from drivers.core.axes import LineStageSettings, Reading, check_axes
from drivers.core.errors import DeviceFault
from drivers.core.line import Line, NoAnswer
from drivers.core.line_stage import LineStage
from drivers.core.protocols import Clock
from drivers.core.stage_limits import AXES
from drivers.core.table import Table

SPEED_UNIT = 1.6384  # the setting ``maxspeed`` counts this many to a microstep a second
IDS = 100
MAX_UNASKED_MESSAGES = 4  # messages before the awaited reply, at most
LEAST_WORDS = 5
UNREFERENCED = ("WR", "WH")
SWITCHED_OFF = "FO"
FLAGS = {
    "FD": "its driver is disabled",
    "FQ": "encoder error",
    "FS": "stalled and stopped",
    "FT": "excessive twist",
    "FB": "stopped by a collision",
    "FE": "limit error",
    SWITCHED_OFF: "its motor is switched off",
    "FF": "critical system error",
    "FN": "not supported here",
    "NC": "moved by its knob",
}
REASONS = {
    "BADDATA": "out of range",
    "BADCOMMAND": "unknown command",
    "BADAXIS": "no such axis",
    "DRIVERDISABLED": "its driver is disabled",
    "PARKED": "it is parked",
    "STATUSBUSY": "busy",
    "DEVICEONLY": "a command for the whole device",
    "NOACCESS": "not allowed",
}


class ZaberAxis(Table):
    """One axis: its device's address in the chain, its number there, microsteps to a mm.

    ``microsteps_per_mm`` is negative where positions grow against the scan's axis.
    """

    device: Annotated[int, Field(ge=1, le=99)]
    axis: Annotated[int, Field(ge=1, le=9)] = 1
    microsteps_per_mm: float


class ZaberSettings(LineStageSettings):
    """``[stage] driver = "zaber"``: axes of devices in a chain at ``port``."""

    name: str = "zaber"
    x: ZaberAxis | None = None
    y: ZaberAxis | None = None
    z: ZaberAxis | None = None


class Reply(NamedTuple):
    """What an axis answers to every command."""

    busy: bool
    flag: str
    data: str


class ZaberAxes:
    """See `drivers.core.axes.Axes`."""

    retargets = True

    def __init__(self, settings: ZaberSettings) -> None:
        given = {axis: getattr(settings, axis) for axis in AXES}
        self._axes: dict[str, ZaberAxis] = {a: keys for a, keys in given.items() if keys}
        self.names = "".join(self._axes)
        self._line = Line(settings.name, settings.port, settings.baud, settings.answer_s)
        self._device = settings.name
        self._id = 0
        self._referenced: set[str] = set()
        self._flagged: set[str] = set()
        self._off: set[str] = set()  # whose motor we have switched off
        self.travel_mm: dict[str, tuple[float, float]] = {}
        self.harder = (
            StopMeans("estop", lambda: self._all("estop"), 0.0),
            StopMeans("driver disable", self._switch_off, 0.0),
        )
        self._checked: bool | None = None  # whether replies carry a check sum; not asked yet

    def read(self) -> Reading:
        """Position, state and flag of each axis."""
        if self._checked is None:
            self._checked = self._carries_sums()
        places, moving, faults = {}, False, []
        for name, keys in self._axes.items():
            reply = self._ask(name, "get pos")
            places[name] = self._number(reply) / keys.microsteps_per_mm
            moving |= reply.busy
            if reply.flag not in UNREFERENCED:
                self._referenced.add(name)
            elif name in self._referenced:
                raise DeviceFault(
                    self._device, f"{name} has lost its reference position (was its power off?); "
                    "home it again"
                )  # fmt: skip
            own = reply.flag == SWITCHED_OFF and name in self._off
            if (words := FLAGS.get(reply.flag)) is not None and not own:
                self._flagged.add(name)
                faults.append(f"{name}: {words} ({reply.flag})")
        return Reading(places, moving, ", ".join(faults))

    def ready(self) -> list[str]:
        """Every axis must know where it is."""
        if unknown := set(self._axes) - self._referenced:
            raise DeviceFault(
                self._device, f"{', '.join(sorted(unknown))}: no reference position since power "
                "was switched on; home it (home = true in the rig file)"
            )  # fmt: skip
        for name, keys in self._axes.items():
            with suppress(DeviceFault):  # it then refuses a place beyond on the way there
                ends = [self._ask(name, f"get limit.{end}") for end in ("min", "max")]
                low, high = sorted(self._number(reply) / keys.microsteps_per_mm for reply in ends)
                self.travel_mm[name] = (low, high)
        if self._checked:
            return []
        return ["its replies carry no check sum (comm.checksum is 0): a damaged one may pass"]

    def move(self, places_mm: Mapping[str, float], speeds_mm_s: Mapping[str, float]) -> None:
        """Speeds first, so that all set off one right after the other."""
        if self._off:
            self._all("driver enable")
            self._off.clear()
        for name in self._flagged:  # a flag stays until it is taken note of
            self._ask(name, "warnings clear")
        self._flagged.clear()
        for name, speed in speeds_mm_s.items():
            rate = abs(self._axes[name].microsteps_per_mm) * speed * SPEED_UNIT
            self._ask(name, f"set maxspeed {max(round(rate), 1)}")
        for name, place in places_mm.items():
            self._ask(name, f"move abs {round(place * self._axes[name].microsteps_per_mm)}")

    def home(self, axis: str) -> None:
        """Begin the move to the home sensor."""
        self._referenced.discard(axis)
        self._ask(axis, "home")

    def stop(self) -> None:
        """Slow every axis down."""
        self._all("stop")

    def _switch_off(self) -> None:
        """No current, no force: where nothing else ends the motion."""
        self._off.update(self._axes)
        self._all("driver disable")

    def _all(self, command: str) -> None:
        for name in self._axes:
            self._ask(name, command)

    def close(self) -> None:
        """Release the line."""
        self._line.close()

    def _ask(self, name: str, command: str) -> Reply:
        """The reply to this very command: it carries its number."""
        keys, self._id = self._axes[name], (self._id + 1) % IDS
        text = f"{keys.device:02d} {keys.axis} {self._id:02d} {command}"
        answer = self._line.ask(f"/{text}:{check_sum(text)}\n".encode(), end=b"\r\n")
        for _ in range(MAX_UNASKED_MESSAGES):
            words = self._words(answer)
            if words is not None and words[:3] == text.split()[:3] and len(words) > LEAST_WORDS:
                break
            answer = self._line.listen(end=b"\r\n")  # that was an alert, or came too late
        else:
            raise NoAnswer(self._device, f"{answer!r} does not answer {text!r}")
        _, _, _, verdict, state, flag, *data = words
        reply = Reply(state == "BUSY", flag, " ".join(data))
        if verdict != "OK":
            why = REASONS.get(reply.data, reply.data)
            raise DeviceFault(self._device, f"{name}: {command!r} refused: {why}")
        return reply

    def _words(self, answer: bytes) -> list[str] | None:
        """The words of a whole reply, None if it is something else or damaged."""
        text = answer.decode("ascii", errors="replace")
        if not text.startswith("@"):
            return None
        text, colon, sum_sent = text[1:].partition(":")
        if (colon and sum_sent != check_sum(text)) or (self._checked and not colon):
            return None
        return text.split()

    def _carries_sums(self) -> bool:
        reply = self._ask(self.names[0], "get comm.checksum")
        if reply.data not in ("0", "1"):  # a damaged colon would make the sum part of the number
            raise NoAnswer(self._device, f"comm.checksum = {reply.data!r}")
        return reply.data == "1"

    def _number(self, reply: Reply) -> int:
        try:
            return int(reply.data)
        except ValueError:
            raise NoAnswer(self._device, f"{reply.data!r} is no position") from None


def check_sum(text: str) -> str:
    """Two hexadecimal digits that make the sum of all bytes a multiple of 256."""
    return f"{-sum(text.encode('ascii', errors='replace')) % 256:02X}"


def open_stage(_clock: Clock, settings: ZaberSettings) -> LineStage:
    """The axes at ``settings.port``, not yet connected. Raises `ConfigError`."""
    check_axes(settings, "microsteps_per_mm")
    return LineStage(settings, lambda: ZaberAxes(settings))
