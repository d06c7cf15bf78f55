"""Reads every device, runs the guards on each reading, and stops and lifts when one objects.

With the wall clock it lives in threads of its own: one for each sensor, one for the stage, and one
that only looks whether the others beat, so that nothing that hangs hides anything else. With a
simulated clock the engine calls `step`: every two samples on the way down, else every 8 ms.
"""

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial

import numpy as np

from drivers import Block, Clock, ConfigError, DeviceFault, Pose, Sensor, Stage
from drivers.core import abilities
from drivers.core.errors import as_fault
from probe.guards.clock_guard import ClockGuard
from probe.guards.commands import STOPPED, Control, RunCommand
from probe.guards.device_facts import facts_of
from probe.guards.force_limit import SensorGuard
from probe.guards.guard_threads import GuardThreads
from probe.guards.guarded_stage import GuardedStage
from probe.guards.interface import Status, WayOut
from probe.guards.pose_guard import PoseGuard
from probe.guards.readings import STAGE, Readings
from probe.guards.silence import Silence
from probe.planning.limits import Limits
from probe.planning.surfaces import Surface

SUPERVISOR = "supervisor"
STAGE_PERIOD_S = 0.008  # 0.16 mm at 20 mm/s; none is critical, see `force_limit.LEVEL_MEMORY_S`
SUPERVISOR_PERIOD_S = 0.01  # a silence is found late by this at most, a tenth of `PAUSE_S`
# The supervisor only sleeps and looks. Late by this much, it is the program that did not run, and
# nobody else is to blame for having been silent meanwhile.
PAUSE_S = 0.1
DEAD_S = 1.0  # a supervisor that is later than this is itself at fault


