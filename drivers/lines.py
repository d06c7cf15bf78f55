r"""Sensors that print lines of text on a serial port or a socket: load cells, force gauges.

There is no standard, so the rig file gives a pattern (a regular expression with one named group
per channel) and units. A group ``time`` is the device's own clock. Lines that do not match are
counted as lost. Patterns are RE2's: matching takes a time proportional to the line's length,
whatever the device sends, so that a damaged line cannot hold up the force guard.
"""

import math
import re
from collections.abc import Callable, Sequence
from typing import Annotated, Literal

import re2
from pydantic import Field

from drivers.core.channel_table import ChannelTable
from drivers.core.errors import ConfigError, DeviceFault
from drivers.core.ports import PortName, open_port, read_some
from drivers.core.protocols import Clock
from drivers.core.reader import LineSensor, Sample
from drivers.core.settings import Baud, NonNegative, Positive
from drivers.core.timestamps import INSTANT_S, DeviceTime
from drivers.core.units import SI

# The longest match takes program x line steps: 1 ms, a quarter of two samples at 500 Hz.
LINE_MAX = 256
PROGRAM_MAX = 500
GAP = 1.5  # periods of device time between two lines: one is missing
TIME, UNIT = "time", "unit"
# Not damage but another pattern: this many lines in a row that do not match, for this long.
UNMATCHED, UNMATCHED_S = 5, 0.2
GREETING_S = 3.0  # ... or this long before the first that does: boards print what they are
MAX_SHOWN_BYTES = 60


class TextChannel(ChannelTable):
    """A named group of the pattern: ``scale`` x the number is in ``unit``, stored in SI."""

    name: Annotated[str, Field(pattern="^[A-Za-z_][A-Za-z0-9_]*$")]


class LinePattern:
    """A compiled pattern; ``groups`` maps the names of its groups to their numbers.

    Raises `ConfigError` for what is no pattern, needs backtracking, or is too large to be quick.
    """

    def __init__(self, pattern: str) -> None:
        options = re2.Options()
        options.log_errors = False
        try:
            self._compiled = re2.compile(pattern.encode(), options)
        except re2.error as error:
            words = error.args[0] if error.args else b""
            why = words.decode(errors="replace") if isinstance(words, bytes) else str(words)
            raise ConfigError(
                f"pattern = {pattern!r}: {why}. Patterns are RE2's: no look-around, no references "
                "to earlier groups"
            ) from None
        if self._compiled.programsize > PROGRAM_MAX:
            raise ConfigError(
                f"pattern = {pattern!r}: compiles to {self._compiled.programsize} steps; at most "
                f"{PROGRAM_MAX} are allowed, so that a line is read in time. Repeat less: + and * "
                "cost less than {m,n}"
            )
        self.groups: dict[str, int] = {
            name.decode(): number for name, number in self._compiled.groupindex.items()
        }

    def match(self, line: bytes) -> Sequence[bytes | None] | None:
        """The line and its groups by number, or None if the whole line does not match."""
        if len(line) > LINE_MAX or (found := self._compiled.fullmatch(line)) is None:
            return None
        return (found.group(0), *found.groups())


