"""How a scan moves, waits and publishes: time passes only here, and every tick obeys the guards.

`probe.scan.engine` says in which order; nothing here knows what a station is made of.
"""

import math
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from drivers import Clock, DeviceFault, MotionFault, Pose
from probe.core.events import (
    Finish,
    Phase,
    PhaseEntered,
    StationEnded,
    StationStarted,
)
from probe.core.states import PRESSING, follow
from probe.guards.commands import Control
from probe.guards.interface import Guards, Status
from probe.guards.interruption import Interrupted
from probe.guards.levels import Levels, Usual
from probe.guards.pose_guard import SLOWEST_PACE
from probe.guards.press_guard import WAY_M
from probe.guards.readings import PUBLISH_S
from probe.guards.safety_monitor import STAGE_PERIOD_S
from probe.guards.stopping import STOP_AGAIN_S
from probe.planning.limits import ARRIVED_M, Limits
from probe.planning.plan import Place, Plan
from probe.scan.event_bus import EventBus
from probe.scan.readiness import turned
from probe.scan.sensor_rates import SensorRates
from probe.scan.stop_rules import Seen, interrupted

TICK_S = 0.005  # the engine's own pace with the wall clock
FINE_S = 0.0005  # its pace around the expected end of a way down, so that a hold starts on time
SIMULATED_PUBLISH_S = 0.25  # which passes in some 10 ms
MAX_JUMPS = 3  # of a clock, in one press
FULL_PACE = 0.995  # pendants show whole per cents
PACE_AGAIN_S = 1.0  # a slider that is being moved is noted no more often


