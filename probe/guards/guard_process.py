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
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from drivers import Clock, DeviceFault, Stage
from drivers.core import abilities
from probe.config.devices import Devices, connect
from probe.config.rig import Fallback, Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.guards.commands import ENDING, Control, RunCommand
from probe.guards.device_facts import Facts
from probe.guards.guard_threads import come_first
from probe.guards.interface import Status
from probe.guards.prepare import monitor_for, prepare
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


class MistakeElsewhere(RuntimeError):
    """A mistake in a driver or guard, in the other process: its own error may not come over."""


class Service:
    """What the scan's process may ask: all of `Guards`, and `take_over`."""

    def __init__(self, stage: Stage, monitor: SafetyMonitor) -> None:
        self._stage, self._monitor = stage, monitor

    def answer(self, name: str, arguments: Sequence[Any], keywords: Mapping[str, Any]) -> Any:
        """Raises what it raises."""
        ask = self.take_over if name == "take_over" else getattr(self._monitor, name)
        answer = ask(*arguments, **keywords)
        if isinstance(answer, Status) and (error := answer.error) is not None:
            return answer._replace(error=MistakeElsewhere(f"{type(error).__name__}: {error}"))
        return answer

    def take_over(self, why: str, lift: bool) -> Status:
        """Go on for a process that died: guard, stop, and lift."""
        with suppress(DeviceFault):  # the way out asks again
            abilities.enable(self._stage)
        # Before the guards look: what they object to first would say whether to lift.
        self._monitor.object("guard", why, can_retract=lift)
        return self._monitor.start(homes=False)

    def left_alone(self) -> None:
        """The scan's process has gone: lift the probe, whatever it was doing."""
        monitor, end_s = self._monitor, time.monotonic() + ALONE_S
        if not monitor.running:
            return
        monitor.object("scan", "its process has ended", can_retract=True)
        while time.monotonic() < end_s and not (monitor.retreat and monitor.retreat.done):
            monitor.engine_heartbeat()
            time.sleep(LOOK_S)
        monitor.finish()


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
    monitor = monitor_for(
        devices.stage, devices.sensors, order.clock, prepared.plan, prepared.limits, control,
        lifts_only=not order.rig.sensor,
    )  # fmt: skip
    lift_m_s = lift_speed_m_s(devices.stage, prepared.limits)
    abilities.lift_when_alone(devices.stage, prepared.plan.travel_z_m, lift_m_s)
    threading.Thread(target=_hear, args=(urgent, monitor, control), daemon=True).start()
    facts = monitor.facts._replace(notes=devices.notes, scene=scene)
    return facts, Service(devices.stage, monitor)


def _serve(service: Service, calls: Connection) -> None:
    while True:
        try:
            number, name, arguments, keywords = calls.recv()
        except (EOFError, OSError):
            break
        answer: tuple[int, bool, Any]
        try:
            answer = (number, True, service.answer(name, arguments, keywords))
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


def _hear(urgent: Connection, monitor: SafetyMonitor, control: Control) -> None:
    """What cannot wait for an answer: the user's command, or None for a stop."""
    with suppress(EOFError, OSError):
        while True:
            command: RunCommand | None = urgent.recv()
            if command is None:
                monitor.stop()
            elif command is RunCommand.STOP:
                control.stop()
            elif command is RunCommand.ABORT:
                control.abort()