class LineSource:
    """An open line; see `drivers.core.reader.Source`."""

    def __init__(
        self,
        clock: Clock,
        name: str,
        port: str,
        baud: int,
        pattern: LinePattern,
        channels: Sequence[TextChannel],
        ask: bytes,
        period_s: float,
        time_unit_s: float,
        latency_s: float,
        number: Callable[[bytes], float],
    ) -> None:
        self._clock = clock
        self._name = name
        self._number = number
        self._unit = channels[0].unit
        self._unit_group = pattern.groups.get(UNIT)
        self._unmatched = 0
        self._line = open_port(name, port, baud)
        self._pattern = pattern
        self._factors = [(pattern.groups[c.name], c.si_per_number) for c in channels]
        self._time_group = pattern.groups.get(TIME)
        self._ask = ask
        self._ask_s = -math.inf
        self._period_s = period_s
        self._time_unit_s = time_unit_s
        self._latency_s = latency_s
        self._device = DeviceTime(latency_s)
        self._device_s: float | None = None
        self._last_s = -math.inf
        self._arrival_s = clock.now()
        self._partial = b""
        self._heard = False
        self._started = False  # the first line is half a line
        self._lost = 0

    def read(self) -> list[Sample]:
        """The whole lines that have arrived. Raises `DeviceFault` where they state another unit, or
        no longer match.
        """
        now = self._clock.now()
        if self._ask and now - self._ask_s >= self._period_s:
            self._ask_s = now
            self._line.write(self._ask)
        data = read_some(self._line)
        arrival_s = self._clock.now()
        if data and not self._heard:  # a board that starts when its port is opened is silent first
            self._heard, self._arrival_s = True, arrival_s
        *lines, self._partial = re.split(rb"[\r\n]+", self._partial + data)
        if len(self._partial) > LINE_MAX:
            self._partial, self._lost = b"", self._lost + 1
        if lines and not self._started and not self._ask:
            self._started, lines = True, lines[1:]
        return [s for line in lines if line and (s := self._sample(line, arrival_s)) is not None]

    def close(self) -> None:
        """Close the line."""
        self._line.close()

    def _sample(self, line: bytes, arrival_s: float) -> Sample | None:
        numbers = self._numbers(line)
        if numbers is None:
            self._lost += 1
            self._unmatched += 1
            wait_s = GREETING_S if self._last_s == -math.inf else UNMATCHED_S
            if self._unmatched >= UNMATCHED and arrival_s - self._arrival_s > wait_s:
                shown = line[:MAX_SHOWN_BYTES].decode("ascii", "backslashreplace")
                raise DeviceFault(
                    self._name, f"{self._unmatched} lines in a row do not match the pattern; the "
                    f"last is {shown!r}"
                )  # fmt: skip
            return None
        self._unmatched = 0
        values, device_s = numbers
        lost, self._lost = self._lost, 0
        if device_s is None:
            time_s = max(arrival_s - self._latency_s, self._last_s + INSTANT_S)
        else:
            time_s = self._device.stamp(device_s, arrival_s)
            lost = max(lost, self._missing(device_s, arrival_s))
            self._device_s = device_s
        self._last_s, self._arrival_s = time_s, arrival_s
        return Sample(time_s, values, lost)

    def _missing(self, device_s: float, arrival_s: float) -> int:
        """Lines that the device's clock says are missing, if they can have been sent since."""
        if self._device_s is None or device_s - self._device_s < GAP * self._period_s:
            return 0
        said = round((device_s - self._device_s) / self._period_s) - 1
        return min(said, round((arrival_s - self._arrival_s) / self._period_s) + 1)

    def _numbers(self, line: bytes) -> tuple[list[float], float | None] | None:
        """The channels' values and the device's time, or None if the line is not one."""
        found = self._pattern.match(line.strip())
        if found is None:
            return None
        if not self._same_unit(found):
            return None
        group = self._time_group
        try:
            values = [factor * self._number(found[n] or b"") for n, factor in self._factors]
            time_s = 0.0 if group is None else self._time_unit_s * self._number(found[group] or b"")
        except ValueError:  # an optional group left out, or one that is no number
            return None
        if not math.isfinite(time_s):
            return None
        return values, None if group is None else time_s

    def _same_unit(self, found: Sequence[bytes | None]) -> bool:
        """Raises `DeviceFault` where a gauge was switched to another unit that is one."""
        if self._unit_group is None:
            return True
        unit = (found[self._unit_group] or b"").decode("ascii", "replace")
        if unit != self._unit and unit in SI:
            raise DeviceFault(self._name, f"sends {unit} now, not unit = {self._unit!r}")
        return unit == self._unit


def number_reader(decimal: str, thousands: str) -> Callable[[bytes], float]:
    """What turns the text of a number into one; it raises `ValueError` for what is none.

    With a separator of thousands its groups must have three digits: 1,5 is not 15.
    """
    mark, group = re.escape(decimal), re.escape(thousands)
    whole = rf"\d{{1,3}}(?:{group}\d{{3}})+|\d+" if thousands else r"\d+"
    form = re.compile(rf"[-+]?(?:(?:{whole})(?:{mark}\d*)?|{mark}\d+)(?:[eE][-+]?\d+)?")

    def number(text: bytes) -> float:
        words = text.decode("ascii").strip()
        if form.fullmatch(words) is None:
            raise ValueError(words)
        return float(words.replace(thousands, "").replace(decimal, "."))

    return number


def open_sensor(
    clock: Clock,
    *,
    port: PortName,
    pattern: str,
    channel: list[TextChannel],
    rate_hz: Positive,
    baud: Baud = 9600,
    ask: str = "",
    time_unit_s: Positive = 1.0,
    latency_ms: NonNegative = 0.0,
    decimal: Literal[".", ","] = ".",
    thousands: Literal["", ",", ".", " ", "'"] = "",
    name: str = "lines",
    simulated: bool = False,
) -> LineSensor:
    r"""A sensor that prints lines at ``port`` (a path, ``COM3``: untested, ``socket://host:port``).

    ``pattern`` (in RE2's syntax) must match a whole line of at most `LINE_MAX` bytes, ends
    stripped; a float is ``[-+0-9.eE]+``. ``ask`` is sent
    before every reading if the device speaks only when asked (``"?\r"``). ``rate_hz``: how often
    lines come; without a group ``time`` a line counts as taken when it arrived, less
    ``latency_ms``. ``decimal`` and ``thousands``: how numbers are written. A group ``unit`` must
    be the first channel's: a gauge that is switched to another ends the scan. Raises `ConfigError`.
    """
    if decimal == thousands:
        raise ConfigError(f"thousands = {thousands!r}: must differ from decimal = {decimal!r}")
    compiled = LinePattern(pattern)
    groups = sorted(set(compiled.groups) - {TIME, UNIT})
    if not channel or sorted(c.name for c in channel) != groups:
        raise ConfigError(
            f"pattern = {pattern!r}: has groups {groups}; there must be one [[sensor.channel]] "
            "with the same name for each, and at least one"
        )

    def open_source() -> LineSource:
        return LineSource(
            clock, name, port, baud, compiled, channel, ask.encode(), 1 / rate_hz, time_unit_s,
            1e-3 * latency_ms, number_reader(decimal, thousands),
        )  # fmt: skip

    return LineSensor(
        clock, name, tuple(c.channel() for c in channel), rate_hz, open_source, simulated=simulated
    )
