"""What the engine asks of the guards, wherever they are: in this process, or in another."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from drivers import Block, Pose
from probe.guards.device_facts import Facts
from probe.guards.interruption import Trip
from probe.guards.levels import Levels


class WayOut(NamedTuple):
    """How the way out stands: see `probe.guards.retreat.Retreat`."""

    done: bool = False
    lifting: bool = False
    up: bool = False
    unsure: bool = False
    why_not: str | None = None
    unheeded: tuple[str, ...] = ()


class Status(NamedTuple):
    """How things stand.

    ``error`` is a mistake in a driver or guard. ``seen_s``: up to when the samples of every sensor
    are in; ``force_n`` is the latest force. ``way_out`` is None where there is none. ``homed``: a
    homing is over. ``pace`` is the stage's. ``jumped`` is a device whose clock stood still, and for
    how long, said once.
    """

    trip: Trip | None
    error: BaseException | None
    seen_s: float
    force_n: float
    way_out: WayOut | None = None
    homed: bool = False
    pace: float = 1.0
    jumped: tuple[str, float] | None = None


class Guards(Protocol):
    """`probe.guards.safety_monitor.SafetyMonitor`, or one in another process.

    `ready` comes first: devices are connected, and the stage is asked whether it can go to all
    poses. `look` is the engine's heartbeat; where no thread does, it also reads and checks. Without
    a lift, `leave` ends one that is under way. All that asks the stage raises `DeviceFault`.
    """

    @property
    def facts(self) -> Facts: ...
    @property
    def threaded(self) -> bool: ...

    def ready(self, poses: Sequence[Pose]) -> list[str]: ...
    def start(self, *, homes: bool) -> Status: ...
    def look(self) -> Status: ...
    def collect(self) -> list[tuple[str, Block]]: ...
    def levels(self, from_s: float) -> Levels: ...
    def touched_n(self, since_s: float, readings: int = 1) -> float | None: ...
    def finish(self) -> None: ...

    def pose(self) -> Pose: ...
    def moving(self) -> bool: ...
    def move(self, target: Pose, speed_m_s: float, *, search: bool = False) -> None: ...
    def arrived(self, pose: Pose) -> None: ...
    def tare(self) -> None: ...
    def home(self) -> None: ...
    def stop(self) -> None: ...
    def leave(self, *, lift: bool) -> Status: ...
    def go_on(self) -> None: ...
