"""Standa axes (8SMC4/8SMC5 controllers) by their maker's ``libximc``, one controller per axis.

``xi-emu:///file`` is the library's own virtual axis. Positions are full steps and microsteps;
an axis that the rig leaves out stands still at 0.
"""

import math
import threading
from collections.abc import Mapping
from typing import Any

from drivers.core.abilities import StopMeans
from drivers.core.errors import ConfigError, DeviceAbsent, DeviceFault
from drivers.core.extras import require_library
from drivers.core.protocols import Clock, Pose
from drivers.core.settings import Positive
from drivers.core.stage_limits import (
    AXES,
    STILL_MM,
    Limits,
    check_speed,
    check_target,
    check_upright,
    check_way,
)

ANSWER_S = 0.2
"""To hear a command of each of three axes and to read that they rest: the virtual axes take 1 ms
each, a USB controller a few; nothing but the next, harder stop depends on it."""
LOST = (ConnectionError, OSError, RuntimeError, ValueError)
"""What libximc raises where an axis does not answer or refuses."""


class StandaStage:
    """Up to three axes; each move gives them speeds so that they arrive together."""

    def __init__(
        self,
        name: str,
        uris: Mapping[str, str],
        steps_per_mm: Mapping[str, float],
        origin_mm: Mapping[str, float],
        limits_mm: Limits | None,
        max_speed_mm_s: float,
        acceleration_mm_s2: float,
    ) -> None:
        self.name = name
        self.simulated = any(uri.startswith("xi-emu:") for uri in uris.values())
        self._uris = uris
        self._steps_per_mm = steps_per_mm
        self._origin_mm = origin_mm
        self.limits_mm = limits_mm
        self.max_speed_m_s = 1e-3 * max_speed_mm_s
        self._max_speed_mm_s = max_speed_mm_s
        self._acceleration_mm_s2 = acceleration_mm_s2
        self._open: dict[str, Any] = {}
        self._microsteps: dict[str, int] = {}
        self._opening = threading.Lock()
        self._stops = 0

    def connect(self) -> None:
        """Open every axis and set its acceleration. Raises `DeviceAbsent`."""
        import libximc.highlevel as ximc

        with self._opening:
            if self._open:
                return
            for axis, uri in self._uris.items():
                device = ximc.Axis(uri)
                try:
                    device.open_device()
                    self._open[axis] = device
                    mode = int(device.get_engine_settings().MicrostepMode)
                    self._microsteps[axis] = 2 ** (mode - 1)
                    self._set_speed(axis, self._max_speed_mm_s)
                except LOST as error:
                    self._release()
                    raise DeviceAbsent(
                        self.name, f"{axis}_uri = {uri!r}: {str(error).splitlines()[0]}"
                    ) from None

    def pose(self) -> Pose:
        """Where the controllers are. Raises `DeviceFault`."""
        here = dict.fromkeys(AXES, 0.0)
        for axis in self._uris:
            here[axis] = 1e-3 * self._position_mm(axis)
        return Pose(**here)

    def move(self, target: Pose, speed_m_s: float) -> None:
        """Set off. Raises `DeviceFault` if out of bounds, too fast, or still moving."""
        if self.moving():
            raise DeviceFault(self.name, "still moving; wait or stop before the next move")
        check_speed(self.name, self._max_speed_mm_s, speed_m_s)
        check_upright(self.name, target)
        stops = self._stops
        here = self.pose()
        check_way(self.name, self._uris, here, target)
        check_target(self.name, self.limits_mm, target)
        way = {axis: 1e3 * (b - a) for axis, a, b in zip(AXES, here, target, strict=False)}
        length = math.hypot(*way.values())
        for axis, distance in way.items():
            if abs(distance) > STILL_MM:
                self._set_speed(axis, 1e3 * speed_m_s * abs(distance) / length)
        for axis, distance in way.items():
            if abs(distance) > STILL_MM:
                steps, micro = self._steps(axis, 1e3 * getattr(target, axis))
                self._ask(axis, "command_move", steps, micro)
        if stops != self._stops:  # stopped while the axes were being commanded
            self.stop()

    def moving(self) -> bool:
        """True until every axis rests. Raises `DeviceFault` on an alarm or a failed move."""
        moves = [self._axis_moves(axis) for axis in self._uris]  # an alarm of any axis counts
        return any(moves)

    def stop(self) -> None:
        """Slow every axis down at its acceleration."""
        self._stops += 1
        self._each("command_sstp")

    def _each(self, command: str) -> None:
        for device in list(self._open.values()):
            try:
                getattr(device, command)()
            except LOST:
                continue  # a lost axis shows in `moving`; the others must still be stopped

    def stop_means(self) -> tuple[StopMeans, ...]:
        """`stop`, and the immediate one (STOP), which a stepping motor may lose steps by."""
        brakes_s = self._max_speed_mm_s / self._acceleration_mm_s2
        return (
            StopMeans("soft stop (SSTP)", self.stop, ANSWER_S + brakes_s),
            StopMeans("immediate stop (STOP)", self._stop_at_once, ANSWER_S),
        )

    def _stop_at_once(self) -> None:
        self._stops += 1
        self._each("command_stop")

    def close(self) -> None:
        """Stop and release every axis."""
        with self._opening:
            self.stop()
            self._release()

    def _release(self) -> None:
        for device in self._open.values():
            try:
                device.close_device()
            except LOST:
                continue  # unplugged: there is nothing to release
        self._open = {}

    def _ask(self, axis: str, call: str, *arguments: Any) -> Any:
        device = self._open.get(axis)
        if device is None:
            raise DeviceFault(self.name, "not connected")
        try:
            return getattr(device, call)(*arguments)
        except LOST as error:
            raise DeviceFault(self.name, f"axis {axis}: {error}") from None

    def _axis_moves(self, axis: str) -> bool:
        from libximc.highlevel import MvcmdStatus, StateFlags

        status = self._ask(axis, "get_status")
        if status.Flags & StateFlags.STATE_ALARM:
            raise DeviceFault(self.name, f"axis {axis}: alarm (overheat, overcurrent or a switch)")
        if status.MvCmdSts & MvcmdStatus.MVCMD_ERROR:
            raise DeviceFault(self.name, f"axis {axis}: the move failed")
        return bool(status.MvCmdSts & MvcmdStatus.MVCMD_RUNNING)

    def _set_speed(self, axis: str, speed_mm_s: float) -> None:
        per_mm, microsteps = self._steps_per_mm[axis], self._microsteps[axis]
        steps, micro = divmod(round(speed_mm_s * per_mm * microsteps), microsteps)
        settings = self._ask(axis, "get_move_settings")
        # a speed of 0 would never arrive: the slowest that the controller knows is one microstep/s
        settings.Speed, settings.uSpeed = steps, max(micro, 1 if steps == 0 else 0)
        settings.Accel = settings.Decel = max(round(self._acceleration_mm_s2 * per_mm), 1)
        self._ask(axis, "set_move_settings", settings)

    def _position_mm(self, axis: str) -> float:
        at = self._ask(axis, "get_position")
        steps = at.Position + at.uPosition / self._microsteps[axis]
        return float(steps / self._steps_per_mm[axis] - self._origin_mm[axis])

    def _steps(self, axis: str, scan_mm: float) -> tuple[int, int]:
        microsteps = self._microsteps[axis]
        exact = (scan_mm + self._origin_mm[axis]) * self._steps_per_mm[axis]
        steps, micro = divmod(round(exact * microsteps), microsteps)
        return steps, micro


