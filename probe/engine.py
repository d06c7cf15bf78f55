"""The scan: travel, tare, approach, indent, hold, retract at every station, told as events.

The same code runs a robot on the wall clock and a phantom on a simulated one. All readings and
all limits are `probe.watch`'s; this file decides what happens next, and nothing else moves the
stage while nothing is wrong.
"""

import math
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

from drivers import Clock, DeviceFault, Pose, Sensor, SimulatedClock, Stage
from probe.control import Control, Wish
from probe.events import (
    Finish,
    Phase,
    PhaseEntered,
    RunEnded,
    RunStarted,
    StationEnded,
    StationStarted,
)
from probe.guards import Limits, Trip
from probe.plan import Place, Plan, pressed
from probe.states import ALLOWED, follow
from probe.tell import Emit, Teller
from probe.watch import STAGE, STAGE_CHANNELS, Watch

TICK_S = 0.005  # the engine's own pace with the wall clock
FINE_S = 0.0005  # its pace around the expected end of a move, so that phases start on time
TELL_S = 0.05  # samples leave in blocks of about this length
ARRIVED_M = 0.1e-3
TOUCH_GAP_M = 0.5e-3  # with touch detection the slow search begins this far above the surface
TOUCH_M_S = 1e-3
TOP_UPS = 8  # moves after the ramp, at most, until a soft rig's tip is deep enough
DEEP_ENOUGH_M = 5e-6
STOPPED = "stopped by the user"


class Interrupted(Exception):
    """The scan cannot simply go on. ``finish`` is None for a pause."""

    def __init__(self, finish: Finish | None, reason: str, device: str, *, retract: bool) -> None:
        super().__init__(reason)
        self.finish = finish
        self.reason = reason
        self.device = device
        self.retract = retract


def run_scan(
    plan: Plan,
    stage: Stage,
    sensors: Sequence[Sensor],
    clock: Clock,
    sink: Emit,
    limits: Limits,
    *,
    control: Control | None = None,
    observers: Sequence[Emit] = (),
    config: Mapping[str, Any] | None = None,
    completed: Collection[int] = (),
    attempts: Mapping[int, int] | None = None,
) -> RunEnded:
    """Run a whole scan and return its last event.

    ``sink`` gets every event; if it raises, the scan retracts and ends as faulted. An observer
    that raises is noted and not called again. A resumed run gives the stations already
    ``completed``, which are skipped, and the ``attempts`` made so far at each station.
    Devices are connected and stopped here, and closed by whoever opened them. A fault of the
    program itself (not of a device) stops the stage and is raised.
    """
    control = control or Control()
    threaded = not isinstance(clock, SimulatedClock)
    watch = Watch(stage, sensors, clock, plan.surface, limits, control, threaded=threaded)
    teller = Teller(clock, sink, observers)
    scan = _Scan(plan, stage, sensors, clock, watch, control, teller)
    return scan.run(config or {}, completed, dict(attempts or {}))


