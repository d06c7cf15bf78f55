"""The stage, to one call at a time: it is moved until somebody objects, then stopped and lifted."""

import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

from drivers import Clock, DeviceFault, Pose, Sensor, Stage
from drivers.core import abilities
from probe.guards.force_limit import SensorGuard
from probe.guards.interruption import Trip
from probe.guards.pose_guard import PoseGuard, StandStill
from probe.guards.press_guard import WAY_M
from probe.guards.presses import Presses
from probe.guards.retreat import Retreat, lift_speed_m_s
from probe.planning.limits import Limits
from probe.planning.surfaces import Surface

LOCK_S = 0.25  # the second stop waits so long for an order; a way out stops again
RETREATS = 3  # of one run, at most, where something moves the stage again after each
Answer = TypeVar("Answer")


class GuardedStage:
    """Orders to a stage, what is expected of each, and the way out after the first objection.

    ``trip`` is that objection; from then on `move` refuses, and a `Retreat` brings the stage to
    rest and lifts it to ``lift_z_m`` (None: only to rest). ``error`` is a mistake in the program.
    """

    def __init__(
        self,
        stage: Stage,
        sensors: Sequence[tuple[Sensor, SensorGuard]],
        clock: Clock,
        surface: Surface,
        limits: Limits,
        lift_z_m: float | None,
    ) -> None:
        self.trip: Trip | None = None
        self.error: BaseException | None = None
        self.retreat: Retreat | None = None
        self._stage = stage
        self._sensors = sensors
        self._clock = clock
        self._surface = surface
        self._limits = limits
        self._lift_z_m = lift_z_m
        self._presses = Presses(sensors, surface, limits)
        self._pose_guard = PoseGuard(surface, limits)
        self._stand_still = StandStill()
        self._in_motion = False
        self._down_m_s = 0.0  # of the move under way, if it goes down
        self._retreats = 0
        self._stage_lock = threading.Lock()
        self._trip_lock = threading.Lock()

    def force_n(self) -> float:
        """The latest force of the first sensor that feels one."""
        return next((g.force_n for _, g in self._sensors if g.feels), 0.0)

    def move(self, target: Pose, speed_m_s: float, *, search: bool = False) -> None:
        """`abilities.move`, unless a guard has stopped the scan. Raises `DeviceFault`."""

        def go() -> None:
            self._refuse_after_a_trip()
            self._start(target, speed_m_s, search)

        self._alone(go)

    def _refuse_after_a_trip(self) -> None:
        if self.trip is not None:
            raise DeviceFault(self.trip.device, self.trip.reason)

    def stop(self) -> None:
        """Stop the stage now."""
        self._stage.stop()

    def arrived(self, pose: Pose) -> None:
        """The move is over: from now on the tip rests at ``pose``."""
        self._in_motion = False
        self._stand_still.end()
        self._pose_guard.expect_rest(pose)
        self._presses.end()

    def moving(self) -> bool:
        """True while the stage moves. Raises `DeviceFault`."""
        return self._alone(self._stage.moving)

    def pose(self) -> Pose:
        """The stage's pose. Raises `DeviceFault`."""
        return self._alone(self._stage.pose)

    def go_on(self) -> None:
        """After a pause: there is nothing to get away from any more."""
        if self.trip is None:
            self.retreat = None

    def object(self, device: str, reason: str, *, can_retract: bool, again: bool = False) -> None:
        """Stop the stage and begin the way out.

        Stopped twice: a move that was being started is caught by the second. ``again``: what is
        objected to is dangerous also after a way out that is done.
        """
        with self._trip_lock:
            if self.trip is None:
                self.trip = Trip(self._clock.now(), device, reason, can_retract)
            elif not again or self._retreats >= RETREATS:
                return
            if self.retreat is not None and not self.retreat.done:
                return  # it looks after itself
            self._begin_retreat(lift=can_retract and self.trip.can_retract)
        self._stage.stop()
        if self._stage_lock.acquire(timeout=LOCK_S):
            self._stage.stop()
            self._stage_lock.release()

    def _begin_retreat(self, *, lift: bool) -> None:
        self._retreats += 1
        self.retreat = Retreat(
            abilities.stop_means(self._stage),
            partial(self._alone, partial(abilities.start_again, self._stage)),
            self.moving,
            self._start_held,
            self.force_n,
            self._lift_z_m if lift else None,
            lift_speed_m_s(self._stage, self._limits),
            self._clock.now(),
            self._limits.max_force_n,
            self._down_m_s > 0,
        )

    def _start_held(self, target: Pose, speed_m_s: float) -> None:
        self._alone(partial(self._start, target, speed_m_s))

    def _start(self, target: Pose, speed_m_s: float, search: bool = False) -> None:
        here = self._stage.pose()
        goes_back = search and abilities.finds_contact(self._stage)
        self._pose_guard.expect(here, target, may_go_back=goes_back)
        self._presses.begin(here, target, speed_m_s, search=search)
        lowest_m = here.z if self._lift_z_m is None else min(here.z, self._lift_z_m)
        self._down_m_s = speed_m_s if target.z < lowest_m - WAY_M else 0.0
        self._in_motion = True
        self._stand_still.begin(target, speed_m_s)
        abilities.move(self._stage, target, speed_m_s, search=search)

    def _alone(self, ask: Callable[[], Answer]) -> Answer:
        """What ``ask`` returns, the stage to itself. Raises `DeviceFault` if another call hangs."""
        if not self._stage_lock.acquire(timeout=2 * self._limits.silence_s):
            raise DeviceFault(self._stage.name, "does not answer")
        try:
            return ask()
        finally:
            self._stage_lock.release()