class RunLoop:
    """The state of one run: the phase, the station, and what has been published so far."""

    def __init__(
        self,
        plan: Plan,
        clock: Clock,
        limits: Limits,
        guards: Guards,
        control: Control,
        bus: EventBus,
    ) -> None:
        self.plan = plan
        self.stage, self.sensors = guards.facts.stage, guards.facts.sensors
        self.clock = clock
        self.monitor = guards
        self.status = Status(None, None, -math.inf, 0.0)  # as of the last `look`
        self.control = control
        self.bus = bus
        self.phase = Phase.IDLE
        self.leaving = False
        self.guarded = False  # the monitor has begun, and can lift the probe
        self.known_levels: Levels | None = None
        self.zero_unseen = False  # since the last complete press
        self.usual = Usual()
        self.rates = SensorRates(self.sensors)
        self.limits = limits
        self.most_n = limits.max_force_n
        self.top_m = limits.workspace_m[2][1]
        self.in_the_air = limits.in_the_air
        self.noted_little = False
        self.jumps = 0
        self._jumped: tuple[str, float] | None = None
        self._pace: float | None = None  # as last noted
        self._paced_s = -math.inf
        self.station: int | None = None
        self.attempt: int | None = None
        self.last_published_s = clock.now()
        fastest_hz = max((s.rate_hz for s in self.sensors), default=1 / TICK_S)
        self.tick_s = TICK_S if guards.threaded else max(2 / fastest_hz, FINE_S)
        self.publish_s = PUBLISH_S if guards.threaded else SIMULATED_PUBLISH_S
        self.rest_s = TICK_S if guards.threaded else max(self.tick_s, STAGE_PERIOD_S)

    def go(
        self,
        target: Pose,
        speed_m_s: float,
        *,
        until: Callable[[], bool] | None = None,
        search: bool = False,
    ) -> bool:
        """Move and wait; True if the target was reached, False if ``until`` became true first, or
        the stage itself ended a ``search`` at a contact.

        A stage that takes twice as long as it should plus two seconds, or rests elsewhere than
        commanded, is at fault. Only a stage that ``turns`` is asked to turn the tool.

        On the way down the guards look most often, and its end is met to `FINE_S`.
        """
        target = turned(target, turns=self.stage.turns)
        start = self.monitor.pose()
        length = math.dist(start[:3], target[:3])
        if length < 1e-9:
            return True
        down = start.z - target.z > WAY_M
        step_s, fine_s = (self.tick_s, FINE_S) if down else (self.rest_s, self.rest_s / 4)
        self.monitor.move(target, speed_m_s, search=search)
        began_s = self.clock.now()
        expected_s, slowest = began_s + length / speed_m_s, 1.0
        while self.monitor.moving():
            now = self.clock.now()
            slowest = min(slowest, max(self._watch_pace(now), SLOWEST_PACE))
            if now > began_s + 2 * (expected_s - began_s) / slowest + 2.0:
                raise MotionFault(self.stage.name, f"has not arrived after {now - began_s:.1f} s")
            ends = now - expected_s < 20 * fine_s
            self._look_at(min(now + step_s, max(expected_s, now + fine_s) if ends else math.inf))
            if until is not None and until():
                self.halt()
                return False
        here = self.monitor.pose()
        off = math.dist(here[:3], target[:3])
        touched = search and self.monitor.touched_n(began_s) is not None
        if off > ARRIVED_M and not touched:
            raise MotionFault(self.stage.name, f"came to rest {1e3 * off:.2f} mm from its target")
        self.monitor.arrived(here if touched else target)
        return not touched

    def _watch_pace(self, now: float) -> float:
        """The share of a commanded speed that the stage allows; a change of it is a note at once.
        What held when it was made ready is told by `Stage.enable`."""
        pace = self.status.pace
        if self._pace is None:
            self._pace = pace
        if abs(pace - self._pace) > 1 - FULL_PACE and now - self._paced_s >= PACE_AGAIN_S:
            words = (
                f"allows {100 * pace:.0f} % of a commanded speed, after {100 * self._pace:.0f} %"
            )
            self.bus.note("warning", self.stage.name, words)
            self._pace, self._paced_s = pace, now
        return pace

    def halt(self) -> None:
        """Stop where it is and wait for rest; repeated until it rests."""
        limit_s = self.clock.now() + 2.0
        self.monitor.stop()
        while self.monitor.moving():
            if self.clock.now() > limit_s:
                raise DeviceFault(self.stage.name, "does not stop")
            self.tick(self.clock.now() + STOP_AGAIN_S)
            self.monitor.stop()
        self.monitor.arrived(self.monitor.pose())

    def wait_until(self, time_s: float) -> None:
        """At rest, where a force changes as slowly as a lumen beats."""
        while (now := self.clock.now()) < time_s:
            self._look_at(min(now + self.rest_s, time_s))

    def wait_for(self, answer: Future[Any], until_s: float = math.inf) -> bool:
        """At rest, while a planner thinks; whether it has answered."""
        while not answer.done() and (now := self.clock.now()) < until_s:
            self._look_at(min(now + self.rest_s, until_s))
        return answer.done()

    def tick(self, until_s: float) -> None:
        """Let time pass, at most one tick; read, publish, and obey guards and commands."""
        self._look_at(min(self.clock.now() + self.tick_s, until_s))

    def _look_at(self, time_s: float) -> None:
        self.clock.sleep_until(time_s)
        self.look()
        if self.clock.now() - self.last_published_s >= self.publish_s:
            self.publish_samples()
        self.handle()

    def look(self) -> Status:
        """The engine lives; how things stand."""
        self.status = self.monitor.look()
        self._jumped = self._jumped or self.status.jumped
        return self.status

    def handle(self) -> None:
        """Raise `Interrupted` if a guard, the store or the user wants something else."""
        if self.leaving:
            return
        seen = Seen(self.control.command, self.status.trip, self.bus.sink_error, self.phase)
        if (why := interrupted(seen)) is not None:
            raise why
        if self._jumped is not None:
            self._handle_jump(*self._jumped)

    def _handle_jump(self, device: str, jumped_s: float) -> None:
        """Samples near a device's clock that stood still have wrong times: press again."""
        self._jumped = None
        reason = f"{device}: its clock stood still for {1e3 * jumped_s:.0f} ms"
        if self.phase not in PRESSING:
            self.bus.note("info", device, reason)
            return
        self.jumps += 1
        if self.jumps > MAX_JUMPS:
            reason = f"{reason}, again and again; see to the controller's load"
            raise Interrupted(Finish.FAULTED, reason, device, retract=True)
        raise Interrupted(None, f"{reason}; the press is repeated", device, retract=True)

    def enter(self, phase: Phase) -> float:
        """Enter a phase; when that was."""
        self.phase = follow(self.phase, phase)
        now = self.clock.now()
        self.bus.publish(PhaseEntered(now, phase, self.station))
        return now

    def begin_station(self, place: Place, attempt: int) -> None:
        now = self.clock.now()
        self.station, self.attempt = place.index, attempt
        self.bus.label(now, place.index, attempt)
        self.bus.publish(StationStarted(now, place.index, attempt, place.x_m, place.y_m))

    def end_station(self, *, complete: bool) -> None:
        """Close the station; it is complete only once every sample of it has been published."""
        assert self.station is not None
        assert self.attempt is not None
        now = self.clock.now()
        self.last_published_s = (
            math.inf
        )  # hold back: what is read now may still belong to this station
        try:
            while complete and self.status.seen_s < now:
                self.tick(math.inf)
        finally:
            self.last_published_s = now
        self.bus.label(now, None, None)
        self.publish_samples()
        self.bus.publish(StationEnded(now, self.station, self.attempt, complete))
        self.station = self.attempt = None
        for sensor, slow in self.rates.slow() if complete else ():
            self.bus.note("warning", sensor, slow)

    def publish_samples(self) -> None:
        self.last_published_s = self.clock.now()
        readings = self.monitor.collect()
        self.rates.add(readings)
        self.bus.samples(readings)
