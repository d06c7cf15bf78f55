"""Three axes of an emulated controller, which together carry the phantom's tip.

Positions count in mm from each axis's reference switch into its travel. z counts downwards: its
switch is above, so that a search for it lifts the probe.
"""

import math
from collections.abc import Callable

from sim_backend.phantom.phantom import Phantom
from sim_backend.phantom.trajectory import Point

AXES = "xyz"
SIGN = {"x": 1.0, "y": 1.0, "z": -1.0}
ORIGIN_MM = {"x": 20.0, "y": 20.0, "z": 40.0}
"""Positions of the scan's (0, 0, 0)."""
TRAVEL_MM = {"x": 100.0, "y": 40.0, "z": 60.0}
HOMING_MM_S = 100.0
STOP_MM_S2 = 1e6
"""A motor that is blocked, or without current."""
IGNORES = {"ignores stop": 1, "ignores stops": 2}
"""Faults, and how many means to stop are then acknowledged and not obeyed."""
HERE_MM = 1e-6
ALONG = 0.8
"""The cosine up to which axes that get their targets one after another count as going on: each has
its own ramps, which one straight way with one speed does not show."""


class Carriage:
    """The axes; what is set off while another axis moves joins it in one straight move.

    A move to a target (m, scan frame) that is not ``ready`` is held until it is.
    """

    def __init__(
        self,
        phantom: Phantom,
        acceleration_mm_s2: float = 500.0,
        ready: Callable[[Point], bool] = lambda _target: True,
        *,
        homed: bool = False,
    ) -> None:
        self.homed = dict.fromkeys(AXES, homed)
        self._phantom = phantom
        self._acceleration_mm_s2 = acceleration_mm_s2
        self.deaf = 0  # so many ways to stop, the mildest first, are acknowledged and not obeyed
        self._ready = ready
        self._held = False
        self._going: dict[str, tuple[float, float]] = {}  # target [mm], speed [mm/s]
        self._searching: set[str] = set()

    def place_mm(self, axis: str) -> float:
        """Where an axis is."""
        at = 1e3 * self._phantom.tip.point(self._now())["xyz".index(axis)]
        return SIGN[axis] * at + ORIGIN_MM[axis]

    def moving(self, axis: str) -> bool:
        """Whether an axis moves, is held, or slows down."""
        self.go_on()
        slowing = not self._going and self._phantom.tip.moving(self._now())
        return axis in self._going or slowing

    def searching(self, axis: str) -> bool:
        """Whether it is on the way to its reference switch."""
        self.go_on()
        return axis in self._searching

    def within(self, axis: str, to_mm: float) -> bool:
        """Whether a position lies in an axis's travel."""
        return -HERE_MM <= to_mm <= TRAVEL_MM[axis] + HERE_MM

    def set_off(self, axis: str, to_mm: float, speed_mm_s: float) -> None:
        """Move one axis."""
        self.go_on()
        if abs(to_mm - self.place_mm(axis)) > HERE_MM:
            self._going[axis] = (to_mm, speed_mm_s)
            self._set_off()

    def home(self, axis: str) -> None:
        """Search an axis's reference switch; it is then known where the axis is."""
        self.homed[axis] = False
        self.set_off(axis, 0.0, HOMING_MM_S)
        self._searching.add(axis)
        self.go_on()

    def stop(self, axis: str, acceleration_mm_s2: float | None = None) -> None:
        """An order to stop: slow down, or at once, unless it is `deaf` to that."""
        if self.deaf < (1 if acceleration_mm_s2 is None else 2):
            self.halt(axis, acceleration_mm_s2)

    def halt(self, axis: str, acceleration_mm_s2: float | None = None) -> None:
        """Slow one axis down, others go on."""
        self.go_on()
        self._searching.discard(axis)
        if self._going.pop(axis, None) is None:
            return
        self._phantom.tip.halt(self._now(), 1e-3 * (acceleration_mm_s2 or self._acceleration_mm_s2))
        if self._going:
            self._set_off()

    def block(self) -> None:
        """All motors stop at once, where they are."""
        for axis in AXES:
            self.halt(axis, STOP_MM_S2)

    def forget(self) -> None:
        """The power was off for a moment."""
        self.block()
        self.homed = dict.fromkeys(AXES, False)

    def go_on(self) -> None:
        """Take note of what has ended; set off what was held."""
        if self._held:
            self._set_off()
        if self._held or self._phantom.tip.moving(self._now()):
            return
        for axis in self._searching & set(AXES):
            self.homed[axis] = True
        self._searching.clear()
        self._going.clear()

    def _set_off(self) -> None:
        x, y, z = (1e-3 * self._scan_mm(axis) for axis in AXES)
        self._held = not self._ready((x, y, z))
        if self._held:
            return
        speed_m_s = 1e-3 * math.hypot(*(speed for _, speed in self._going.values()))
        lead = self._phantom.tip.extend if self._aligned((x, y, z)) else self._phantom.tip.move
        lead(self._now(), (x, y, z), speed_m_s, 1e-3 * self._acceleration_mm_s2)

    def _aligned(self, target: Point) -> bool:
        """Whether a target that is set in motion leads on, without a stop."""
        here, going = self._phantom.tip.point(self._now()), self._phantom.tip.velocity(self._now())
        way = [t - h for h, t in zip(here, target, strict=True)]
        product = math.hypot(*way) * math.hypot(*going)
        return product > 0 and sum(w * v for w, v in zip(way, going, strict=True)) > ALONG * product

    def _scan_mm(self, axis: str) -> float:
        """Where it goes, or stays, in the scan frame."""
        to_mm, _ = self._going.get(axis, (self.place_mm(axis), 0.0))
        return SIGN[axis] * (to_mm - ORIGIN_MM[axis])

    def _now(self) -> float:
        return self._phantom.clock.now()
