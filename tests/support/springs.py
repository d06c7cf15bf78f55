"""A stage and a sensor over a bed of springs that share nothing with the phantom.

The truth is the tip's own path, asked for afterwards at every millisecond: what the sensor said
and what the stage reported do not enter.
"""

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from waiting import first_of_all

from drivers import (
    Block,
    Channel,
    Clock,
    DeviceFault,
    Pose,
    Sensor,
    SimulatedClock,
    Stage,
    WallClock,
)
from drivers.core.arrays import Array
from probe.config.rig import Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.core.events import Event, Finish, Note, RunEnded, StationEnded
from probe.guards.commands import Control
from probe.guards.safety_monitor import SafetyMonitor
from probe.planning.limits import Limits
from probe.planning.surfaces import flat
from probe.scan.engine import run_scan
from sim_backend.phantom.trajectory import Trajectory

HARD_N_M, SOFT_N_M = 12e3, 400.0
LIMIT_N = 1.6


class Bed:
    """Springs of ``stiffness_n_m`` up to ``surface_m``, and the tip over them."""

    def __init__(
        self, clock: Clock, stiffness_n_m: float = SOFT_N_M, surface_m: float = 0.0,
        home: tuple[float, float, float] = (0.0, 0.0, 5e-3),
    ) -> None:  # fmt: skip
        self.clock, self.stiffness_n_m, self.surface_m = clock, stiffness_n_m, surface_m
        self.tip = Trajectory(home, clock.now())

    def force_n(self, time_s: float) -> float:
        """True force."""
        return self.stiffness_n_m * max(self.surface_m - self.tip.point(time_s)[2], 0.0)

    def truth(self) -> tuple[Array, Array]:
        """True height [m] and force [N] at every millisecond until now."""
        z = np.array([self.tip.point(t)[2] for t in np.arange(0.0, self.clock.now(), 1e-3)])
        return z, self.stiffness_n_m * np.maximum(self.surface_m - z, 0.0)


class SpringStage:
    """Moves the bed's tip; every order is kept with its time."""

    name, simulated = "stage of springs", True
    acceleration = 1.0

    def __init__(self, bed: Bed) -> None:
        self.bed = bed
        self.orders: list[tuple[float, str]] = []

    def connect(self) -> None: ...

    def pose(self) -> Pose:
        return Pose(*self.bed.tip.point(self.bed.clock.now()))

    def move(self, target: Pose, speed_m_s: float) -> None:
        if self.moving():
            raise DeviceFault(self.name, "still moving; wait or stop before the next move")
        self.orders.append((self.bed.clock.now(), "move"))
        self.bed.tip.move(self.bed.clock.now(), target[:3], speed_m_s, self.acceleration)

    def moving(self) -> bool:
        return self.bed.tip.moving(self.bed.clock.now())

    def stop(self) -> None:
        self.orders.append((self.bed.clock.now(), "stop"))
        self.bed.tip.halt(self.bed.clock.now(), self.acceleration)

    def close(self) -> None:
        self.bed.tip.halt(self.bed.clock.now(), self.acceleration)


Says = Callable[[float, float, float], float]
"""What a sensor says of the true force [N], of a noise of 0.5 mN and of the time [s]."""


def as_it_is(force_n: float, noise_n: float, _time_s: float) -> float:
    return force_n + noise_n


def clipped(at_n: float) -> Says:
    """Far below its full scale and without a word; its amplifier adds the noise afterwards."""
    return lambda force_n, noise_n, _time_s: min(force_n, at_n) + noise_n


class SpringSensor:
    """Feels the bed and ``says`` so; a tare is the mean of 50 readings."""

    def __init__(
        self, bed: Bed, name: str = "cell", role: str = "force", unit: str = "N", seed: int = 0,
        *, says: Says = as_it_is, rate_hz: float = 500.0,
    ) -> None:  # fmt: skip
        self.bed, self.name, self.says, self.rate_hz = bed, name, says, rate_hz
        self.channels = (Channel("force", unit, role, simulated=True),)
        self._rng = np.random.default_rng(seed)
        self._lock = threading.Lock()
        self._zero, self._recent = 0.0, [0.0]
        self._next, self._start_s = 1, bed.clock.now()

    def raw(self, time_s: float) -> float:
        """One reading before the tare."""
        noise_n = 0.5e-3 * float(self._rng.standard_normal())
        return self.says(self.bed.force_n(time_s), noise_n, time_s)

    def connect(self) -> None: ...

    def start(self) -> None:
        self._next, self._start_s = 1, self.bed.clock.now()

    def read(self) -> Block:
        with self._lock:
            due = math.floor((self.bed.clock.now() - self._start_s) * self.rate_hz + 1e-6)
            time_s = self._start_s + np.arange(self._next, max(due + 1, self._next)) / self.rate_hz
            self._next = max(due + 1, self._next)
            raw = [self.raw(float(t)) for t in time_s]
            self._recent = [*self._recent, *raw][-50:]
            return self.block(time_s, np.array(raw) - self._zero)

    def block(self, time_s: Any, force: Any) -> Block:
        """What is handed out."""
        values = np.asarray(force, float).reshape(len(time_s), len(self.channels))
        return Block(time_s, values, np.zeros(values.shape, bool))

    def tare(self) -> None:
        with self._lock:
            self._zero = float(np.mean(self._recent))

    def stop(self) -> None: ...
    def close(self) -> None: ...


