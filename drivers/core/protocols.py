"""What the scan engine asks of a clock, a stage and a sensor: nothing more than this.

Lengths are metres, times seconds, forces newtons. The scan frame is right-handed: x along a
row of stations, y across the rows, z up out of the surface.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, get_args, runtime_checkable

from drivers.core.arrays import Array, Bools


class Pose(NamedTuple):
    """Where the probe tip is, in the scan frame.

    ``x, y, z`` in metres; ``rx, ry, rz`` a rotation vector in radians (0 = pressing along -z).
    """

    x: float
    y: float
    z: float
    rx: float = 0.0
    ry: float = 0.0
    rz: float = 0.0


MAX_RATE_HZ = 1e5
"""Of a sensor: faster than any of force, and a mistyped rate reserves no memory."""
Role = Literal["force", "pressure", "taxel", "reference", "other"]
ROLES: tuple[Role, ...] = get_args(Role)
"""What a sensor's channel may be; recordings made elsewhere have depths too."""
UNIT_OF_ROLE = {"force": "N", "pressure": "Pa", "taxel": "Pa"}  # after calibration


@dataclass(frozen=True)
class Channel:
    """One quantity a sensor reads.

    ``simulated`` is carried to every file, report and window that shows the channel.
    ``role``: ``force`` (normal force, positive when pressed), ``pressure`` (contact stress, Pa),
    ``taxel`` (one of an array), ``reference`` (PPG or ECG), ``depth`` (of the probe's tip below the
    surface, of recordings made elsewhere), ``other``.
    """

    name: str
    unit: str
    role: str = "other"
    simulated: bool = False
    full_scale: float | None = None


@dataclass(frozen=True)
class Block:
    """Samples read at once: ``time_s`` (n,) on the scan clock, ``values`` (n, channels).

    ``saturated`` (n, channels) is True where the sensor clipped: such a value is a bound, not a
    reading. ``lost`` counts samples known to be missing since the block before. ``jumped_s`` > 0:
    the device's clock was found to have stood still; the times of samples given out shortly before
    are too early by up to this, and what was pressed meanwhile must be pressed again.
    """

    time_s: Array
    values: Array
    saturated: Bools
    lost: int = 0
    jumped_s: float = 0.0


@runtime_checkable
class Clock(Protocol):
    """The time everything of one scan is measured on."""

    def now(self) -> float:
        """Seconds since an arbitrary zero; never goes back."""
        ...

    def sleep_until(self, time_s: float) -> None:
        """Return when ``now() >= time_s``."""
        ...


@runtime_checkable
class Stage(Protocol):
    """What moves the probe. Connecting only reads: nothing moves, nothing on the device changes.

    A stage may have more, and is asked only for what it has:

    - ``turns = True``: it can turn the probe.
    - ``homes = True`` and ``home()``: it must find its switches before it can be used. `home`
      blocks, goes wherever the scan may begin, and raises `DeviceFault` when stopped.
    - ``enable() -> list[str]``: make ready to move (upload a program, set what the rig file says)
      without moving; what then holds, in words. Called once, before a scan's first move.
    - ``enable_s``: how long `enable` may take, for one that may need more than a few seconds.
    - ``stop_means() -> Sequence[StopMeans]``: its ways to stop in the order in which the way out
      takes them, each with the time in which it must be seen to work; the first is what `stop`
      does. See `drivers.core.abilities.StopMeans`. Without it `stop` is the only one.
    - ``keep_alive()``: called by whoever checks the force, each time that it has; a device with a
      watchdog halts by itself when the calls stop.
    - ``start_again()``: called by the way out alone, where the stage does not answer: what its
      watchdog ended is begun again, so that the probe can be lifted; what a person ended is not.
    - ``lift_when_alone(z_m, speed_m_s)``: told before the first move; where this process dies, what
      is left of the driver (a process of its own, the controller) stops, and lifts the tip straight
      up to ``z_m``.
    - ``finds_contact``, ``search(target, speed_m_s)`` and ``touched``: where the first is true,
      the second moves as `move`, and the device itself stops at a contact on the way, and may go
      back to where it began; the third is then true.
    - ``max_speed_m_s``: above it a move is refused; a scan or a lift that is faster is not begun.
    - ``limits_mm``: bounds of x, y and z in the scan frame; a scan that goes beyond is not begun.
    - ``beyond_limits(poses) -> dict[Pose, str]``: those out of its bounds, and why, where
      these are not in the scan frame.
    - ``park_mm``: where `home` ends; one out of ``limits_mm`` or the workspace is not gone to.
    - ``pace``: the share of a commanded speed that the device allows now, above 0 up to 1.
    - ``why_still() -> str | None``: what holds a move up now, in the device's own words (an open
      door, a feed hold, a slider at 0); asked where a move stands still.
    - ``unreachable(poses) -> dict[Pose, str]``: those that it cannot go to in this order, and why;
      asked before the first move.
    - ``base_pose() -> Pose``: where the tool is in the arm's own frame, from which `palpate teach`
      finds the keys ``origin_mm``, ``roll_deg``, ``pitch_deg``, ``yaw_deg``, ``tool_rotvec_rad``.
    """

    @property
    def name(self) -> str: ...
    @property
    def simulated(self) -> bool: ...

    def connect(self) -> None:
        """Open the device; nothing moves. Raises `DeviceAbsent` if it is not there. Idempotent."""
        ...

    def pose(self) -> Pose:
        """Measured tip pose. Raises `DeviceFault` when the reading is stale."""
        ...

    def move(self, target: Pose, speed_m_s: float) -> None:
        """Start a straight move and return at once. Raises `DeviceFault` if refused."""
        ...

    def moving(self) -> bool:
        """True until the last move has ended. Raises `DeviceFault` if it failed."""
        ...

    def stop(self) -> None:
        """Halt where it is. Idempotent, callable from any thread at any time, never raises."""
        ...

    def close(self) -> None:
        """Stop and release the device. Idempotent."""
        ...


@runtime_checkable
class Sensor(Protocol):
    """What feels. Reading never blocks; a driver with a slow line has a thread of its own."""

    @property
    def name(self) -> str: ...
    @property
    def channels(self) -> tuple[Channel, ...]: ...
    @property
    def rate_hz(self) -> float: ...

    def connect(self) -> None:
        """Open the device. Raises `DeviceAbsent` if it is not there. Idempotent."""
        ...

    def start(self) -> None:
        """Begin sampling; timestamps are on the scan's clock."""
        ...

    def read(self) -> Block:
        """All samples since the last call (possibly none). Raises `DeviceFault` when lost."""
        ...

    def tare(self) -> None:
        """Take the present load as zero."""
        ...

    def stop(self) -> None:
        """End sampling. Idempotent, never raises."""
        ...

    def close(self) -> None:
        """Stop and release the device. Idempotent."""
        ...
