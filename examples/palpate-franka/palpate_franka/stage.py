"""Franka arms: set points along a straight line to a Cartesian impedance controller."""

import math
import threading
import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np

from drivers import Clock, DeviceAbsent, DeviceFault, MissingExtra, MotionFault, Pose
from drivers.core.settings import Point, Positive, Settings

PERIOD_S = 0.005
SETTLES_S = 1.0  # how long the tip may stay behind a set point that rests


class FrankaSettings(Settings):
    """``[stage] driver = "franka"``.

    ``origin_mm``: the scan's (0, 0, 0) in the arm's base frame. The tool keeps the orientation that
    it has when the arm is connected. ``arrived_mm``: how far behind a compliant arm may rest.
    """

    name: str = "franka"
    host: str = "172.16.0.2"
    origin_mm: Point = (0.0, 0.0, 0.0)
    max_speed_mm_s: Positive = 50.0
    arrived_mm: Positive = 0.5


class FrankaStage:
    """One arm; ``connect_arm`` gives what has panda-python's methods and a fitting controller."""

    def __init__(self, settings: FrankaSettings, connect_arm: Callable[[str], Any]) -> None:
        self.name = settings.name
        self.simulated = settings.simulated
        self.max_speed_m_s = 1e-3 * settings.max_speed_mm_s
        self._settings = settings
        self._origin_m = 1e-3 * np.array(settings.origin_mm)
        self._connect_arm = connect_arm
        self._arm: Any = None
        self._controller: Any = None
        self._thread: threading.Thread | None = None
        self._end = threading.Event()
        self._way: tuple[np.ndarray, np.ndarray, float, float] | None = (
            None  # from, to, began, took
        )
        self._sent: object = None  # the way whose end is the set point
        self._fault: DeviceFault | None = None

    def connect(self) -> None:
        """Connect and read; the controller starts with the first move."""
        if self._arm is None:
            try:
                self._arm, self._controller = self._connect_arm(self._settings.host)
                self._orientation = np.array(self._arm.get_orientation())
            except (OSError, RuntimeError) as error:
                self._arm = None
                raise DeviceAbsent(self.name, str(error)) from None
            self._fault, self._way = None, None

    def enable(self) -> list[str]:
        """Start the controller at the place where the arm is."""
        arm = self._there()
        if self._thread is None:
            place = np.array(arm.get_position())
            self._controller.set_control(place, self._orientation)
            arm.start_controller(self._controller)
            self._end.clear()
            self._thread = threading.Thread(target=self._follow, name=self.name, daemon=True)
            self._thread.start()
        return ["an impedance controller: under force the tip stays behind its set point"]

    def pose(self) -> Pose:
        """Where the arm says that its tip is."""
        try:
            place = np.array(self._there().get_position()) - self._origin_m
        except (OSError, RuntimeError) as error:
            raise DeviceFault(self.name, str(error)) from None
        return Pose(*map(float, place))

    def move(self, target: Pose, speed_m_s: float) -> None:
        """Set off in a straight line."""
        if not 0 < 1e3 * speed_m_s <= self._settings.max_speed_mm_s:
            raise DeviceFault(self.name, f"speed {1e3 * speed_m_s:g} mm/s is not allowed")
        if any(target[3:]):
            raise DeviceFault(self.name, "this driver does not turn the tool")
        self.enable()
        here = np.array(self.pose()[:3]) + self._origin_m
        there = np.array(target[:3]) + self._origin_m
        self._way = (here, there, time.monotonic(), math.dist(here, there) / speed_m_s)

    def moving(self) -> bool:
        """True until the set point rests and the tip is there."""
        here = np.array(self.pose()[:3]) + self._origin_m
        if (way := self._way) is None:
            return False
        _, target, began_s, took_s = way
        late_s = time.monotonic() - began_s - took_s
        off_mm = 1e3 * math.dist(here, target)
        if self._sent is not way or (off_mm > self._settings.arrived_mm and late_s < SETTLES_S):
            return True
        self._way = None
        if off_mm > self._settings.arrived_mm:
            raise MotionFault(self.name, f"came to rest {off_mm:.2f} mm from its target")
        return False

    def stop(self) -> None:
        """Rest where the set point is now."""
        self._way = None

    def close(self) -> None:
        """Stop and give the arm back."""
        self.stop()
        self._end.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join(timeout=2.0)
        arm, self._arm = self._arm, None
        if arm is not None and thread is not None:
            arm.stop_controller()

    def _there(self) -> Any:
        if self._fault is not None:
            raise self._fault
        if self._arm is None:
            raise DeviceFault(self.name, "not connected")
        return self._arm

    def _follow(self) -> None:
        """Send set points."""
        try:
            while not self._end.wait(PERIOD_S):
                if (way := self._way) is not None:
                    here, target, began_s, took_s = way
                    share = min((time.monotonic() - began_s) / max(took_s, PERIOD_S), 1.0)
                    self._controller.set_control(here + share * (target - here), self._orientation)
                    if share == 1.0:
                        self._sent = way
        except (OSError, RuntimeError) as error:
            self._fault = DeviceFault(self.name, str(error))


def connect_panda(host: str) -> tuple[Any, Any]:
    """The arm at ``host`` and a controller for it, by panda-python."""
    import panda_py
    from panda_py import controllers

    return panda_py.Panda(host), controllers.CartesianImpedance()


def open_stage(_clock: Clock, settings: FrankaSettings) -> FrankaStage:
    """The arm at ``settings.host``, not yet connected."""
    if settings.simulated:
        from palpate_franka.bench import connect_stand_in

        return FrankaStage(settings, connect_stand_in)
    if find_spec("panda_py") is None:
        raise MissingExtra('driver = "franka": pip install "palpate-franka[arm]"')
    return FrankaStage(settings, connect_panda)