def spring_rig(**tables: dict[str, Any]) -> Rig:
    """One press 2.5 mm deep in 1 s at a limit of 1.6 N, unless ``tables`` say otherwise."""
    base: dict[str, dict[str, Any]] = {
        "scan": {"start_mm": 0.0, "stations": 1, "hold_s": 0.3},
        "safety": {"max_force_n": LIMIT_N, "max_depth_mm": 3.0, "hardest_n_mm": 1.0},
    }
    for name, table in tables.items():
        base[name] = base.get(name, {}) | table
    return Rig.model_validate(base)


# On a loaded machine a thread may be scheduled late: what is stiff is met slowly.
SLOW = spring_rig(scan={"approach_mm_s": 2.0, "ramp_s": 2.5}, safety={"hardest_n_mm": 12.0})


@dataclass
class Ran:
    """How a scan went: its events, its end (None: it hung), what was raised, and the truth."""

    events: list[Event] = field(default_factory=list)
    ended: RunEnded | None = None
    raised: BaseException | None = None
    height_m: Array = field(default_factory=lambda: np.empty(0))
    force_n: Array = field(default_factory=lambda: np.empty(0))

    @property
    def finish(self) -> Finish | None:
        return None if self.ended is None else self.ended.finish

    @property
    def reason(self) -> str:
        return "" if self.ended is None else self.ended.reason

    @property
    def lifted(self) -> bool:
        """The tip is off the springs at the end."""
        return bool(self.force_n[-1] == 0.0)

    @property
    def complete(self) -> list[int]:
        """The stations that are called complete."""
        return [e.station for e in self.events if isinstance(e, StationEnded) and e.complete]

    @property
    def notes(self) -> list[str]:
        return [e.text for e in self.events if isinstance(e, Note)]


def run_springs(
    bed: Bed,
    stage: Stage,
    sensors: Sequence[Sensor],
    *,
    rig: Rig | None = None,
    observers: Sequence[Callable[[Event], None]] = (),
    sink: Callable[[Event], None] = lambda _event: None,
    control: Control | None = None,
    timeout_s: float = 20.0,
) -> Ran:
    """A scan in a thread of its own, so that one that hangs is seen after ``timeout_s``."""
    rig, ran = rig or spring_rig(), Ran()
    plan = plan_for(rig)

    def store(event: Event) -> None:
        ran.events.append(event)
        sink(event)

    def scan() -> None:
        try:
            ran.ended = run_scan(
                plan, stage, sensors, bed.clock, store, limits_for(rig, plan),
                observers=observers, control=control,
            )  # fmt: skip
        except BaseException as error:  # noqa: BLE001 - whatever it is, the test looks at it
            ran.raised = error

    thread = threading.Thread(target=scan, daemon=True)
    with first_of_all():  # guards do, and wait for the interpreter while this thread has it
        thread.start()
    thread.join(timeout_s)
    ran.height_m, ran.force_n = bed.truth()
    return ran


def monitor_of(
    stage: SpringStage, sensor: Sensor, *, threaded: bool = False, lift_z_m: float | None = None,
    limits: Limits | None = None,
) -> SafetyMonitor:  # fmt: skip
    """Guards that have not begun, of the rig above."""
    rig = spring_rig()
    return SafetyMonitor(
        stage, [sensor], stage.bed.clock, flat, limits or limits_for(rig, plan_for(rig)),
        Control(), threaded=threaded, lift_z_m=lift_z_m,
    )  # fmt: skip


def on_springs(clock: Clock | None = None, **bed: Any) -> tuple[Bed, SpringStage, SpringSensor]:
    """A bed with its stage and sensor, on the wall clock unless there is another ``clock``."""
    made = Bed(clock or WallClock(), **bed)
    return made, SpringStage(made), SpringSensor(made)


def on_simulated_springs(**bed: Any) -> tuple[Bed, SpringStage, SpringSensor]:
    """As `on_springs`, in simulated time: what guards think of a force, and not how soon."""
    return on_springs(SimulatedClock(), **bed)
