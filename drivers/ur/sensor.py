"""The force at a UR's tool, at the controller's own time; shares the stage's connection."""

import time
from contextlib import suppress

import numpy as np
from scipy.spatial.transform import Rotation

from drivers.core.errors import DeviceFault
from drivers.core.extras import require_library
from drivers.core.protocols import Channel, Clock
from drivers.core.reader import LineSensor, Sample
from drivers.core.timestamps import DeviceTime
from drivers.ur.client import State
from drivers.ur.link import Link, leave_link, take_link
from drivers.ur.settings import Normal, UrSensorSettings
from drivers.ur.version import E_SERIES_HZ

SET_AHEAD_S = 0.5  # between two states: later ones that wait for the client come as late as it
AXES = ("fx", "fy", "fz", "mx", "my", "mz")
SETTLE_S = 0.15  # after zeroing, until a tare's samples are all from after it
TOOL_AXIS = np.array([0.0, 0.0, 1.0])


class WrenchSource:
    """See `drivers.core.reader.Source`."""

    def __init__(self, clock: Clock, link: Link, normal: Normal) -> None:
        self._clock = clock
        self._link = link
        self._normal = normal
        self._time = DeviceTime(stands_still=True)
        self._last: State | None = None

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
        if self._last is not None:  # a clock that is set ahead loses nothing that was sent
            went_s = state.timestamp_s - self._last.timestamp_s
            passed_s = state.arrival_s - self._last.arrival_s
            if went_s - passed_s < SET_AHEAD_S:
                missing = max(round(went_s * self._link.rate_hz) - 1, 0)
        self._last = state
        force = pressed_n(state.wrench, state.pose, self._normal)
        return Sample(time_s, [force, *state.wrench], missing, self._time.jumped_s)


def pressed_n(wrench: tuple[float, ...], pose: tuple[float, ...], normal: Normal) -> float:
    """The normal force [N] in a wrench at the tool, base frame; positive when pressed.

    The tool presses along its own z axis, wherever the arm holds it, and what is pressed pushes
    back against it.
    """
    if normal != "tool":
        return (1.0 if normal[0] == "+" else -1.0) * wrench[AXES.index(normal[1:])]
    axis = Rotation.from_rotvec(pose[3:]).apply(TOOL_AXIS)
    return -float(np.dot(wrench[:3], axis))


class UrForce(LineSensor):
    """A `LineSensor` that lets the robot zero its own sensor before each tare: it drifts."""

    link: Link | None = None

    def tare(self) -> None:
        """Zero on the controller where this scan controls it, then take what is left as zero."""
        if self.link is not None and self.link.controls:
            self.link.command("zero")
            self._clock.sleep_until(self._clock.now() + SETTLE_S)
        super().tare()


def open_sensor(clock: Clock, settings: UrSensorSettings) -> UrForce:
    """The tool force of the arm at ``settings.host``, not yet connected. Raises `MissingExtra`."""
    require_library("ur")
    channels = (
        Channel("force", "N", "force", full_scale=settings.full_scale_n),
        *(Channel(axis, "N") for axis in AXES[:3]),
        *(Channel(axis, "Nm") for axis in AXES[3:]),
    )

    def open_source() -> WrenchSource:
        keys = settings
        link = take_link(keys.name, keys.host, keys.rate_hz, keys.silence_s, keys.connect_s)
        sensor.link, sensor.rate_hz = link, link.rate_hz
        with suppress(DeviceFault):
            link.samples(0.0)  # what came before is nobody's
        return WrenchSource(clock, link, settings.normal)

    expected_hz = settings.rate_hz or E_SERIES_HZ
    sensor = UrForce(
        clock, settings.name, channels, expected_hz, open_source, simulated=settings.simulated
    )
    return sensor
