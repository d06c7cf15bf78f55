"""A Lab Streaming Layer stream as a sensor: a pulse oximeter, an ECG, a force.

LSL stamps each sample on its sender's clock and measures how that differs from this machine's; the
sum is a time on ``lsl_local_clock`` here (``proc_clocksync``), which this driver moves on to the
scan's clock. A stream comes over TCP and loses nothing on the way; what a sender left out cannot
be known, since many stamp a sample when they get to it. Needs the ``lsl`` extra (pylsl, which
brings liblsl).
"""

import math
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from drivers.core.errors import ConfigError, DeviceAbsent, DeviceFault
from drivers.core.extras import missing, needs
from drivers.core.protocols import Clock
from drivers.core.reader import LineSensor, Sample
from drivers.core.settings import NonNegative, Positive
from drivers.core.timestamps import INSTANT_S
from drivers.lines import TextChannel

if TYPE_CHECKING:
    import pylsl

READ_S = 0.02
RESOLVE_S = 5.0
ANSWER_S = 1.0  # LSL asks again after 0.5 s
OPEN_S = 5.0
CHUNK = 4096
TRIES = 8


def clock_offset_s(clock: Clock) -> float:
    """The scan's clock minus LSL's local clock [s], by the shortest of a few tries."""
    import pylsl

    tries = []
    for _ in range(TRIES):
        before_s, local_s, after_s = clock.now(), pylsl.local_clock(), clock.now()
        tries.append((after_s - before_s, (before_s + after_s) / 2 - local_s))
    return float(min(tries)[1])


def line_errors() -> tuple[type[Exception], ...]:
    """What pylsl raises when a sender has gone or is silent; they are not its public names."""
    from pylsl import util

    return util.LostError, util.TimeoutError


class LslSource:
    """An open inlet; see `drivers.core.reader.Source`."""

    def __init__(
        self,
        clock: Clock,
        name: str,
        inlet: "pylsl.StreamInlet",
        factors: Sequence[float],
        latency_s: float,
    ) -> None:
        self._name, self._inlet, self._factors = name, inlet, factors
        self._shift_s = clock_offset_s(clock) - latency_s
        self._last_s = -math.inf

    def read(self) -> list[Sample]:
        """What has arrived. Raises `DeviceFault` when the sender has gone."""
        try:
            rows, stamps = self._inlet.pull_chunk(timeout=READ_S, max_samples=CHUNK)
        except line_errors() as error:
            raise DeviceFault(self._name, f"the stream has ended ({error})") from None
        return [self._sample(row, stamp) for row, stamp in zip(rows, stamps, strict=True)]

    def _sample(self, row: Sequence[float], stamp_s: float) -> Sample:
        self._last_s = max(stamp_s + self._shift_s, self._last_s + INSTANT_S)
        return Sample(self._last_s, [f * v for f, v in zip(self._factors, row, strict=True)])

    def close(self) -> None:
        """Leave the stream."""
        self._inlet.close_stream()


def _the_stream(name: str, stream: str, source_id: str) -> "pylsl.StreamInfo":
    """The only stream of that name and id: all that answer within `ANSWER_S` are heard, since LSL's
    own search by name ends with the first. Raises `DeviceAbsent`."""
    import pylsl

    until_s = time.monotonic() + RESOLVE_S
    while True:
        streams = [one for one in pylsl.resolve_streams(ANSWER_S) if one.name() == stream]
        chosen = [one for one in streams if source_id in ("", one.source_id())]
        if chosen or time.monotonic() > until_s:
            break
    ids = sorted({one.source_id() for one in streams})
    listed = ", ".join(map(repr, ids))
    if not chosen:
        others = f"; there are those of source_id {listed}" if ids else ""
        raise DeviceAbsent(name, f"no LSL stream {stream!r} within {RESOLVE_S:g} s{others}")
    if len(chosen) > 1 and len(ids) == len(streams):
        raise DeviceAbsent(name, f"several streams {stream!r}: say source_id, one of {listed}")
    if len(chosen) > 1:
        raise DeviceAbsent(
            name,
            f"{len(streams)} outlets carry the name {stream!r} and the source_ids {listed}: end "
            "those that were forgotten, or give each its own source_id",
        )
    return chosen[0]


def open_sensor(
    clock: Clock,
    *,
    stream: str,
    channel: list[TextChannel],
    rate_hz: Positive,
    source_id: str = "",
    latency_ms: NonNegative = 0.0,
    name: str = "lsl",
    simulated: bool = False,
) -> LineSensor:
    """The stream called ``stream``, if several are, that of ``source_id``.

    One ``[[sensor.channel]]`` for each of the stream's channels, in their order. ``rate_hz``: how
    often samples come, as the sender says. ``latency_ms``: what the sender's stamps come after the
    measurement. Raises `ConfigError`, `MissingExtra`.
    """
    try:
        with needs("lsl", 'driver = "lsl"'):
            import pylsl
    except RuntimeError:  # pylsl is there, liblsl is not
        raise missing("lsl", 'driver = "lsl"', "liblsl") from None
    if not channel:
        raise ConfigError("channel: give one [[sensor.channel]] for each channel of the stream")
    channels = tuple(one.channel() for one in channel)
    factors = [one.si_per_number for one in channel]

    def open_source() -> LslSource:
        info = _the_stream(name, stream, source_id)
        if info.channel_format() == pylsl.cf_string:
            raise DeviceAbsent(name, f"the channels of stream {stream!r} are text; numbers needed")
        if (count := info.channel_count()) != len(channels):
            raise DeviceAbsent(name, f"the stream has {count} channels, the rig {len(channels)}")
        inlet = pylsl.StreamInlet(info, recover=False, processing_flags=pylsl.proc_clocksync)
        try:
            inlet.open_stream(timeout=OPEN_S)
        except line_errors() as error:
            raise DeviceAbsent(name, f"the stream does not open ({error})") from None
        return LslSource(clock, name, inlet, factors, 1e-3 * latency_ms)

    return LineSensor(clock, name, channels, rate_hz, open_source, simulated=simulated)
