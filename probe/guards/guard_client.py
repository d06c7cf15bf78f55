"""The scan's side of the process that has the devices: what the engine sees of both.

It answers as a `SafetyMonitor` does. When the other process dies or hangs, one more takes its
devices over, stops the stage and lifts the probe; the scan ends there. When that dies too, nothing
here can reach the stage any more, and the scan says so.
"""

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, Self

from drivers import Block, ConfigError, DeviceFault, Pose
from probe.guards.commands import Control, RunCommand
from probe.guards.device_facts import Facts
from probe.guards.guard_process import Order
from probe.guards.interface import Guards, Status, WayOut
from probe.guards.interruption import Trip

ANSWER_S = 20.0  # longer than any call takes: a tare, or a stage that hangs
COMMAND_LOOK_S = 0.005
CLOSE_S = 70.0  # it may still be lifting the probe
STATUS_S = 5.0  # a status is at hand: a process that does not report it hangs
LONG_S = 1.0  # most answers take milliseconds; who takes longer is asked whether it lives
LIVES_S = STATUS_S - LONG_S
POSE_S = 0.5  # an arm's driver gives its controller 0.3 s for the questions about one pose
OPEN_S = 30.0  # to take the devices over: imports on a busy machine, and an arm's program
GONE = "the process that guards has ended: the probe may be in the tissue, look at it"
DIED = "the process that guarded has ended; another took the devices over, to lift the probe"
SPARE = 9  # descriptors that a process takes to start: its three lines, and subprocess' own three
BODY = "from probe.guards.guard_process import main; main()"


