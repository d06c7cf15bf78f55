"""What every channel of every sensor reads now: value, tared value, rate, noise and age."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drivers import Block, Channel, Clock, DeviceFault, Sensor
from drivers.core.arrays import Array, Bools
from drivers.core.errors import as_fault
from probe.guards.sample_times import SampleTimes

WINDOW_S = 1.0
"""Values are means, and noise is taken, over the last second."""
MIN_SAMPLES = 3
"""Fewer say nothing of noise."""
DECIMALS, MOST_DECIMALS = 3, 9
"""Where a reading has no noise, and at most."""
HEAD = ("channel", "raw", "tared", "unit", "noise rms", "drift /s", "rate Hz", "age ms", "")


@dataclass(frozen=True)
class Reading:
    """One channel over the last `WINDOW_S`, in its own unit, uncalibrated.

    ``raw`` is the mean as the device gives it, ``tared`` that less the mean at the last tare, each
    None without samples. ``noise`` is the standard deviation about a straight line and ``drift``
    that line's slope per second. ``age_s`` is how old the newest sample is; ``lost`` counts
    samples known to be missing. ``clipped``: some sample was at the end of the range.
    """

    sensor: str
    channel: Channel
    raw: float | None
    tared: float | None
    noise: float | None
    drift: float | None
    rate_hz: float
    wanted_hz: float
    age_s: float | None
    lost: int
    clipped: bool
    fault: str | None

    def row(self) -> tuple[str, ...]:
        """Words under `HEAD`."""
        marks = (
            "SIMULATED" if self.channel.simulated else "",
            self.fault or ("clipped" if self.clipped else ""),
            f"{self.lost} lost" if self.lost else "",
        )
        return (
            f"{self.sensor}.{self.channel.name}",
            _number(self.raw, self.noise),
            _number(self.tared, self.noise),
            self.channel.unit,
            _number(self.noise, self.noise),
            "-" if self.drift is None else f"{self.drift:+.{_decimals(self.noise)}f}",
            f"{self.rate_hz:.0f} of {self.wanted_hz:.0f}",
            "-" if self.age_s is None else f"{1e3 * max(self.age_s, 0.0):.0f}",
            " ".join(mark for mark in marks if mark),
        )


def _number(value: float | None, noise: float | None) -> str:
    """With as many decimals as the noise lets stand."""
    if value is None:
        return "-"
    decimals = _decimals(noise)
    return f"{round(value, decimals) + 0.0:.{decimals}f}"  # never -0.00


def _decimals(noise: float | None) -> int:
    digits = 1 - math.floor(math.log10(noise)) if noise else DECIMALS
    return min(max(digits, 0), MOST_DECIMALS)


@dataclass
class _Kept:
    """The samples of one sensor that are still of interest."""

    sensor: Sensor
    time_s: Array = field(default_factory=lambda: np.empty(0))
    values: Array = field(init=False)
    saturated: Bools = field(init=False)
    zero: Array | None = None
    lost: int = 0
    fault: str | None = None
    times: SampleTimes = field(default_factory=SampleTimes)
    looked_s: float = 0.0

    def __post_init__(self) -> None:
        self.values = np.empty((0, len(self.sensor.channels)))
        self.saturated = np.empty(self.values.shape, dtype=bool)

    def take(self, now_s: float) -> None:
        if self.fault is None:
            try:
                block = self.sensor.read()
                self._check_times(block, now_s)
            except Exception as error:  # noqa: BLE001 - drivers of others may raise anything
                self.fault = str(as_fault(self.sensor.name, error))
            else:
                self.lost += block.lost
                self.time_s = np.concatenate([self.time_s, block.time_s])
                self.values = np.concatenate([self.values, block.values])
                self.saturated = np.concatenate([self.saturated, block.saturated])
        # of a slow or silent sensor the last sample stays
        begin = np.searchsorted(self.time_s, now_s - WINDOW_S)
        recent = slice(min(int(begin), max(len(self.time_s) - 1, 0)), None)
        self.time_s = self.time_s[recent]
        self.values, self.saturated = self.values[recent], self.saturated[recent]

    def _check_times(self, block: Block, now_s: float) -> None:
        """Raises `DeviceFault` where samples are not of the time since the last look."""
        looked_s, self.looked_s = self.looked_s, now_s
        if not len(block.time_s):
            return
        newest_s = float(block.time_s[-1])
        why = self.times.check(block, now_s)
        if why is None and newest_s < looked_s - WINDOW_S:
            why = f"samples arrive {now_s - newest_s:.4g} s late by their own times"
        if why is not None:
            raise DeviceFault(self.sensor.name, f"{why}; a scan would end here")

    def readings(self, now_s: float) -> list[Reading]:
        count = len(self.time_s)
        span_s = float(self.time_s[-1] - self.time_s[0]) if count else 0.0
        rate_hz = (count - 1) / span_s if span_s > 0 else 0.0
        return [
            self._one(n, channel, rate_hz, now_s) for n, channel in enumerate(self.sensor.channels)
        ]

    def _one(self, n: int, channel: Channel, rate_hz: float, now_s: float) -> Reading:
        values = self.values[:, n]
        raw = tared = noise = drift = None
        if len(values):
            raw = float(values.mean())
            tared = None if self.zero is None else raw - float(self.zero[n])
        if len(values) >= MIN_SAMPLES and np.isfinite(values).all():
            line = np.polynomial.Polynomial.fit(self.time_s, values, 1)
            noise = float(np.std(values - line(self.time_s), ddof=2))
            drift = float(line.deriv()(now_s))
        return Reading(
            self.sensor.name,
            channel,
            raw,
            tared,
            noise,
            drift,
            rate_hz,
            self.sensor.rate_hz,
            now_s - float(self.time_s[-1]) if len(values) else None,
            self.lost,
            bool(self.saturated[:, n].any()),
            self.fault,
        )


class Watch:
    """Follows sensors that are connected; begins them, and ends them when its context is left.

    The first full second is taken as zero; `tare` does it anew. No device is tared.
    """

    def __init__(self, sensors: Sequence[Sensor], clock: Clock) -> None:
        self._clock = clock
        self._kept = [_Kept(sensor) for sensor in sensors]
        self._began_s = clock.now()

    def __enter__(self) -> "Watch":
        for kept in self._kept:
            try:
                kept.sensor.start()
            except Exception as error:  # noqa: BLE001 - drivers of others may raise anything
                kept.fault = str(as_fault(kept.sensor.name, error))
        self._began_s = self._clock.now()
        for kept in self._kept:
            kept.looked_s = self._began_s
        return self

    def __exit__(self, *_error: object) -> None:
        for kept in self._kept:
            kept.sensor.stop()

    def readings(self) -> list[Reading]:
        """What each channel reads now; call it several times a second."""
        now_s = self._clock.now()
        for kept in self._kept:
            kept.take(now_s)
            if kept.zero is None and now_s - self._began_s >= WINDOW_S and len(kept.time_s):
                kept.zero = kept.values.mean(axis=0)
        return [one for kept in self._kept for one in kept.readings(now_s)]

    def tare(self) -> None:
        """Take the last second as zero, of what is shown here."""
        for kept in self._kept:
            if len(kept.time_s):
                kept.zero = kept.values.mean(axis=0)
