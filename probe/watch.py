"""Reads every device, runs the guards on each reading, and stops the stage when one objects.

With the wall clock it lives in two threads of its own (one for the sensors, one for the stage), so
it acts also while the engine is blocked, and a stage that hangs does not hide the force. With a
simulated clock the engine calls `Watch.step` itself, at most two sensor samples apart.
"""

import math
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

import numpy as np

from drivers import Block, Channel, Clock, DeviceFault, Pose, Sensor, Stage
from probe.control import Control, Wish
from probe.guards import ClockGuard, Limits, PoseGuard, SensorGuard, Trip
from probe.plan import Surface

STAGE = "stage"
STAGE_CHANNELS = tuple(Channel(axis, "m") for axis in "xyz")
STAGE_PERIOD_S = 0.008
ENGINE_SILENCE_S = 2.0
LOCK_S = 0.25
# A busy Python thread may keep the interpreter this long before a guard gets it. Python's own 5 ms
# are 2.5 samples at 500 Hz (measured: benchmarks/guards.py).
SWITCH_S = 0.2e-3


class Watch:
    """Owner of all readings. The engine moves the stage through it and drains `collect`.

    ``trip`` is the first objection; from then on `move` refuses everything but a retreat.
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
    ) -> None:
        self.trip: Trip | None = None
        self.error: Exception | None = None
        self.retreat: Pose | None = None
        self.threaded = threaded
        self._stage = stage
        self._clock = clock
        self._limits = limits
        self._control = control
        self._feelers = [(s, SensorGuard(s.channels, limits)) for s in sensors]
        self._pose_guard = PoseGuard(surface, limits)
        self._clock_guard = ClockGuard(limits, clock.now, time.monotonic)
        self._blocks: dict[str, deque[Block]] = {s.name: deque() for s in sensors}
        self._poses: deque[tuple[float, float, float, float]] = deque()
        self._seen_s: dict[str, float] = {}
        self._posed_s = -math.inf
        self._engine_s = time.monotonic()
        self._stage_lock = threading.Lock()
        self._sensor_lock = threading.Lock()
        self._trip_lock = threading.Lock()
        self._end = threading.Event()
        self._threads: list[threading.Thread] = []

    def start(self) -> None:
        """Begin; every device counts as seen now."""
        self._seen_s = dict.fromkeys((*self._blocks, STAGE), self._clock.now())
        if not self.threaded:
            return
        self._switch_s = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_S)
        fastest_hz = max((s.rate_hz for s, _ in self._feelers), default=1 / STAGE_PERIOD_S)
        for name, step, period_s in (
            ("sensors", self._step_sensors, max(0.5 / fastest_hz, 0.5e-3)),
            ("stage", self._step_stage, STAGE_PERIOD_S),
        ):
            thread = threading.Thread(
                target=self._repeat, args=(step, period_s), name=f"palpate {name}", daemon=True
            )
            thread.start()
            self._threads.append(thread)

    def finish(self) -> None:
        """End the threads."""
        self._end.set()
        for thread in self._threads:
            thread.join(timeout=1.0)
        if self._threads:
            sys.setswitchinterval(self._switch_s)

    def step(self) -> None:
        """Read and check everything once; only without threads."""
        self._step_sensors()
        self._step_stage()

    def engine_lives(self) -> None:
        """The engine's heartbeat."""
        self._engine_s = time.monotonic()

    def seen_s(self) -> float:
        """Up to when the samples of every sensor are in."""
        return min((self._seen_s[s.name] for s, _ in self._feelers), default=self._clock.now())

    def force_n(self) -> float:
        """The latest force of the first sensor that feels one."""
        return next((g.force_n for _, g in self._feelers if g.feels), 0.0)

    def collect(self) -> list[tuple[str, Block]]:
        """All readings since the last call, one block per device that has some."""
        found = [
            (name, _joined([waiting.popleft() for _ in range(len(waiting))]))
            for name, waiting in self._blocks.items()
            if waiting
        ]
        if self._poses:
            rows = np.array([self._poses.popleft() for _ in range(len(self._poses))])
            poses = rows[:, 1:].copy()
            found.append((STAGE, Block(rows[:, 0].copy(), poses, np.zeros(poses.shape, bool))))
        return found

    def move(self, target: Pose, speed_m_s: float, *, retreat: bool = False) -> None:
        """Start a move, unless a guard has stopped the scan. Raises `DeviceFault`."""
        with self._held():
            if self.trip is not None and not retreat:
                raise DeviceFault(self.trip.device, self.trip.reason)
            self._stage.move(target, speed_m_s)

    def tare(self) -> None:
        """Take the present load of every sensor as zero. Raises `DeviceFault`."""
        with self._sensor_lock:
            for sensor, _ in self._feelers:
                sensor.tare()

    def moving(self) -> bool:
        """True while the stage moves. Raises `DeviceFault`."""
        with self._held():
            return self._stage.moving()

    def pose(self) -> Pose:
        """The stage's pose. Raises `DeviceFault`."""
        with self._held():
            return self._stage.pose()

    def object(self, device: str, reason: str, *, can_retract: bool) -> None:
        """Stop the stage. Stopped twice: a move that was being started is caught by the second."""
        with self._trip_lock:
            if self.trip is not None:
                return
            self.trip = Trip(self._clock.now(), device, reason, can_retract)
        self._stage.stop()
        if self._stage_lock.acquire(timeout=LOCK_S):
            self._stage.stop()
            self._stage_lock.release()

    @contextmanager
    def _held(self) -> Iterator[None]:
        """The stage to oneself. Raises `DeviceFault` if another call to it hangs."""
        if not self._stage_lock.acquire(timeout=2 * self._limits.silence_s):
            raise DeviceFault(self._stage.name, "does not answer")
        try:
            yield
        finally:
            self._stage_lock.release()

    def _repeat(self, step: Callable[[], None], period_s: float) -> None:
        _come_first()
        while not self._end.wait(period_s):
            try:
                step()
            except Exception as error:  # noqa: BLE001 - a guard that dies must stop the stage
                self.error = self.error or error
                self.object("guard", f"{type(error).__name__}: {error}", can_retract=True)

    def _step_sensors(self) -> None:
        now = self._clock.now()
        if self.threaded:
            self._check_threads(now)
        for sensor, guard in self._feelers:
            try:
                with self._sensor_lock:
                    block = sensor.read()
            except DeviceFault as fault:
                self.object(fault.device, fault.reason, can_retract=True)
                continue
            if len(block.time_s):
                if (jump := guard.check_times(block, self._clock.now())) is not None:
                    self.object(sensor.name, jump, can_retract=True)
                    continue
                self._blocks[sensor.name].append(block)
                self._seen_s[sensor.name] = float(block.time_s[-1])
                if (why := guard.check(block)) is not None:
                    self.object(sensor.name, why[0], can_retract=why[1])
            silent_s = now - self._seen_s[sensor.name]
            if silent_s > max(self._limits.silence_s, 5 / sensor.rate_hz):
                self.object(sensor.name, f"silent for {silent_s:.2f} s", can_retract=True)

    def _step_stage(self) -> None:
        asked_s = self._clock.now()
        try:
            pose = self.pose()
        except DeviceFault as fault:
            self.object(fault.device, fault.reason, can_retract=False)
            return
        now = self._clock.now()
        self._seen_s[STAGE] = now
        if now > self._posed_s:  # a clock that was set back says nothing of when
            self._posed_s = now
            self._poses.append((now, pose.x, pose.y, pose.z))
        if (why := self._pose_guard.check(pose, now, asked_s)) is not None:
            self.object(self._stage.name, why[0], can_retract=why[1])

    def _check_threads(self, now: float) -> None:
        """What only the wall clock can show: a jump, a hanging stage, a blocked engine, a stop."""
        if (why := self._clock_guard.check()) is not None:
            self.object("clock", why[0], can_retract=why[1])
        if now - self._seen_s[STAGE] > self._limits.silence_s:
            silent_s = now - self._seen_s[STAGE]
            self.object(self._stage.name, f"silent for {silent_s:.2f} s", can_retract=False)
        if self._control.wish is Wish.STOP:
            self.object("user", "stopped by the user", can_retract=False)
        if self.trip is None and time.monotonic() - self._engine_s > ENGINE_SILENCE_S:
            self.object("engine", f"blocked for {ENGINE_SILENCE_S:g} s", can_retract=True)
            if self.retreat is not None:  # nobody else will lift the probe
                self._stage.move(self.retreat, self._limits.max_speed_m_s / 4)


def _come_first() -> None:
    """Let this thread run before all others of the machine, where the system permits it."""
    with suppress(AttributeError, OSError):  # Linux only; root, or a limit on `rtprio`
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))


def _joined(blocks: list[Block]) -> Block:
    if len(blocks) == 1:
        return blocks[0]
    return Block(
        np.concatenate([b.time_s for b in blocks]),
        np.concatenate([b.values for b in blocks]),
        np.concatenate([b.saturated for b in blocks]),
        sum(b.lost for b in blocks),
    )
