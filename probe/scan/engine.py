"""The scan: travel, tare, approach, indent, hold, retract at every station, published as events.

The same code runs a robot on the wall clock and a phantom on a simulated one. All readings and
all limits are the safety monitor's; this file decides what happens next, and nothing else moves
the stage while nothing is wrong.
"""

import math
import time
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

from drivers import Clock, DeviceFault, Sensor, Stage
from probe.core.events import Event, Finish, Phase, RunEnded, RunStarted
from probe.core.states import ALLOWED
from probe.guards.commands import STOPPED, Control, RunCommand
from probe.guards.interface import Guards, WayOut
from probe.guards.interruption import Interrupted, interruption_of
from probe.guards.levels import LEVEL_S, little
from probe.guards.prepare import monitor_for
from probe.guards.readings import STAGE, STAGE_CHANNELS
from probe.guards.retreat import UP_M
from probe.guards.stopping import STOP_AGAIN_S
from probe.planning.limits import Limits
from probe.planning.plan import Plan
from probe.planning.planner import Done, Planner, Press, Raster
from probe.scan.choosing import Chooser
from probe.scan.event_bus import EventBus, EventSink
from probe.scan.holding import hold
from probe.scan.indenting import note_the_ramp
from probe.scan.lifting import begin_lift
from probe.scan.readiness import planned_poses
from probe.scan.run_loop import FINE_S, TICK_S, RunLoop
from probe.scan.steps import press_in
from probe.scan.stop_rules import ABORTED, no_contact
from probe.scan.taring import note_last_drift, note_unseen, take_zero
from probe.scan.touching import find_surface

HOME_STOPS_S = 5.0
GIVE_UP_S = 30.0  # for a way out; the retreat itself is done long before, unless the stage hangs
NOT_LIFTED = "the probe was not lifted"
BY_HAND = "take its load off by hand or at the stage's own panel, before anything else moves it"
"""What is left to a person where the program cannot lift the probe."""


def run_scan(
    plan: Plan,
    stage: Stage,
    sensors: Sequence[Sensor],
    clock: Clock,
    sink: EventSink,
    limits: Limits,
    *,
    control: Control | None = None,
    observers: Sequence[EventSink] = (),
    config: Mapping[str, Any] | None = None,
    planner: Planner | None = None,
    completed: Collection[int] = (),
    attempts: Mapping[int, int] | None = None,
) -> RunEnded:
    """Run a whole scan on devices that are already open.

    Parameters
    ----------
    plan
        Where to press, and how.
    stage
        What moves. Devices are connected and stopped here, and closed by whoever opened
        them.
    sensors
        What feels.
    clock
        What times are taken on.
    sink
        Gets every event; if it raises, the scan retracts and ends as faulted.
    limits
        What must never be exceeded.
    control
        Passes pause, resume, abort and stop from another thread.
    observers
        Get every event, too; one that raises is noted and not called again.
    config
        Everything the run depends on, kept in its first event.
    planner
        What chooses among the stations of the plan; by default each is pressed in turn.
    completed
        Stations of a resumed run that are skipped.
    attempts
        Attempts made so far at each station of a resumed run.

    Returns
    -------
    RunEnded
        The last event. A fault of the program itself, not of a device, stops the stage and
        is raised.

    Examples
    --------
    >>> import palpate
    >>> rig, events = palpate.Rig(scan={"stations": 3}), []
    >>> plan, clock = palpate.plan_for(rig), palpate.SimulatedClock()
    >>> with palpate.connect(rig, clock, palpate.load_scene("TIHA")) as devices:
    ...     ended = palpate.run_scan(
    ...         plan, devices.stage, devices.sensors, clock, events.append,
    ...         palpate.limits_for(rig, plan),
    ...     )
    >>> ended == events[-1], ended.reason
    (True, 'every station is complete')
    """
    control = control or Control()
    guards = monitor_for(stage, sensors, clock, plan, limits, control)
    return run_guarded(
        guards, plan, clock, sink, limits, control, observers, config or {},
        Chooser(planner or Raster(plan), plan, completed, attempts),
    )  # fmt: skip