class SafetyMonitor(GuardedStage):
    """Owner of all readings. The engine moves the stage through it and drains `collect`.

    Raises `ConfigError` where the force limit would hold no channel at all, unless it
    ``lifts_only``.
    """

    def __init__(
        self,
        stage: Stage,
        sensors: Sequence[Sensor],
        clock: Clock,
        surface: Surface,
        limits: Limits,
        control: Control,
        *,
        threaded: bool,
        lift_z_m: float | None = None,
        lifts_only: bool = False,
    ) -> None:
        felt = [
            (s, SensorGuard(s.channels, limits, limits.filter_s.get(s.name, 0.0))) for s in sensors
        ]
        super().__init__(stage, felt, clock, surface, limits, lift_z_m)
        self.jumped: tuple[str, float] | None = None  # device, by how much its clock stood still
        self.threaded = threaded
        self.facts = facts_of(stage, sensors)
        self._homed = threading.Event()
        self._stepped_s = np.inf  # before `start` nothing is read
        self._control = control
        self._sensor_steps = [
            partial(self._guarded, partial(self._step_sensor, s, g)) for s, g in self._sensors
        ]
        if not lifts_only and not any(guard.feels for _, guard in self._sensors):
            raise ConfigError(
                "safety.max_force_n would hold nothing: no sensor reads a force, and a pressure "
                "becomes one only over a known face; add a force sensor, or say face_mm2 = 100"
            )
        self._clock_guards = [
            ClockGuard(limits, clock.now, time.monotonic),
            ClockGuard(limits, time.monotonic),
        ]
        self._readings = Readings(s.name for s in sensors)
        self._silence = Silence(stage.name, self._sensors, self._readings, limits)
        self._homing = False
        self._engine_s = time.monotonic()
        self._threads = GuardThreads(self._watch_supervisor)

    # --- the engine's side -------------------------------------------------------------------

    def ready(self, poses: Sequence[Pose]) -> list[str]:
        """Connect all devices and make the stage ready; what it then says of itself.

        Raises `DeviceFault` where it cannot go to all of ``poses``.
        """
        self._stage.connect()
        words = abilities.enable(self._stage)
        if far := abilities.unreachable(self._stage, poses):
            pose, why = next(iter(far.items()))
            x, y, z = (1e3 * at for at in pose[:3])
            raise DeviceFault(
                self._stage.name, f"cannot go to {len(far)} of {len(poses)} planned poses, such as "
                f"{x:.1f}, {y:.1f}, {z:.1f} mm: {why}"
            )  # fmt: skip
        for sensor, _ in self._sensors:
            sensor.connect()
        return words

    def start(self, *, homes: bool = False) -> Status:
        """Begin; every device counts as seen now. ``homes``: the stage has no pose until `home`.

        They begin also where a sensor has died meanwhile: without them nobody lifts the probe.
        """
        for sensor, _ in self._sensors:
            try:
                sensor.start()
            except Exception as error:  # noqa: BLE001 - drivers of others may raise anything
                fault = as_fault(sensor.name, error)
                self.object(fault.device, fault.reason, can_retract=not homes)
        self._homing = homes
        self._stepped_s = self._clock.now()
        self._readings.all_seen(self._stepped_s)
        self._engine_s = time.monotonic()
        if self.threaded:
            self._threads.run(STAGE, partial(self._guarded, self._step_stage), STAGE_PERIOD_S)
            for (sensor, _), step in zip(self._sensors, self._sensor_steps, strict=True):
                self._threads.run(sensor.name, step, max(0.5 / sensor.rate_hz, 0.5e-3))
            self._threads.run(
                SUPERVISOR, partial(self._guarded, self._supervise), SUPERVISOR_PERIOD_S
            )
        return self.status()

    @property
    def running(self) -> bool:
        """The threads have begun, and not ended."""
        return self._threads.running

    def finish(self) -> None:
        """End the threads, and the sensors' sampling; what was read can still be collected."""
        self._threads.finish()
        for sensor, _ in self._sensors:
            sensor.stop()

    def step(self) -> None:
        """Read and check everything once; only without threads."""
        for step in self._sensor_steps:
            step()
        self._guarded(self._step_stage)
        self._check_silence()

    def engine_heartbeat(self) -> None:
        """The engine lives, and looks whether the threads do."""
        self._engine_s = time.monotonic()
        if self._threads.running:
            self._check_thread(SUPERVISOR)

    def look(self) -> Status:
        """The engine's heartbeat; without threads, what has come since the last is checked here."""
        now_s = self._clock.now()
        if not self.threaded and now_s > self._stepped_s:
            self._stepped_s = now_s
            self.step()
        self.engine_heartbeat()
        return self.status()

    def status(self) -> Status:
        """How things stand; a jump of a clock is said once."""
        way_out, pace = self.retreat, 1.0
        with suppress(DeviceFault):  # it is answered above all when the stage is lost
            pace = abilities.pace(self._stage)
        jumped, self.jumped = self.jumped, None
        return Status(
            self.trip,
            self.error,
            self.seen_s(),
            self.force_n(),
            None if way_out is None else WayOut(*(getattr(way_out, f) for f in WayOut._fields)),
            self._homed.is_set(),
            pace,
            jumped,
        )

    def seen_s(self) -> float:
        """Up to when the samples of every sensor are in."""
        return self._readings.all_in_s(self._clock.now())

    def levels(self, from_s: float) -> dict[str, tuple[float, float]]:
        """Mean force [N] since ``from_s`` and its standard error, by sensor that feels one."""
        return {s.name: g.level(from_s) for s, g in self._sensors if g.feels}

    def collect(self) -> list[tuple[str, Block]]:
        """All readings since the last call, one block per device that has some."""
        return self._readings.collect()

    def touched_n(self, since_s: float, readings: int = 1) -> float | None:
        """The greatest mean of ``readings`` forces since ``since_s``, if the stage itself ended its
        search; else None."""
        most_n = (g.greatest_n(since_s, readings) for _, g in self._sensors if g.feels)
        return next(most_n, 0.0) if abilities.touched(self._stage) else None

    def home(self) -> None:
        """Let the stage find its switches; `Status.homed` when it has, or a trip says why not.

        Its poses mean nothing meanwhile; force, silence of the sensors and commands are watched.
        Raises `DeviceFault` if a guard has stopped the scan.
        """
        self._refuse_after_a_trip()

        def go() -> None:
            try:
                self._stage.home()  # type: ignore[attr-defined]  # only one that ``homes``
            except DeviceFault as fault:
                self.object(fault.device, fault.reason, can_retract=False)
            except BaseException as error:  # noqa: BLE001 - whatever it is, the scan must end
                self.error = error
                self.object("guard", f"{type(error).__name__}: {error}", can_retract=False)
            self._pose_guard = PoseGuard(self._surface, self._limits)
            self._readings.seen_s[STAGE] = self._clock.now()
            self._homing = False
            self._homed.set()

        threading.Thread(target=go, name="palpate homing", daemon=True).start()

    def tare(self) -> None:
        """Take the present load of every sensor as zero; all are read on. Raises `DeviceFault`."""
        for sensor, guard in self._sensors:
            sensor.tare()
            guard.tare()

    def leave(self, *, lift: bool) -> Status:
        """Stop, and lift if so wanted; the way out that is under way already is not begun anew."""
        with self._trip_lock:
            if self.retreat is None:
                self._begin_retreat(lift=lift)
            assert self.retreat is not None
            if not lift:
                self.retreat.stay()
        self._stage.stop()
        return self.status()

    # --- the threads -------------------------------------------------------------------------

    def _watch_supervisor(self, name: str) -> None:
        if name != SUPERVISOR:
            self._check_thread(SUPERVISOR)

    def _guarded(self, step: Callable[[], None]) -> None:
        try:
            step()
        except BaseException as error:  # noqa: BLE001 - a guard that dies must stop the stage
            if not isinstance(error, DeviceFault):
                self.error = self.error or error
            self.object("guard", f"{type(error).__name__}: {error}", can_retract=True)

    def _check_thread(self, name: str) -> None:
        late_s = self._threads.late_s(name)
        if late_s > DEAD_S:
            self.object("guard", f"its {name} has done nothing for {late_s:.2f} s",
                        can_retract=True)  # fmt: skip

    def _program_pauses(self) -> bool:
        """The supervisor is late: nothing that is late too is to blame for it."""
        return PAUSE_S < self._threads.late_s(SUPERVISOR) < DEAD_S

    def _step_sensor(self, sensor: Sensor, guard: SensorGuard) -> None:
        try:
            block = sensor.read()
        except DeviceFault as fault:
            self.object(fault.device, fault.reason, can_retract=True)
            return
        if not len(block.time_s):
            return
        if (jump := guard.times.check(block, self._clock.now())) is not None:
            self.object(sensor.name, jump, can_retract=True)
            return
        self._readings.take(sensor.name, block)
        if block.jumped_s > 0:
            self.jumped = (sensor.name, block.jumped_s)
        if (why := guard.check(block)) is not None:
            self.object(sensor.name, why, can_retract=True, again=True)

    def _step_stage(self) -> None:
        if self._homing:
            self._readings.seen_s[STAGE] = self._clock.now()
            if self.trip is not None:
                self._stage.stop()  # until it is heard
            return
        asked_s, pose, trouble = self._clock.now(), None, ""
        try:
            pose = self.pose()
        except DeviceFault as fault:
            trouble = str(fault)
            if self._program_pauses():
                return  # the next look says whether the stage or this program was late
            self.object(fault.device, fault.reason, can_retract=True)
        now = self._clock.now()
        if pose is not None:
            self._take(pose, now, asked_s)
        if (retreat := self.retreat) is not None and not retreat.done:
            known = pose if pose is not None and np.isfinite(pose[:3]).all() else None
            retreat.step(now, known, trouble or "its pose is not a number")
            if retreat.done and known is not None:
                self.arrived(known)

    def _why_still(self) -> str:
        with suppress(DeviceFault):
            if (why := self._alone(partial(abilities.why_still, self._stage))) is not None:
                return f": {why}"
        return "; nothing says why"

    def _take(self, pose: Pose, now: float, asked_s: float) -> None:
        self._readings.take_pose(pose, now)
        if (why := self._pose_guard.check(pose, now, asked_s)) is not None:
            self.object(self._stage.name, why[0], can_retract=why[1], again=True)
        if self.retreat is None and (stands := self._stand_still.check(pose, now)) is not None:
            self.object(self._stage.name, stands + self._why_still(), can_retract=True)
        odd = self._presses.check(pose, now)
        if odd is not None and not abilities.touched(self._stage):  # which may go back by then
            self.object(*odd, can_retract=True)

    def _supervise(self) -> None:
        """What only the wall clock can show: a pause, a jump, a blocked engine, a stop."""
        late_s = self._threads.late_s(SUPERVISOR)
        if late_s > PAUSE_S:
            self._silence.excuse(self._clock.now())
            self._threads.excuse()
            self._engine_s = max(self._engine_s, time.monotonic() - self._limits.engine_s / 2)
            if late_s > self._limits.silence_s:
                why = f"this program did not run for {late_s:.2f} s, and nobody looked at the force"
                self.object("computer", why, can_retract=True)
        for guard in self._clock_guards:
            if (jumped := guard.check()) is not None:
                self.object("clock", jumped, can_retract=True)
        self._check_silence()
        if self._homing and self._control.command is RunCommand.ABORT:
            self.object("user", STOPPED, can_retract=False)
        if self._control.command is RunCommand.STOP:
            self.object("user", STOPPED, can_retract=False)
            if self.retreat is not None:
                self.retreat.stay()
        if time.monotonic() - self._engine_s > self._limits.engine_s:
            self.object("engine", f"blocked for {self._limits.engine_s:g} s", can_retract=True)
        if self._threads.latest_s() < PAUSE_S:
            abilities.keep_alive(self._stage)  # where a guard hangs, a stage with a watchdog halts

    def _check_silence(self) -> None:
        silent = self._silence.check(
            self._clock.now(), in_motion=self._in_motion, down_m_s=self._down_m_s
        )
        for device, why in silent:
            self.object(device, why, can_retract=True)
