"""The truth: a tip on three axes that follows a trapezoidal speed, and the soft bed it presses.

Stepped in slices of a millisecond at most. Nothing here is shared with the phantom: the bed is a
spring that hardens, an arm that relaxes (a standard linear solid) and a skin that sticks.
"""

import math
from dataclasses import dataclass, field

SLICE_S = 1e-3
TAU_S = 0.3  # relaxation of the bed's second arm
HARDENING_PER_M = 60.0  # 15 % stiffer at 2.5 mm
PULSE_N, PULSE_HZ = 4e-3, 1.2
SLOWEST_M_S = 1e-5

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Bed:
    """What lies under the probe. Stiffnesses [N/m], lengths [m]; ``hard_from_m`` on along x.

    From there the bed is ``hard`` times as stiff and its surface ``step_m`` higher. The probe
    sticks to the skin: ``shear_n_m`` resists every way sideways.
    """

    stiffness_n_m: float = 400.0
    relaxing_n_m: float = 80.0
    shear_n_m: float = 1500.0
    hard_from_m: float = math.inf
    hard: float = 1.0
    step_m: float = 0.0

    def factor(self, x_m: float) -> float:
        """How many times stiffer it is at x."""
        return self.hard if x_m >= self.hard_from_m else 1.0

    def surface_m(self, x_m: float) -> float:
        """Its height at x."""
        return self.step_m if x_m >= self.hard_from_m else 0.0


@dataclass
class World:
    """The tip and what it feels at ``time_s``; `advance` lets time pass, the rest happens at once.

    ``lift_m`` and its rate move the whole bed up and down again (a patient who coughs);
    ``slip_m_s`` moves the tip with nobody's command; ``force_n`` is the normal force,
    ``side_n`` what the skin resists.
    """

    bed: Bed
    time_s: float
    place: Point
    acceleration_m_s2: float = 1.0
    stalled: bool = False
    slip_m_s: Point = (0.0, 0.0, 0.0)
    slip_until_s: float = -math.inf
    lift_m: float = 0.0
    lift_m_s: float = 0.0
    lift_until_s: float = -math.inf
    force_n: float = 0.0
    side_n: float = 0.0
    speed_m_s: float = 0.0
    rows: list[tuple[float, ...]] = field(default_factory=list)
    _target: Point | None = None
    _cruise_m_s: float = 0.0
    _halting: bool = False
    _arm_n: float = 0.0
    _depth_m: float = 0.0
    _anchor: tuple[float, float] | None = None

    @property
    def moving(self) -> bool:
        """True while a commanded move lasts."""
        return self._target is not None

    @property
    def depth_m(self) -> float:
        """Below the surface as it truly lies; negative in the air."""
        return self.bed.surface_m(self.place[0]) + self.lift_m - self.place[2]

    def move(self, target: Point, speed_m_s: float) -> None:
        """Set off; whatever moved before is forgotten."""
        self._target, self._cruise_m_s, self._halting = target, speed_m_s, False

    def halt(self) -> None:
        """Slow down to rest."""
        self._halting = self._target is not None

    def advance(self, to_s: float) -> None:
        """Let time pass, and write down the truth of each slice."""
        while (left_s := to_s - self.time_s) > 1e-9:
            step_s = min(left_s, SLICE_S)
            self.time_s += step_s
            self._travel(step_s)
            self._slip(step_s)
            self._press(step_s)
            self.rows.append(
                (self.time_s, *self.place, self.force_n, self.side_n, self.depth_m, self.moving)
            )

    def _travel(self, step_s: float) -> None:
        if self._target is None or self.stalled:
            self.speed_m_s = 0.0
            return
        way = math.dist(self.place, self._target)
        change = self.acceleration_m_s2 * step_s
        if self._halting:
            self.speed_m_s -= change
        else:
            arriving = math.sqrt(2 * self.acceleration_m_s2 * way)
            self.speed_m_s = min(self.speed_m_s + change, self._cruise_m_s, arriving)
        if self.speed_m_s <= 0 or way <= max(self.speed_m_s, SLOWEST_M_S) * step_s:
            self.place = self.place if self._halting else self._target
            self._target, self.speed_m_s, self._halting = None, 0.0, False
            return
        share = self.speed_m_s * step_s / way
        x, y, z = (a + share * (b - a) for a, b in zip(self.place, self._target, strict=True))
        self.place = (x, y, z)

    def _slip(self, step_s: float) -> None:
        if self.time_s < self.slip_until_s:
            x, y, z = (a + v * step_s for a, v in zip(self.place, self.slip_m_s, strict=True))
            self.place = (x, y, z)
        rising = self.time_s < self.lift_until_s
        self.lift_m = max(self.lift_m + (1 if rising else -1) * self.lift_m_s * step_s, 0.0)

    def _press(self, step_s: float) -> None:
        depth, before = max(self.depth_m, 0.0), self._depth_m
        self._depth_m = depth
        if depth == 0.0:
            self._arm_n, self._anchor, self.force_n, self.side_n = 0.0, None, 0.0, 0.0
            return
        x, y, _ = self.place
        factor = self.bed.factor(x)
        self._arm_n += factor * self.bed.relaxing_n_m * (depth - before)
        self._arm_n *= math.exp(-step_s / TAU_S)
        spring = factor * self.bed.stiffness_n_m * depth * (1 + HARDENING_PER_M * depth)
        pulse = PULSE_N * (0.5 - 0.5 * math.cos(2 * math.pi * PULSE_HZ * self.time_s))
        self.force_n = max(spring + self._arm_n, 0.0) + pulse
        if self._anchor is None:
            self._anchor = (x, y)
        self.side_n = self.bed.shear_n_m * math.dist((x, y), self._anchor)
