"""A UR arm as a stage: straight tool moves that can be stopped, poses in the scan frame."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from drivers.errors import ConfigError, DeviceFault
from drivers.protocols import Clock, Pose
from drivers.ur.client import Setup, State
from drivers.ur.link import Link, leave_link, take_link

Point = tuple[float, float, float]

ARRIVED_M = 0.1e-3
STILL_M, STILL_S = 5e-6, 0.02
STARTS_S = 0.5  # a move that was accepted is under way within this long


class UrStage:
    """The arm at ``host``; see `open_stage`."""

    turns = True

    def __init__(
        self, name: str, setup: Setup, origin_m: Point, yaw: Rotation,
        tool: Rotation, acceleration_m_s2: float, max_speed_m_s: float, simulated: bool,
    ) -> None:  # fmt: skip
        self.name = name
        self.simulated = simulated
        self._setup = setup
        self._origin_m = np.array(origin_m)
        self._yaw = yaw
        self._tool = tool
        self._acceleration_m_s2 = acceleration_m_s2
        self._max_speed_m_s = max_speed_m_s
        self._link: Link | None = None
        self._target: Pose | None = None
        self._set_off_s = 0.0

    def connect(self) -> None:
        """Connect, and upload the library's control program. Raises `DeviceAbsent`."""
        if self._link is None:
            self._link = take_link(self.name, self._setup)
            try:
                self._link.state()
            except DeviceFault:
                self.close()
                raise

    def pose(self) -> Pose:
        """The tool centre point in the scan frame."""
        return self._pose(self._there().state())

    def _pose(self, state: State) -> Pose:
        place = self._yaw.inv().apply(np.array(state.pose[:3]) - self._origin_m)
        turn = self._yaw.inv() * Rotation.from_rotvec(state.pose[3:]) * self._tool.inv()
        return Pose(*map(float, place), *map(float, turn.as_rotvec()))

    def move(self, target: Pose, speed_m_s: float) -> None:
        """Set off in a straight line. Raises `DeviceFault` if refused, or `ConfigError`."""
        if not 0 < speed_m_s <= self._max_speed_m_s:
            raise ConfigError(
                f"{self.name}: speed {1e3 * speed_m_s:g} mm/s; allowed is above 0 up to "
                f"max_speed_mm_s = {1e3 * self._max_speed_m_s:g}"
            )
        link = self._there()
        link.state()
        place = self._origin_m + self._yaw.apply(target[:3])
        turn = self._yaw * Rotation.from_rotvec(target[3:]) * self._tool
        base = (*map(float, place), *map(float, turn.as_rotvec()))
        self._target = target
        link.command("move", base, speed_m_s, self._acceleration_m_s2)
        self._set_off_s = link.state().timestamp_s

    def moving(self) -> bool:
        """True until the tip rests at the target. Raises `DeviceFault` if it rests elsewhere."""
        link = self._there()
        state, before = link.state(), link.earlier(STILL_S)
        here = np.array(self._pose(state)[:3])
        # by the controller's time: on a busy machine states come late, and the arm is not at rest
        still = before is not None and math.dist(state.pose[:3], before.pose[:3]) < STILL_M
        if self._target is None:
            return not still
        off_m = float(np.linalg.norm(here - np.array(self._target[:3])))
        if still and off_m < ARRIVED_M:
            self._target = None
            return False
        if still and state.timestamp_s - self._set_off_s > STARTS_S:
            self._target = None
            raise DeviceFault(self.name, f"came to rest {1e3 * off_m:.2f} mm from its target")
        return True

    def stop(self) -> None:
        """Halt where it is."""
        self._target = None
        if (link := self._link) is not None:
            link.stop(self._acceleration_m_s2)

    def close(self) -> None:
        """Halt and disconnect."""
        link, self._link = self._link, None
        if link is not None:
            link.stop(self._acceleration_m_s2)
            leave_link(link)

    def _there(self) -> Link:
        if self._link is None:
            raise DeviceFault(self.name, "not connected")
        return self._link


def open_stage(
    clock: Clock,  # noqa: ARG001 - what every driver is given; the arm has its own
    *,
    host: str = "127.0.0.1",
    frequency_hz: float = 500.0,
    origin_mm: Point = (0.0, 0.0, 0.0),
    yaw_deg: float = 0.0,
    tool_rotvec_rad: Point = (0.0, math.pi, 0.0),
    tcp_mm_rad: tuple[float, float, float, float, float, float] | None = None,
    payload_kg: float | None = None,
    payload_centre_mm: Point = (0.0, 0.0, 0.0),
    acceleration_mm_s2: float = 500.0,
    max_speed_mm_s: float = 100.0,
    name: str = "ur",
    simulated: bool = False,
) -> UrStage:
    """The arm at ``host``.

    ``origin_mm`` and ``yaw_deg`` say where the scan frame lies in the robot's base frame;
    ``tool_rotvec_rad`` is the tool's orientation there when it presses straight down.
    ``tcp_mm_rad`` and ``payload_kg`` are set on the controller if given. ``simulated``: the
    controller is emulated. Raises `ConfigError`.
    """
    for key, value in (("frequency_hz", frequency_hz), ("acceleration_mm_s2", acceleration_mm_s2),
                       ("max_speed_mm_s", max_speed_mm_s)):  # fmt: skip
        if not value > 0:
            raise ConfigError(f"{key} = {value:g}: must be above 0")
    if frequency_hz > 500:
        raise ConfigError(f"frequency_hz = {frequency_hz:g}: a UR controller sends up to 500")
    x, y, z = (1e-3 * v for v in origin_mm)
    tcp = None if tcp_mm_rad is None else (*(1e-3 * v for v in tcp_mm_rad[:3]), *tcp_mm_rad[3:])
    cx, cy, cz = (1e-3 * v for v in payload_centre_mm)
    return UrStage(
        name, Setup(host, frequency_hz, True, tcp, payload_kg, (cx, cy, cz)), (x, y, z),
        Rotation.from_euler("z", yaw_deg, degrees=True), Rotation.from_rotvec(tool_rotvec_rad),
        1e-3 * acceleration_mm_s2, 1e-3 * max_speed_mm_s, simulated,
    )  # fmt: skip
