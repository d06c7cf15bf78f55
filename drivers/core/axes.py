"""What a driver of a stage on a line gives to `LineStage`: its settings and its open controller."""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

from drivers.core.errors import ConfigError
from drivers.core.ports import PortName
from drivers.core.settings import Baud, Point, Positive, Settings
from drivers.core.stage_limits import AXES, Limits


class LineStageSettings(Settings):
    """The keys that all of them have.

    ``origin_mm``: where the scan's (0, 0, 0) lies in the controller's positions; an axis counted
    against the scan's has a negative number of counts per mm. ``limits_mm`` bounds targets in the
    scan frame. With ``home`` a scan begins at the reference switches, z first, and then goes to
    ``park_mm``. ``status_hz``: positions asked for a second. ``answer_s``: how long an answer may
    take (an exchange is milliseconds; a USB adapter may hold one back for 16). ``silent_s``: the
    age at which the last known position is a fault (2.5 mm/s: half a millimetre).
    """

    port: PortName
    baud: Baud = 115200
    origin_mm: Point = (0.0, 0.0, 0.0)
    limits_mm: Limits | None = None
    max_speed_mm_s: Positive = 10.0
    home: bool = False
    park_mm: Point | None = None
    status_hz: Positive = 100.0
    answer_s: Positive = 0.1
    silent_s: Positive = 0.25
    arrived_mm: Positive = 0.05


def check_axes(settings: LineStageSettings, counts_per_mm: str) -> None:
    """Raises `ConfigError` unless an axis is named, and each gives its key ``counts_per_mm``."""
    named = [keys for axis in AXES if (keys := getattr(settings, axis))]
    if not named or not all(getattr(keys, counts_per_mm) for keys in named):
        raise ConfigError(f"x, y, z: name at least one axis, each with {counts_per_mm} not 0")


class Reading(NamedTuple):
    """Positions [mm] by axis, whether any moves, and in its own words why one cannot."""

    places_mm: Mapping[str, float]
    moving: bool
    fault: str = ""


class Axes(Protocol):
    """An open controller with some of the axes x, y, z.

    Every method may raise `NoAnswer` (asked again until ``silent_s``), `DeviceFault` (refused; when
    reading: the end) or `OSError` (the line is lost). It may have ``home(axis)``, which begins the
    reference move of one axis, and ``ready() -> list[str]``, asked before the first move: what
    holds, in words, or `DeviceFault`; ``travel_mm``, each axis's least and greatest place as far as
    it is known then; ``retargets = True``, if a `move` in motion leads on without a stop: a move is
    then given in segments, see `drivers.core.segments`; and ``harder``, a table of `StopMeans` for
    axes that do not obey `stop`: what they take away, such as a motor's current, the next `move`
    gives back.
    """

    names: str

    def read(self) -> Reading:
        """Where all axes are.

        Whether they move is asked first, so that what rests is read at rest.
        """
        ...

    def move(self, places_mm: Mapping[str, float], speeds_mm_s: Mapping[str, float]) -> None:
        """Set the named axes off, and return; without speeds (`retargets`), lead them on."""
        ...

    def stop(self) -> None:
        """Have all axes slow down now."""
        ...

    def close(self) -> None:
        """Release the line."""
        ...
