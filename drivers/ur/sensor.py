"""The force at a UR's tool, at the controller's own time; shares the stage's connection."""

import time
from contextlib import suppress
from typing import Literal

from drivers.errors import ConfigError, DeviceFault
from drivers.protocols import Channel, Clock
from drivers.reader import LineSensor, Sample
from drivers.stamps import DeviceTime
from drivers.ur.client import Setup, State
from drivers.ur.link import Link, leave_link, take_link

AXES = ("fx", "fy", "fz", "mx", "my", "mz")
Normal = Literal["+fx", "-fx", "+fy", "-fy", "+fz", "-fz"]
SETTLE_S = 0.15  # after zeroing, until a tare's samples are all from after it


class WrenchSource:
    """See `drivers.reader.Source`."""

    def __init__(self, clock: Clock, link: Link, rate_hz: float, normal: Normal) -> None:
        self._clock = clock
        self._link = link
        self._rate_hz = rate_hz
        self._sign = 1.0 if normal[0] == "+" else -1.0
        self._axis = AXES.index(normal[1:])
        self._time = DeviceTime()
        self._last_s: float | None = None

    def read(self) -> list[Sample]:
        """What has come."""
        return [self._sample(state) for state in self._link.samples(0.05)]

    def close(self) -> None:
        """Leave the connection."""
        leave_link(self._link)

    def _sample(self, state: State) -> Sample:
        arrival_s = self._clock.now() - (time.monotonic() - state.arrival_s)
        time_s = self._time.stamp(state.timestamp_s, arrival_s)
        missing = 0
        if self._last_s is not None:
            missing = max(round((state.timestamp_s - self._last_s) * self._rate_hz) - 1, 0)
        self._last_s = state.timestamp_s
        return Sample(time_s, [self._sign * state.wrench[self._axis], *state.wrench], missing)


class UrForce(LineSensor):
    """A `LineSensor` that lets the robot zero its own sensor before each tare: it drifts."""

    link: Link | None = None

    def tare(self) -> None:
        """Zero on the controller where this scan controls it, then take what is left as zero."""
        if self.link is not None and self.link.setup.control:
            self.link.command("zero")
            self._clock.sleep_until(self._clock.now() + SETTLE_S)
        super().tare()


def open_sensor(
    clock: Clock,
    *,
    host: str = "127.0.0.1",
    rate_hz: float = 500.0,
    normal: Normal = "+fz",
    full_scale_n: float = 50.0,
    name: str = "ur force",
    simulated: bool = False,
) -> UrForce:
    """The tool force of the arm at ``host``, in the base frame.

    The channel ``force`` is the axis ``normal``, positive when pressed: pressing down, the tissue
    pushes the tool up. Raises `ConfigError`.
    """
    if not 0 < rate_hz <= 500:
        raise ConfigError(f"rate_hz = {rate_hz:g}: a UR controller sends above 0 up to 500")
    channels = (
        Channel("force", "N", "force", full_scale=full_scale_n),
        *(Channel(axis, "N") for axis in AXES[:3]),
        *(Channel(axis, "Nm") for axis in AXES[3:]),
    )
    setup = Setup(host, rate_hz, False, None, None, (0.0, 0.0, 0.0))

    def open_source() -> WrenchSource:
        link = take_link(name, setup)
        sensor.link = link
        with suppress(DeviceFault):
            link.samples(0.0)  # what came before is nobody's
        return WrenchSource(clock, link, rate_hz, normal)

    sensor = UrForce(clock, name, channels, rate_hz, open_source, simulated=simulated)
    return sensor
