"""The scan's side of the process that has the devices: what the engine sees of both.

It answers as a `SafetyMonitor` does. When the other process is gone, nothing here can reach the
stage any more, and the scan says so.
"""

import os
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, Self

from drivers import Block, DeviceFault, Pose
from probe.acquisition.commands import Control, RunCommand
from probe.acquisition.guard_process import Facts, Order, SensorFacts, Status
from probe.acquisition.interruption import Trip
from probe.acquisition.levels import Levels

ANSWER_S = 20.0  # longer than any call takes: a tare, or a stage that hangs
COMMAND_LOOK_S = 0.005
CLOSE_S = 70.0  # it may still be lifting the probe
GONE = "the process that guards has ended: the probe may be in the tissue, look at it"
BODY = "from probe.acquisition.guard_process import main; main()"


class Error(RuntimeError):
    """A mistake in a driver or guard, in the other process."""


class GuardClient:
    """A `SafetyMonitor` in a process of its own, with the devices of ``order``.

    Raises what `probe.config.devices.connect` raises, and `DeviceFault` if the process does not
    come up.
    """

    threaded = True

    def __init__(self, order: Order, control: Control) -> None:
        self._control = control
        self.jumped: tuple[str, float] | None = None
        self._lock = threading.Lock()
        self._gone = False
        ours, theirs = zip(socket.socketpair(), socket.socketpair(), strict=True)
        numbers = [end.fileno() for end in theirs]
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", BODY, *map(str, numbers)],
            pass_fds=numbers,
            stdin=subprocess.DEVNULL,
            stdout=2,  # a library that prints must not spoil the scan's answer
            start_new_session=True,  # a terminal's signals are for the scan
            env=os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        )
        for end in theirs:
            end.close()
        self._calls, self._urgent = (Connection(end.detach()) for end in ours)
        facts = self._open(order)
        self.stage = RemoteStage(facts, self)
        self.sensors = tuple(RemoteSensor(one) for one in facts.sensors)
        self.notes, self.scene = facts.notes, facts.scene
        self._status = Status(None, None, order.clock.now(), 0.0, None, False)
        threading.Thread(target=self._pass_on, name="palpate commands", daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self._gone = True
        self._calls.close()
        self._urgent.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(CLOSE_S)

    # --- what the engine reads ---------------------------------------------------------------

    @property
    def trip(self) -> Trip | None:
        """As of the last heartbeat."""
        return self._status.trip

    @property
    def error(self) -> Error | None:
        """As of the last heartbeat."""
        return None if self._status.error is None else Error(self._status.error)

    def engine_heartbeat(self) -> None:
        """The engine lives; and what is new."""
        try:
            self._status = self.call("status")
            self.jumped = self.jumped or self._status.jumped
        except DeviceFault as fault:
            trip = self._status.trip or Trip(self._status.seen_s, fault.device, fault.reason, False)
            out = (True, False, fault.reason)
            self._status = Status(trip, None, self._status.seen_s, 0.0, out, homed=True)

    def seen_s(self) -> float:
        """As of the last heartbeat."""
        return self._status.seen_s

    def force_n(self) -> float:
        """As of the last heartbeat."""
        return self._status.force_n

    def levels(self, from_s: float) -> Levels:
        """As `SafetyMonitor.levels`."""
        found: Levels = self.call("levels", from_s)
        return found

    def collect(self) -> list[tuple[str, Block]]:
        """As `SafetyMonitor.collect`; nothing from a process that is gone."""
        try:
            found: list[tuple[str, Block]] = self.call("collect")
        except DeviceFault:
            return []
        return found

    # --- what the engine does ----------------------------------------------------------------

    def start(self, *, homes: bool = False) -> None:
        """As `SafetyMonitor.start`, and start the sensors."""
        self._status = self.call("start", homes)

    def finish(self) -> None:
        """End the guards."""
        with suppress(DeviceFault):
            self.call("finish")

    def step(self) -> None:
        """Nothing: the other process steps by itself."""

    def move(self, target: Pose, speed_m_s: float) -> None:
        """As `SafetyMonitor.move`."""
        self.call("move", target, speed_m_s)

    def moving(self) -> bool:
        """As `SafetyMonitor.moving`."""
        return bool(self.call("moving"))

    def pose(self) -> Pose:
        """As `SafetyMonitor.pose`."""
        return Pose(*self.call("pose"))

    def arrived(self, pose: Pose) -> None:
        """As `SafetyMonitor.arrived`."""
        self.call("arrived", pose)

    def tare(self) -> None:
        """As `SafetyMonitor.tare`."""
        self.call("tare")

    def home(self) -> "RemoteHoming":
        """As `SafetyMonitor.home`."""
        self.call("home")
        return RemoteHoming(self)

    def leave(self, *, lift: bool) -> "RemoteRetreat":
        """As `SafetyMonitor.leave`."""
        with suppress(DeviceFault):  # the next heartbeat says what is wrong
            self._status = self.call("leave", lift)
        return RemoteRetreat(self)

    def stay(self) -> None:
        """Do not lift any more."""
        with suppress(DeviceFault):
            self.call("stay")

    def go_on(self) -> None:
        """As `SafetyMonitor.go_on`."""
        self.call("go_on")

    def status(self) -> Status:
        """As of the last heartbeat."""
        return self._status

    # --- the line ----------------------------------------------------------------------------

    def _open(self, order: Order) -> Facts:
        try:
            self._calls.send(order)
            answer = self._calls.recv()
        except (EOFError, OSError):
            self._process.wait()
            raise DeviceFault("guard", "the process that guards did not come up") from None
        if isinstance(answer, BaseException):
            self._process.wait()
            raise answer
        facts: Facts = answer
        return facts

    def call(self, name: str, *arguments: Any) -> Any:
        """What `Service` answers to ``name``. Raises `DeviceFault`, also when it is gone."""
        with self._lock:
            if self._gone:
                raise DeviceFault("guard", GONE)
            try:
                self._calls.send((name, arguments))
                if not self._calls.poll(ANSWER_S):
                    raise DeviceFault("guard", f"no answer to {name} within {ANSWER_S:g} s")
                done, answer = self._calls.recv()
            except (EOFError, OSError):
                self._gone = True
                raise DeviceFault("guard", GONE) from None
        if not done:
            raise answer
        return answer

    def stop(self) -> None:
        """Stop the stage now."""
        with suppress(OSError):
            self._urgent.send(None)

    def _pass_on(self) -> None:
        """The user's command goes over whatever the engine is doing."""
        sent = RunCommand.RESUME
        while not self._gone:
            if (command := self._control.command) > sent and command >= RunCommand.ABORT:
                sent = command
                with suppress(OSError):
                    self._urgent.send(command)
            time.sleep(COMMAND_LOOK_S)


class RemoteStage:
    """What the engine knows of a stage in the other process: it moves by the monitor only."""

    def __init__(self, facts: Facts, client: GuardClient) -> None:
        self.name, self.simulated = facts.stage, facts.simulated
        self.turns, self.homes = facts.turns, facts.homes
        self._client = client

    @property
    def pace(self) -> float:
        """As `drivers.core.abilities.pace`."""
        return self._client.status().pace

    def enable(self) -> list[str]:
        """As `drivers.core.abilities.enable`."""
        return list(self._client.call("enable"))

    def unreachable(self, poses: list[Pose]) -> list[Pose]:
        """As `drivers.core.abilities.unreachable`."""
        return list(self._client.call("unreachable", poses))

    def stop(self) -> None:
        """Past all calls that wait for an answer."""
        self._client.stop()

    def connect(self) -> None:
        """It is."""

    def pose(self) -> Pose:
        """Only by the monitor."""
        raise NotImplementedError

    def move(self, target: Pose, speed_m_s: float) -> None:
        """Only by the monitor."""
        raise NotImplementedError

    def moving(self) -> bool:
        """Only by the monitor."""
        raise NotImplementedError

    def close(self) -> None:
        """With the other process."""


class RemoteSensor:
    """What the engine knows of a sensor in the other process: the monitor reads it."""

    def __init__(self, facts: SensorFacts) -> None:
        self.name, self.channels, self.rate_hz = facts.name, facts.channels, facts.rate_hz

    def connect(self) -> None:
        """It is."""

    def start(self) -> None:
        """With the monitor."""

    def read(self) -> Block:
        """Only by the monitor."""
        raise NotImplementedError

    def tare(self) -> None:
        """Only by the monitor."""
        raise NotImplementedError

    def stop(self) -> None:
        """With the monitor."""

    def close(self) -> None:
        """With the other process."""


class RemoteRetreat:
    """The way out in the other process, as of the last heartbeat."""

    def __init__(self, client: GuardClient) -> None:
        self._client = client

    @property
    def done(self) -> bool:
        """The stage rests, lifted or not."""
        out = self._client.status().leaving
        return out is not None and out[0]

    @property
    def lifting(self) -> bool:
        """It was commanded to lift."""
        out = self._client.status().leaving
        return out is not None and out[1]

    @property
    def why_not(self) -> str | None:
        """Why the tip is not up."""
        out = self._client.status().leaving
        return None if out is None else out[2]

    def stay(self) -> None:
        """Do not lift (any more)."""
        self._client.stay()


class RemoteHoming:
    """The homing in the other process, as of the last heartbeat."""

    def __init__(self, client: GuardClient) -> None:
        self._client = client

    def is_set(self) -> bool:
        """It is over."""
        return self._client.status().homed

    def wait(self, seconds: float) -> None:
        """Let it go on, and look."""
        time.sleep(seconds)
        self._client.engine_heartbeat()