class GuardClient:
    """A `SafetyMonitor` in a process of its own, with the devices of ``order``: `Guards`.

    Raises what `probe.config.devices.connect` raises, and `DeviceFault` if the process does not
    come up.
    """

    threaded = True

    def __init__(self, order: Order, control: Control) -> None:
        self._control = control
        self._order = order
        self._homing = self._replaced = self._closing = False
        self._lock = threading.Lock()
        self._gone = False
        self._asked = 0
        self._launch()
        self.facts = self._open(order, None)
        self._spare = [os.open(os.devnull, os.O_RDONLY) for _ in range(SPARE)]
        self._status = Status(None, None, order.clock.now(), 0.0)
        threading.Thread(target=self._pass_on, name="palpate commands", daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self._gone = self._closing = True
        self._close_lines()
        self._close_spare()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(CLOSE_S)

    def __getattr__(self, name: str) -> Any:
        """What the monitor itself answers."""
        if name not in vars(Guards):
            raise AttributeError(name)
        return partial(self.call, name)

    def ready(self, poses: Sequence[Pose]) -> list[str]:
        """As `SafetyMonitor.ready`."""
        wait_s = self.facts.stage.enable_s + POSE_S * len(poses)
        return list(self.call("ready", poses, extra_s=wait_s))

    def look(self) -> Status:
        """As `SafetyMonitor.look`; of a process that is gone, what it said last."""
        try:
            self._status = self.call("look")
            self._homing = self._homing and not self._status.homed
        except DeviceFault as fault:
            if self._gone:  # else another took over, and has said how things stand
                seen_s = self._status.seen_s
                trip = self._status.trip or Trip(seen_s, fault.device, fault.reason, False)
                out = WayOut(done=True, why_not=fault.reason)
                self._status = Status(trip, None, seen_s, 0.0, out, homed=True)
        return self._status

    def collect(self) -> list[tuple[str, Block]]:
        """As `SafetyMonitor.collect`; nothing from a process that is gone, nor from the one that
        took over: its sensors are not tared."""
        with suppress(DeviceFault):
            return [] if self._replaced else list(self.call("collect"))
        return []

    def finish(self) -> None:
        """End the guards."""
        with suppress(DeviceFault):
            self.call("finish")

    def home(self) -> None:
        """As `SafetyMonitor.home`."""
        self._homing = True
        self.call("home")

    def leave(self, *, lift: bool) -> Status:
        """As `SafetyMonitor.leave`."""
        with suppress(DeviceFault):  # the next look says what is wrong
            self._status = self.call("leave", lift=lift)
        return self._status

    def stop(self) -> None:
        """Stop the stage now, past all calls that wait for an answer."""
        with suppress(OSError):
            self._urgent.send(None)

    # --- the line ----------------------------------------------------------------------------

    def _launch(self) -> None:
        """A process, and the lines to it."""
        ours, theirs = zip(*(socket.socketpair() for _ in range(3)), strict=True)
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
        self._calls, self._urgent, self._life = (Connection(end.detach()) for end in ours)

    def _close_lines(self) -> None:
        for line in (self._calls, self._urgent, self._life):
            line.close()

    def _close_spare(self) -> None:
        """Make room for another process where the scan has no descriptors left."""
        while self._spare:
            os.close(self._spare.pop())

    def _open(self, order: Order, within_s: float | None) -> Facts:
        try:
            self._calls.send(order)
            if not self._calls.poll(within_s):
                raise DeviceFault("guard", "the process that guards did not come up")
            answer = self._calls.recv()
        except (EOFError, OSError):
            self._process.wait()
            raise DeviceFault("guard", "the process that guards did not come up") from None
        if isinstance(answer, BaseException):
            self._process.wait()
            raise answer
        facts: Facts = answer
        return facts

    def call(self, name: str, *arguments: Any, extra_s: float = 0.0, **keywords: Any) -> Any:
        """What `Service` answers to ``name``, which may take ``extra_s`` longer than others.

        Raises `DeviceFault`, also when it is gone.
        """
        with self._lock:
            if self._gone:
                raise DeviceFault("guard", GONE)
            try:
                done, answer = self._ask(name, *arguments, extra_s=extra_s, **keywords)
            except (EOFError, OSError):
                self._replace()
                raise DeviceFault("guard", DIED) from None
        if not done:
            raise answer
        return answer

    def _ask(
        self, name: str, *arguments: Any, extra_s: float = 0.0, **keywords: Any
    ) -> tuple[bool, Any]:
        """Raises `EOFError` or `OSError` where nobody answers any more.

        An answer carries its call's number: one that came too late is not the next call's.
        """
        self._asked += 1
        self._calls.send((self._asked, name, arguments, keywords))
        within_s = STATUS_S if name == "look" else ANSWER_S + extra_s
        until_s = time.monotonic() + within_s
        number, done, answer = 0, False, None
        while number != self._asked:
            if not self._answers(until_s):
                if name != "look":
                    raise DeviceFault("guard", f"no answer to {name} within {within_s:g} s")
                self._process.kill()
            number, done, answer = self._calls.recv()
        return done, answer

    def _answers(self, until_s: float) -> bool:
        """Whether it does until then; one that does not even echo hangs, and is ended."""
        while not self._calls.poll(max(min(LONG_S, until_s - time.monotonic()), 0.0)):
            if time.monotonic() >= until_s:
                return False
            if not self._lives():
                self._process.kill()
        return True

    def _lives(self) -> bool:
        """Its interpreter runs, whatever its devices and guards are waiting for."""
        with suppress(EOFError, OSError):
            while self._life.poll():
                self._life.recv()
            self._life.send(None)
            return self._life.poll(LIVES_S)
        return False

    def _replace(self) -> None:
        """Once: another process opens the devices, stops the stage and lifts.

        Where that fails, as a sensor is gone too, one more does so with the stage alone: to lift it
        needs no force.
        """
        first, self._gone = not self._replaced, True
        if self._closing or not first:
            return
        self._replaced = True
        enable_s = self.facts.stage.enable_s
        alone = replace(self._order, rig=self._order.rig.model_copy(update={"sensor": ()}))
        failed: Exception | None = None
        for order in (self._order, alone):
            self._process.kill()  # one that hangs still has the devices
            self._process.wait()
            self._close_lines()
            self._close_spare()
            try:
                self._launch()
                self._open(order, OPEN_S + enable_s)
                done, answer = self._ask("take_over", DIED, not self._homing, extra_s=enable_s)
            except (EOFError, OSError, DeviceFault, ConfigError) as error:
                failed = failed or error
                continue
            if done:
                self._status, self._gone = answer, False
            return
        raise DeviceFault("guard", f"{GONE} ({failed})")

    def _pass_on(self) -> None:
        """The user's command goes over whatever the engine is doing."""
        sent = RunCommand.RESUME
        while not self._closing:
            if self._process.poll() is not None:
                self.look()  # also where the engine is busy: the probe is lifted
            if self._gone:
                return
            if (command := self._control.command) > sent and command >= RunCommand.ABORT:
                sent = command
                with suppress(OSError):
                    self._urgent.send(command)
            time.sleep(COMMAND_LOOK_S)