def open_stage(
    _clock: Clock,
    *,
    x_uri: str | None = None,
    y_uri: str | None = None,
    z_uri: str | None = None,
    steps_per_mm: Positive | tuple[Positive, Positive, Positive] = 400.0,
    origin_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    limits_mm: Limits | None = None,
    max_speed_mm_s: Positive = 10.0,
    acceleration_mm_s2: Positive = 100.0,
    name: str = "standa",
) -> StandaStage:
    """Standa axes at addresses such as ``xi-com:/dev/ttyACM0`` or ``xi-emu:///tmp/x.bin``.

    ``steps_per_mm``: full steps, one number or one per axis (200 steps over a 0.5 mm pitch are
    400). ``origin_mm``: where the scan's (0, 0, 0) lies in the controllers' positions. z up.
    Raises `ConfigError`, `MissingExtra`.
    """
    require_library("standa")
    given = {"x": x_uri, "y": y_uri, "z": z_uri}
    uris = {axis: uri for axis, uri in given.items() if uri is not None}
    if not uris:
        raise ConfigError("x_uri, y_uri or z_uri: name at least one axis")
    per_mm = steps_per_mm if isinstance(steps_per_mm, tuple) else (steps_per_mm,) * 3
    return StandaStage(
        name,
        uris,
        dict(zip(AXES, per_mm, strict=True)),
        dict(zip(AXES, origin_mm, strict=True)),
        limits_mm,
        max_speed_mm_s,
        acceleration_mm_s2,
    )
