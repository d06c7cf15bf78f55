"""The process that has the devices: it reads, guards, stops and lifts.

The scan's process asks it to move and collects the readings. Whatever code runs there, an
observer, the store, an extension that keeps the interpreter, cannot delay a guard here; and when
that process stands still or dies, the probe is stopped and lifted all the same.

    python -c "from probe.guards.guard_process import main; main()" CALLS URGENT LIFE

with three inherited sockets: one for calls and their answers, one for what cannot wait for them,
and one that echoes, to show that this interpreter runs.
"""

import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields
from multiprocessing.connection import Connection
from typing import Any

from drivers import Channel, Clock, DeviceFault, Pose
from drivers.core import abilities
from drivers.core.errors import as_fault
from probe.config.devices import Devices, connect
from probe.config.rig import Fallback, Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.guards.commands import ENDING, Control, RunCommand
from probe.guards.guard_threads import come_first
from probe.guards.interruption import Trip
from probe.guards.prepare import prepare
from probe.guards.retreat import lift_speed_m_s
from probe.guards.safety_monitor import SafetyMonitor
from sim_backend.scene.scene_file import Scene

ALONE_S = 60.0  # a process whose scan has gone tries this long to lift the probe
LOOK_S = 0.01


@dataclass(frozen=True)
class Order:
    """What to open, on a clock whose zero both processes share. Without sensors: only to lift."""

    rig: Rig
    clock: Clock
    scene: Scene | None
    seed: int
    fallback: Fallback | None


@dataclass(frozen=True)
class SensorFacts:
    """What the scan must know of a sensor it does not have."""

    name: str
    channels: tuple[Channel, ...]
    rate_hz: float


@dataclass(frozen=True)
class Facts:
    """What was opened; ``enable_s`` as `drivers.core.abilities.enable_s`."""

    stage: str
    simulated: bool
    turns: bool
    homes: bool
    enable_s: float
    sensors: tuple[SensorFacts, ...]
    scene: Scene | None
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Leaving:
    """A `Retreat` as the scan sees it."""

    done: bool = False
    lifting: bool = False
    up: bool = False
    why_not: str | None = None
    unheeded: tuple[str, ...] = ()
    unsure: bool = False


OF_RETREAT = fields(Leaving)


@dataclass(frozen=True)
class Status:
    """How things stand; asking for it is the engine's heartbeat.

    ``leaving`` is how the way out stands, None if there is none;
    ``jumped`` is a device whose clock stood still, and for how long, said once.
    """

    trip: Trip | None
    error: str | None
    seen_s: float
    force_n: float
    leaving: Leaving | None
    homed: bool
    pace: float = 1.0
    jumped: tuple[str, float] | None = None


OF_MONITOR = (
    "move", "moving", "pose", "arrived", "touched_n", "tare", "levels", "collect", "go_on",
)  # fmt: skip
"""What the scan's process asks of the monitor itself, by the same names."""


class Service:
    """What the scan's process may call, each by its name: these, and `OF_MONITOR`."""

    def __init__(self, devices: Devices, monitor: SafetyMonitor) -> None:
        self.finished = self.started = False
        self._devices, self._monitor = devices, monitor
        self._homed: threading.Event | None = None

    def asked(self, name: str) -> Callable[..., Any]:
        """What answers to a name."""
        found: Callable[..., Any] = getattr(self._monitor if name in OF_MONITOR else self, name)
        return found

    def start(self, homes: bool) -> Status:
        """Sensors first, then the guards, which begin also where a sensor has died meanwhile."""
        for sensor in self._devices.sensors:
            try:
                sensor.start()
            except Exception as error:  # noqa: BLE001 - without guards nobody lifts the probe
                fault = as_fault(sensor.name, error)
                self._monitor.object(fault.device, fault.reason, can_retract=not homes)
        self._monitor.start(homes=homes)
        self.started = True
        return self.status()

    def take_over(self, why: str, lift: bool) -> Status:
        """Go on for a process that died: guard, stop, and lift."""
        with suppress(DeviceFault):  # the way out asks again
            self.enable()
        # Before the guards look: what they object to first would say whether to lift.
        self._monitor.object("guard", why, can_retract=lift)
        self.start(homes=False)
        return self.status()

    def status(self) -> Status:
        """See `Status`."""
        monitor = self._monitor
        monitor.engine_heartbeat()
        out, error = monitor.retreat, monitor.error
        jumped, monitor.jumped = monitor.jumped, None
        return Status(
            monitor.trip,
            None if error is None else f"{type(error).__name__}: {error}",
            monitor.seen_s(),
            monitor.force_n(),
            None if out is None else Leaving(**{f.name: getattr(out, f.name) for f in OF_RETREAT}),
            self._homed is not None and self._homed.is_set(),
            self._pace(),
            jumped,
        )

    def _pace(self) -> float:
        with suppress(DeviceFault):  # a heartbeat is answered above all when the stage is lost
            return abilities.pace(self._devices.stage)
        return 1.0

    def enable(self) -> list[str]:
        return abilities.enable(self._devices.stage)

    def unreachable(self, poses: list[Pose]) -> dict[Pose, str]:
        return abilities.unreachable(self._devices.stage, poses)

    def home(self) -> None:
        self._homed = self._monitor.home()

    def leave(self, lift: bool) -> Status:
        self._monitor.leave(lift=lift)
        return self.status()

    def stay(self) -> None:
        if self._monitor.retreat is not None:
            self._monitor.retreat.stay()

    def finish(self) -> None:
        """End the guards; what was read can still be collected."""
        self._monitor.finish()
        for sensor in self._devices.sensors:
            sensor.stop()
        self.finished = True

    def left_alone(self) -> None:
        """The scan's process has gone: lift the probe, whatever it was doing."""
        if not self.started or self.finished:
            return
        monitor, end_s = self._monitor, time.monotonic() + ALONE_S
        monitor.object("scan", "its process has ended", can_retract=True)
        while time.monotonic() < end_s and not (monitor.retreat and monitor.retreat.done):
            monitor.engine_heartbeat()
            time.sleep(LOOK_S)
        self.finish()