class _Scan:
    """The state of one run: the phase, the station, and what has been said so far."""

    def __init__(
        self,
        plan: Plan,
        stage: Stage,
        sensors: Sequence[Sensor],
        clock: Clock,
        watch: Watch,
        control: Control,
        teller: Teller,
    ) -> None:
        self.plan = plan
        self.stage = stage
        self.sensors = sensors
        self.clock = clock
        self.watch = watch
        self.control = control
        self.teller = teller
        self.phase = Phase.IDLE
        self.leaving = False
        self.heeded: Trip | None = None
        self.station: int | None = None
        self.attempt: int | None = None
        self.told_s = clock.now()
        fastest_hz = max((s.rate_hz for s in sensors), default=1 / TICK_S)
        self.tick_s = TICK_S if watch.threaded else max(2 / fastest_hz, FINE_S)

    # --- the run -----------------------------------------------------------------------------

    def run(
        self, config: Mapping[str, Any], completed: Collection[int], attempts: dict[int, int]
    ) -> RunEnded:
        finish, reason = Finish.COMPLETED, "every station is complete"
        try:
            self._connect(config)
            for place in self.plan.places:
                if place.index not in completed:
                    self._visit(place, attempts)
        except Interrupted as why:
            finish, reason = why.finish or Finish.FAULTED, why.reason
        except BaseException as error:
            self.stage.stop()
            self._end(Finish.FAULTED, f"{type(error).__name__}: {error}")
            raise
        ended = self._end(finish, reason)
        if self.watch.error is not None:
            raise self.watch.error
        return ended

    def _connect(self, config: Mapping[str, Any]) -> None:
        channels = {s.name: s.channels for s in self.sensors}
        channels[STAGE] = tuple(
            replace(channel, simulated=self.stage.simulated) for channel in STAGE_CHANNELS
        )
        utc = datetime.now(UTC).isoformat(timespec="seconds")
        self.teller.tell(RunStarted(self.clock.now(), utc, config, channels))
        self._enter(Phase.CONNECTING)
        try:
            self.stage.connect()
            for sensor in self.sensors:
                sensor.connect()
                sensor.start()
        except DeviceFault as fault:
            raise self._interruption(fault) from fault
        self.watch.start()
        self._heed()

    def _visit(self, place: Place, attempts: dict[int, int]) -> None:
        """Press at one place, again after every pause that broke it off."""
        complete = False
        while not complete:
            attempts[place.index] = attempts.get(place.index, 0) + 1
            self._begin_station(place, attempts[place.index])
            try:
                self._press(place)
                complete = True
            except (Interrupted, DeviceFault) as error:
                why = self._leave(self._interruption(error))
                self._end_station(complete=False)
                if why.finish is not None:
                    raise why from error
            if not complete or self.control.wish is Wish.PAUSE_AFTER_STATION:
                self._pause()

    def _pause(self) -> None:
        """Rest in the air until `Control.resume`; simulated time stands still meanwhile."""
        self._enter(Phase.PAUSED)
        try:
            while self.control.wish is not Wish.GO_ON:
                if self.watch.threaded:
                    self._tick(math.inf)
                else:
                    time.sleep(TICK_S)
                    self._heed()
        except (Interrupted, DeviceFault) as error:
            raise self._leave(self._interruption(error)) from error

    def _leave(self, why: Interrupted) -> Interrupted:
        """Stop, and lift the probe if that is safe; the graver reason if that fails too."""
        level = "fault" if why.finish is Finish.FAULTED else "info"
        self.teller.note(level, why.device, why.reason)
        self.leaving, self.heeded = True, self.watch.trip
        try:
            self._enter(Phase.STOPPING)
            self._halt()
            if why.retract:
                self._enter(Phase.RETRACTING)
                here = self.watch.pose()
                up = here._replace(z=max(here.z, self.plan.travel_z_m))
                self._go(up, self.plan.travel_m_s)
        except (Interrupted, DeviceFault) as error:
            worse = self._interruption(error)
            self.stage.stop()
            if self.phase is Phase.RETRACTING:  # no second try from a standstill that failed
                worse = self._leave(worse)
            return worse if why.finish is not Finish.FAULTED else why
        finally:
            self.leaving = False
        return why

    def _interruption(self, error: Interrupted | DeviceFault) -> Interrupted:
        if isinstance(error, Interrupted):
            return error
        if self.control.wish is Wish.STOP:
            return Interrupted(Finish.ABORTED, STOPPED, "user", retract=False)
        if (trip := self.watch.trip) is not None and trip is not self.heeded:
            return _tripped(trip)
        trusted = error.device != self.stage.name
        return Interrupted(Finish.FAULTED, str(error), error.device, retract=trusted)

    def _end(self, finish: Finish, reason: str) -> RunEnded:
        self.watch.finish()
        for sensor in self.sensors:
            sensor.stop()
        self._tell_samples()
        if Phase.FINISHED not in ALLOWED[self.phase]:
            self._enter(Phase.STOPPING)
        self._enter(Phase.FINISHED)
        if self.teller.sink_error is not None:
            finish, reason = Finish.FAULTED, self.teller.sink_error
        ended = RunEnded(self.clock.now(), finish, reason)
        self.teller.tell(ended)
        if self.teller.sink_error not in (None, reason):  # not even this could be stored
            reason = str(self.teller.sink_error)
            ended = replace(ended, finish=Finish.FAULTED, reason=reason)
        return ended

    def _press(self, place: Place) -> None:
        plan, above, surface = self.plan, self.plan.above(place), self.plan.at_surface(place)
        self._enter(Phase.TRAVELLING)
        here = self.watch.pose()
        if here.z < above.z:
            self._go(here._replace(z=above.z), plan.travel_m_s)
        self._go(above._replace(z=max(here.z, above.z)), plan.travel_m_s)
        self._go(above, plan.travel_m_s)
        self._enter(Phase.TARING)
        self._wait_until(self.clock.now() + plan.settle_s)
        self.watch.tare()
        self._enter(Phase.APPROACHING)
        if plan.touch_n is None:
            self._go(surface, plan.approach_m_s)
        else:
            surface = self._seek(surface, plan.touch_n)
        self._enter(Phase.INDENTING)
        self._indent(surface)
        holding_s = self._enter(Phase.HOLDING)
        self._wait_until(holding_s + plan.hold_s)
        self._enter(Phase.RETRACTING)
        self._go(above, plan.travel_m_s)
        self._end_station(complete=True)

    def _indent(self, surface: Pose) -> None:
        """Go in along the normal, then on by what the rig itself has given way."""
        plan, depth = self.plan, self.plan.indentation_m
        bottom = pressed(surface, depth)
        speed = math.dist(self.watch.pose()[:3], bottom[:3]) / plan.ramp_s
        self._go(bottom, speed)
        for _ in range(TOP_UPS if plan.give_m_n else 0):
            given = min(max(plan.give_m_n * self.watch.force_n(), 0.0), plan.give_m)
            if abs(plan.indentation_m + given - depth) < DEEP_ENOUGH_M:
                break
            depth = plan.indentation_m + given
            self._go(pressed(surface, depth), speed)

    def _seek(self, surface: Pose, touch_n: float) -> Pose:
        """Go down until the force reaches ``touch_n``; where that was."""
        self._go(surface._replace(z=surface.z + TOUCH_GAP_M), self.plan.approach_m_s)
        lowest = surface._replace(z=surface.z - self.plan.search_m)
        if self._go(lowest, TOUCH_M_S, until=lambda: self.watch.force_n() >= touch_n):
            reach_mm = 1e3 * self.plan.search_m
            reason = f"no touch of {touch_n:g} N down to {reach_mm:g} mm below the planned surface"
            raise Interrupted(Finish.FAULTED, reason, "engine", retract=True)
        return surface._replace(z=self.watch.pose().z)

    # --- moving and waiting ------------------------------------------------------------------

    def _go(
        self, target: Pose, speed_m_s: float, *, until: Callable[[], bool] | None = None
    ) -> bool:
        """Move and wait; True if the target was reached, False if ``until`` became true first.

        A stage that takes twice as long as it should plus two seconds, or rests elsewhere than
        told, is at fault. Only a stage that ``turns`` is asked to turn the tool.
        """
        target = self._turned(target)
        length = math.dist(self.watch.pose()[:3], target[:3])
        if length < 1e-9:
            return True
        self.watch.move(target, speed_m_s, retreat=self.leaving)
        began_s = self.clock.now()
        expected_s = began_s + length / speed_m_s
        while self.watch.moving():
            now = self.clock.now()
            if now > expected_s + (expected_s - began_s) + 2.0:
                raise DeviceFault(self.stage.name, f"has not arrived after {now - began_s:.1f} s")
            near = 0 <= now - expected_s < 20 * FINE_S
            self._tick(now + FINE_S if near else max(expected_s, now + FINE_S))
            if until is not None and until():
                self._halt()
                return False
        off = math.dist(self.watch.pose()[:3], target[:3])
        if off > ARRIVED_M:
            raise DeviceFault(self.stage.name, f"came to rest {1e3 * off:.2f} mm from its target")
        return True

    def _turned(self, target: Pose) -> Pose:
        return target if getattr(self.stage, "turns", False) else Pose(*target[:3])

    def _halt(self) -> None:
        """Stop where it is and wait for rest."""
        self.stage.stop()
        limit_s = self.clock.now() + 2.0
        while self.watch.moving():
            if self.clock.now() > limit_s:
                raise DeviceFault(self.stage.name, "does not stop")
            self._tick(self.clock.now() + FINE_S)

    def _wait_until(self, time_s: float) -> None:
        while self.clock.now() < time_s:
            self._tick(time_s)

    def _tick(self, until_s: float) -> None:
        """Let time pass, at most one tick; read, tell, and heed guards and wishes."""
        self.clock.sleep_until(min(self.clock.now() + self.tick_s, until_s))
        if not self.watch.threaded:
            self.watch.step()
        self.watch.engine_lives()
        if self.clock.now() - self.told_s >= TELL_S:
            self._tell_samples()
        self._heed()

    def _heed(self) -> None:
        """Raise `Interrupted` if a guard, the store or the user wants something else."""
        if self.phase is Phase.STOPPING:
            return
        wish, trip = self.control.wish, self.watch.trip
        if wish is Wish.STOP:
            raise Interrupted(Finish.ABORTED, STOPPED, "user", retract=False)
        if trip is not None and trip is not self.heeded:
            raise _tripped(trip)
        if self.leaving:
            return
        if self.teller.sink_error is not None:
            raise Interrupted(Finish.FAULTED, self.teller.sink_error, "store", retract=True)
        if wish is Wish.ABORT:
            raise Interrupted(Finish.ABORTED, "aborted by the user", "user", retract=True)
        if wish is Wish.PAUSE_NOW and self.phase is not Phase.PAUSED:
            raise Interrupted(None, "paused by the user", "user", retract=True)

    # --- what is told ------------------------------------------------------------------------

    def _enter(self, phase: Phase) -> float:
        """Enter a phase; when that was."""
        self.phase = follow(self.phase, phase)
        now = self.clock.now()
        self.teller.tell(PhaseEntered(now, phase, self.station))
        return now

    def _begin_station(self, place: Place, attempt: int) -> None:
        now = self.clock.now()
        self.station, self.attempt = place.index, attempt
        self.watch.retreat = self._turned(self.plan.above(place))
        self.teller.label(now, place.index, attempt)
        self.teller.tell(StationStarted(now, place.index, attempt, place.x_m, place.y_m))

    def _end_station(self, *, complete: bool) -> None:
        """Close the station; it is complete only once every sample of it has been told."""
        assert self.station is not None
        assert self.attempt is not None
        now = self.clock.now()
        self.told_s = math.inf  # hold back: what is read now may still belong to this station
        try:
            while complete and self.watch.seen_s() < now:
                self._tick(math.inf)
        finally:
            self.told_s = now
        self.teller.label(now, None, None)
        self._tell_samples()
        self.teller.tell(StationEnded(now, self.station, self.attempt, complete))
        self.station = self.attempt = None

    def _tell_samples(self) -> None:
        self.told_s = self.clock.now()
        self.teller.samples(self.watch.collect())


def _tripped(trip: Trip) -> Interrupted:
    reason = f"{trip.device}: {trip.reason}"
    return Interrupted(Finish.FAULTED, reason, trip.device, retract=trip.can_retract)