def run_guarded(
    guards: Guards,
    plan: Plan,
    clock: Clock,
    sink: EventSink,
    limits: Limits,
    control: Control,
    observers: Sequence[EventSink],
    config: Mapping[str, Any],
    chooser: Chooser,
) -> RunEnded:
    """`run_scan` on devices that ``guards`` have, in this process or in another."""

    def kept(event: Event) -> None:
        sink(event)
        chooser.hear(event)

    bus = EventBus(clock, kept, observers, threaded=guards.threaded)
    try:
        return _Scan(plan, clock, limits, guards, control, bus).run(config, chooser)
    finally:
        bus.close()


class _Scan(RunLoop):
    """The order of a scan: connect, then at every station travel, tare, press, lift."""

    def run(self, config: Mapping[str, Any], chooser: Chooser) -> RunEnded:
        finish, reason, self.chooser = Finish.COMPLETED, "", chooser
        try:
            self._connect(config)
            while isinstance(choice := self._choose(), Press):
                self._visit(choice)
            reason = choice.reason
            if self.known_levels is not None:
                note_last_drift(self)
        except Interrupted as why:
            finish, reason = why.finish or Finish.FAULTED, why.reason
            if self.zero_unseen and finish is Finish.FAULTED:
                note_unseen(self, why.device, reason)
        except BaseException as error:
            finish, reason, whose = Finish.FAULTED, f"{type(error).__name__}: {error}", "program"
            if isinstance(error, KeyboardInterrupt):  # a notebook's cell was interrupted
                finish, reason, whose = Finish.ABORTED, ABORTED, "user"
            try:
                reason = self._leave(Interrupted(finish, reason, whose, retract=True)).reason
            finally:
                self.monitor.stop()
                self._end(finish, reason)
            raise
        ended = self._end(finish, reason)
        if self.status.error is not None:
            raise self.status.error
        return ended

    def _connect(self, config: Mapping[str, Any]) -> None:
        channels = {s.name: s.channels for s in self.sensors}
        channels[STAGE] = tuple(
            replace(channel, simulated=self.stage.simulated) for channel in STAGE_CHANNELS
        )
        utc = datetime.now(UTC).isoformat(timespec="seconds")
        self.bus.publish(RunStarted(self.clock.now(), utc, config, channels))
        self.enter(Phase.CONNECTING)
        try:
            poses = planned_poses(self.plan, turns=self.stage.turns)
            for words in self.monitor.ready(poses):
                self.bus.note("info", self.stage.name, words)
        except DeviceFault as fault:
            self._note_not_lifted()
            raise self._interruption(fault) from fault
        self.guarded = True
        self.status = self.monitor.start(homes=self.stage.homes)
        if self.stage.homes:
            self._home()
            return
        try:
            self.handle()
        except Interrupted as error:  # the tip may stand in the tissue, left there by another scan
            if (why := self._leave(error)).finish is not None:
                raise why from error
            self._pause()

    def _note_not_lifted(self) -> None:
        """A stage that is not ready is not moved: say so where its tip is not known to be up."""
        where = "where it stands is not known"
        with suppress(Exception):  # a driver that is not connected may raise anything
            here = self.monitor.pose()
            if here.z >= self.plan.travel_z_m - UP_M:
                return
            x, y, z = (1e3 * at for at in here[:3])
            where = f"it stands at {x:.2f}, {y:.2f}, {z:.2f} mm"
        self._warn_not_lifted(f"nothing was moved; {where}")

    def _warn_not_lifted(self, why: str) -> None:
        text = f"the probe was not lifted: {why}; look at it before anything moves it"
        self.bus.note("warning", self.stage.name, text)

    def _home(self) -> None:
        """Have the stage find its switches: the only way it goes that no plan shows."""
        try:
            self.handle()
        except Interrupted:
            self._warn_not_lifted("nothing was moved; where it stands is known once it was homed")
            raise
        self.enter(Phase.HOMING)
        self.bus.note("info", self.stage.name, "moves to its limit switches and to its park")
        self.monitor.home()
        try:
            while not self.status.homed:
                self.tick(math.inf)
            self.handle()
        except Interrupted as why:
            began_s = self.clock.now()
            while not self.look().homed and self.clock.now() - began_s < HOME_STOPS_S:
                self.monitor.stop()
                time.sleep(STOP_AGAIN_S)
            self._warn_not_lifted("its homing was broken off; where it stands is not known")
            by_user = why.device == "user"
            finish = Finish.ABORTED if by_user else Finish.FAULTED
            reason = STOPPED if by_user else why.reason
            raise Interrupted(finish, reason, why.device, retract=False) from why

    def _choose(self) -> Press | Done:
        """Ask the planner; a pause meanwhile does not ask again."""
        choice = self.chooser.choose(threaded=self.monitor.threaded)
        while True:
            try:
                self.wait_for(choice)
                return choice.result()
            except (Interrupted, DeviceFault) as error:
                why = self._leave(self._interruption(error))
                if why.finish is not None:
                    raise why from error
            self._pause()

    def _visit(self, press: Press) -> None:
        """Press at one place, again after every pause that broke it off."""
        place, complete, self.jumps = press.place, False, 0
        while not complete:
            self.begin_station(place, self.chooser.attempts[place.index] + 1)
            try:
                self._press(press)
                complete = self.zero_unseen = True
            except (Interrupted, DeviceFault) as error:
                why = self._leave(self._interruption(error))
                self.end_station(complete=False)
                if why.finish is not None:
                    raise why from error
            if not complete or self.control.command is RunCommand.PAUSE_AFTER_STATION:
                self._pause()

    def _pause(self) -> None:
        """Rest in the air until `Control.resume`; simulated time stands still meanwhile."""
        self.enter(Phase.PAUSED)
        try:
            while self.control.command is not RunCommand.RESUME:
                if self.monitor.threaded:
                    self.tick(math.inf)
                else:
                    time.sleep(TICK_S)
                    self.handle()
        except (Interrupted, DeviceFault) as error:
            raise self._leave(self._interruption(error)) from error

    def _leave(self, why: Interrupted) -> Interrupted:
        """Have the monitor stop and lift the probe; what else went wrong then belongs to why."""
        level = "fault" if why.finish is Finish.FAULTED else "info"
        self.bus.note(level, why.device, why.reason)
        if not self.guarded:  # nothing has moved, and nobody would carry out a way out
            self._note_not_lifted()
            return why
        self.leaving = True
        try:
            if self.phase is not Phase.STOPPING:
                self.enter(Phase.STOPPING)
            self.status = self.monitor.leave(lift=why.retract)
            began_s, stays = self.clock.now(), not why.retract
            while not self._way_out().done and self.clock.now() - began_s < GIVE_UP_S:
                self.tick(self.clock.now() + FINE_S)
                if self.control.command is RunCommand.STOP:
                    if not stays:
                        self.status, stays = self.monitor.leave(lift=False), True
                    if why.finish is not Finish.FAULTED:
                        why = Interrupted(Finish.ABORTED, STOPPED, "user", retract=False)
                if self._way_out().lifting and self.phase is Phase.STOPPING:
                    self.enter(Phase.RETRACTING)
        finally:
            self.leaving = False
        trip, retreat = self.status.trip, self._way_out()
        if why.finish is not Finish.FAULTED and trip is not None and trip.device != "user":
            why = interruption_of(trip)
        if retreat.unheeded:
            text = f"it was not seen to stop by {', nor by '.join(retreat.unheeded)}"
            self.bus.note("warning", self.stage.name, f"{text}; see why before it moves again")
        if retreat.why_not is not None or not retreat.done:
            what = retreat.why_not or "the stage does not answer"
            lifted = "whether the probe was lifted is not known" if retreat.unsure else NOT_LIFTED
            self.bus.note("fault", self.stage.name, f"{lifted.upper()}: {what}; {BY_HAND}")
            reason = f"{why.reason}; {lifted}: {what}"
            why = Interrupted(Finish.FAULTED, reason, why.device, retract=False)
        elif not retreat.up:
            text = "the probe was not lifted, as asked; it may still press"
            self.bus.note("warning", self.stage.name, text)
        if why.finish is None:
            if self.phase is Phase.STOPPING:
                self.enter(Phase.RETRACTING)  # it was up already
            self.monitor.go_on()
        return why

    def _way_out(self) -> WayOut:
        return self.status.way_out or WayOut()

    def _interruption(self, error: Interrupted | DeviceFault) -> Interrupted:
        if isinstance(error, Interrupted):
            return error
        trip = self.look().trip  # a guard may have acted before the engine saw anything
        if self.control.command is RunCommand.STOP:
            return Interrupted(Finish.ABORTED, STOPPED, "user", retract=False)
        if trip is not None:
            return interruption_of(trip)
        return Interrupted(Finish.FAULTED, str(error), error.device, retract=True)

    def _end(self, finish: Finish, reason: str) -> RunEnded:
        self.monitor.finish()
        self.publish_samples()
        if Phase.FINISHED not in ALLOWED[self.phase]:
            self.enter(Phase.STOPPING)
        self.enter(Phase.FINISHED)
        if self.bus.sink_error is not None:
            finish, reason = Finish.FAULTED, self.bus.sink_error
        ended = RunEnded(self.clock.now(), finish, reason)
        self.bus.publish(ended)
        if self.bus.sink_error not in (None, reason):  # not even this could be stored
            reason = str(self.bus.sink_error)
            ended = replace(ended, finish=Finish.FAULTED, reason=reason)
        return ended

    def _press(self, press: Press) -> None:
        plan, place = self.plan, press.place
        above, surface = plan.above(place), plan.at_surface(place)
        self.enter(Phase.TRAVELLING)
        here = self.monitor.pose()
        if here.z < above.z:
            self.go(here._replace(z=above.z), plan.travel_m_s)
        self.go(above._replace(z=max(here.z, above.z)), plan.travel_m_s)
        self.go(above, plan.travel_m_s)
        self.enter(Phase.TARING)
        take_zero(self, above)
        self.enter(Phase.APPROACHING)
        if plan.touch_n is None:
            self.go(surface, plan.approach_m_s)
        else:
            surface = find_surface(self, surface, plan.touch_n)
        indenting_s = self.enter(Phase.INDENTING)
        depth_m = press_in(self, surface, press)
        holding_s = self.enter(Phase.HOLDING)
        if press.force_n is None and not plan.steps:
            note_the_ramp(self, place, holding_s - indenting_s)
        self.handle()
        self._check_contact(depth_m)
        hold_s = hold(self, self.chooser, press, holding_s)
        self._check_contact(depth_m)
        self.enter(Phase.RETRACTING)
        begin_lift(self, surface, depth_m, hold_s)
        self.go(above, plan.travel_m_s)
        self.end_station(complete=True)

    def _check_contact(self, depth_m: float) -> None:
        if self.in_the_air:
            return
        levels = self.monitor.levels(self.status.seen_s - LEVEL_S)
        rates_hz = {sensor.name: sensor.rate_hz for sensor in self.sensors}
        if (why := no_contact(levels, rates_hz, self.most_n, depth_m)) is not None:
            raise why
        if not self.noted_little and (soft := little(levels, self.most_n)) is not None:
            self.noted_little = True
            self.bus.note("warning", "engine", soft)