def main() -> None:
    """Open what is ordered and serve until the scan's process closes the line."""
    come_first()  # all threads of drivers too: a guard waits for what they read
    calls, urgent, life = (Connection(int(number)) for number in sys.argv[1:4])
    threading.Thread(target=_echo, args=(life,), daemon=True).start()
    for number in ENDING:  # as if the scan had gone
        signal.signal(number, lambda _number, _frame: calls.close())
    order: Order = calls.recv()
    try:
        devices = connect(
            order.rig, order.clock, order.scene, seed=order.seed, fallback=order.fallback
        )
    except Exception as error:  # noqa: BLE001 - it is the scan's to say what was wrong
        calls.send(error)
        return
    with devices:
        try:
            facts, service = _ready(order, devices, urgent)
        except Exception as error:  # noqa: BLE001 - as above
            calls.send(error)
            return
        calls.send(facts)
        _serve(service, calls)


def _ready(order: Order, devices: Devices, urgent: Connection) -> tuple[Facts, Service]:
    scene = devices.phantom.scene if devices.phantom is not None else None
    plan = plan_for(order.rig)
    limits = limits_for(order.rig, plan)
    prepared = prepare(order.rig, plan, limits, scene, devices, order.seed)
    control = Control()
    monitor = SafetyMonitor(
        devices.stage,
        devices.sensors,
        order.clock,
        prepared.plan.surface,
        prepared.limits,
        control,
        threaded=True,
        lift_z_m=prepared.plan.travel_z_m,
        lifts_only=not order.rig.sensor,
    )
    lift_m_s = lift_speed_m_s(devices.stage, prepared.limits)
    abilities.lift_when_alone(devices.stage, prepared.plan.travel_z_m, lift_m_s)
    threading.Thread(target=_hear, args=(urgent, devices, control), daemon=True).start()
    facts = Facts(
        devices.stage.name,
        devices.stage.simulated,
        abilities.turns(devices.stage),
        abilities.homes(devices.stage),
        abilities.enable_s(devices.stage),
        tuple(SensorFacts(s.name, s.channels, s.rate_hz) for s in devices.sensors),
        scene,
        devices.notes,
    )
    return facts, Service(devices, monitor)


def _serve(service: Service, calls: Connection) -> None:
    while True:
        try:
            number, name, arguments, keywords = calls.recv()
        except (EOFError, OSError):
            break
        answer: tuple[int, bool, Any]
        try:
            answer = (number, True, service.asked(name)(*arguments, **keywords))
        except Exception as error:  # noqa: BLE001 - every fault is the engine's to handle
            answer = (number, False, error)
        with suppress(OSError):  # it went away meanwhile: the next `recv` says so
            calls.send(answer)
    service.left_alone()


def _echo(life: Connection) -> None:
    """Whoever hears it knows that this interpreter runs."""
    with suppress(EOFError, OSError):
        while True:
            life.send(life.recv())


def _hear(urgent: Connection, devices: Devices, control: Control) -> None:
    """What cannot wait for an answer: the user's command, or None for a stop."""
    with suppress(EOFError, OSError):
        while True:
            command: RunCommand | None = urgent.recv()
            if command is None:
                devices.stage.stop()
            elif command is RunCommand.STOP:
                control.stop()
            elif command is RunCommand.ABORT:
                control.abort()
