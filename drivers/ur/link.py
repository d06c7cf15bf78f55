"""One robot: the client's process, the newest state, commands with deadlines.

A stage and a sensor on the same host share one link; it closes with its last user. A link reads;
control is taken when a stage is enabled.
"""

import math
import select
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import wait
from typing import Any

from drivers.core.child import Child
from drivers.core.errors import ConfigError, DeviceAbsent, DeviceFault
from drivers.ur.alone import Lift
from drivers.ur.client import NO_ANSWER, PLAYING, READY, Control, State, serve
from drivers.ur.dashboard import CLOSE_BRAKES, END_PROGRAM, IS_REMOTE, tell
from drivers.ur.settings import CONNECT_S
from drivers.ur.stops import (
    HALTED,
    LOCAL,
    PROGRAM_RUNS,
    SAFETY_STOPS,
    STOPPED,
    UNHEARD,
    why_stopped,
)
from drivers.ur.version import ask_version, check_control

FIRST_S = 1.0
COMMAND_S = 0.5
RECENT_S = 0.1
MOVED_M = 20e-6  # within `RECENT_S`: more than a pose changes at rest
LONGEST_S = 20.0  # of samples kept for a reader that is late


class Link:
    """A running client. `Link.state` raises what is wrong instead of giving an old state.

    ``rate_hz`` is what the controller sends at.
    """

    def __init__(
        self, name: str, host: str, rate_hz: float | None, silence_s: float, connect_s: float
    ) -> None:
        self.controller = ask_version(name, host)
        fastest_hz = self.controller.fastest_hz
        if rate_hz is not None and rate_hz > fastest_hz:
            raise DeviceAbsent(
                name, f"{rate_hz:g} Hz: this controller ({self.controller.described}) sends up to "
                f"{fastest_hz:g}; leave the key out"
            )  # fmt: skip
        self.name = name
        self.host = host
        self.silence_s = silence_s
        self._connect_s = connect_s
        self.rate_hz = fastest_hz if rate_hz is None else rate_hz
        self.users = 0
        self.controls = False
        self._lock = threading.Lock()
        self._fresh = threading.Condition()
        self._state: State | None = None
        self._samples: deque[State] = deque(maxlen=int(LONGEST_S * self.rate_hz))
        self._recent: deque[State] = deque(maxlen=int(RECENT_S * self.rate_hz) + 2)
        self._answers: dict[int, tuple[bool, Any]] = {}
        self._number = READY
        self._gone = ""
        self._starting = False
        self._halted = self._ended_by_us = False
        self._remote: bool | None = None
        self._child = Child(serve, (host, self.controller, self.rate_hz), pipes=2)
        self._states, self._commands = self._child.pipes
        self._thread = threading.Thread(target=self._follow, name=f"palpate {name}", daemon=True)
        self._thread.start()
        ready, why = self._answer(READY, connect_s)
        if not ready or not self._first():
            self._fail(why or "no data")

    def take_control(self, setup: Control, *, replace_program: bool) -> dict[str, Any]:
        """Upload the control program; what then holds. Raises `DeviceFault`.

        A program of somebody else's is left alone unless ``replace_program``.
        """
        if self.controls and self._runs():
            return {}
        controlled, self.controls = self.controls, False
        state = self.state()
        if state.runtime_state in PROGRAM_RUNS and not replace_program:
            raise DeviceFault(
                self.name, "another program runs on the robot; stop it on the pendant, or let this "
                "scan end it: replace_program = true"
            )  # fmt: skip
        check_control(self.name, self.host, self.controller)
        with self._silent_while_starting():
            done, found = self._answer(self._send("take control", (setup,)), self._connect_s)
        with self._fresh:
            self._recent.clear()  # where the arm went before is not what this program does
        if not done:
            self.controls = controlled  # what was ours may be tried again
            self.state()  # says more than the library does
            raise DeviceFault(self.name, str(found) or "its control program does not start")
        with self._fresh:  # a state from after the program's start; the next line says if none came
            self._fresh.wait_for(lambda: bool(self._gone) or self._runs(), COMMAND_S)
        self.controls, self._halted, self._ended_by_us = True, False, False
        self._remote = None
        self.state()
        return dict(found)

    def program_ended_by_us(self) -> bool:
        """True where the robot is ready to move but for our program, which ended since the robot
        heard nothing of us for too long, or since we had it ended; not where a person may have."""
        state = self._state
        able = state is not None and why_stopped(state, controls=False) is None
        return self.controls and able and not self._runs() and self._ended_by_us

    def lost_in_control(self) -> bool:
        """True where the connection was cut while our program ran on a robot that was able to move;
        the robot's watchdog then ends the program."""
        state = self._state
        able = state is not None and why_stopped(state, controls=False) is None
        ours = self._runs() or self._ended_by_us
        return bool(self._gone) and self.controls and able and ours

    def state(self) -> State:
        """The newest. Raises `DeviceFault` when it is old, or the robot is not able to work."""
        state = self._state
        if self._gone or state is None:
            raise DeviceFault(self.name, f"connection lost: {self._gone or 'not connected'}")
        age_s = time.monotonic() - state.arrival_s
        if age_s > self.silence_s:
            allowed = f"silence_s = {self.silence_s:g}; a busy machine may need more"
            why = f"the robot has sent nothing for {age_s:.2f} s; allowed: {allowed}"
            raise DeviceFault(self.name, why)
        if (words := why_stopped(state, controls=self.controls)) is not None:
            raise DeviceFault(self.name, self._who_ended_it() if words == STOPPED else words)
        return state

    def newest(self) -> State | None:
        """The newest one, whatever is wrong; None before the first."""
        return self._state

    def earlier(self, by_s: float) -> State | None:
        """The state that was ``by_s`` before the newest, None if that is not known (yet)."""
        with self._fresh:
            newest = self._recent[-1].timestamp_s if self._recent else -math.inf
            old = [s for s in self._recent if s.timestamp_s <= newest - by_s]
        return old[-1] if old else None

    def samples(self, timeout_s: float) -> list[State]:
        """All states since the last call, waiting for one. Raises `DeviceFault` when lost."""
        with self._fresh:
            if not self._samples:
                self._fresh.wait(timeout_s)
            taken = list(self._samples)
            self._samples.clear()
        if not taken and not self._starting:
            self.state()
        return taken

    def command(self, name: str, *arguments: Any, timeout_s: float = COMMAND_S) -> Any:
        """Have a command obeyed; its answer. Raises `DeviceFault` if refused, or late."""
        done, found = self._answer(self._send(name, arguments), timeout_s)
        if not done:
            self.state()  # says more than the library does
            why = (f": {found}" if found else "") + "; does another program run on the robot?"
            raise DeviceFault(self.name, f"{name} refused{why}")
        return found

    def guarded(self) -> None:
        """Whoever checks the force has just done so: from now on only this keeps the robot's
        watchdog content."""
        with suppress(DeviceFault):  # the next state says it
            self._send("guarded", (), number=NO_ANSWER)

    def lift_when_alone(self, lift: Lift) -> None:
        """What the client does where this process has died."""
        with suppress(DeviceFault):  # the next state says it
            self._send("lift when alone", (lift,), number=NO_ANSWER)

    def stop(self, deceleration_m_s2: float, within_s: float) -> None:
        """Have the program halt the arm; one that has not answered ``within_s`` is ended. Never
        raises."""
        if not self.controls:
            return
        with suppress(DeviceFault):
            done, _ = self._answer(self._send("stop", (deceleration_m_s2,)), within_s)
            if done:
                return
        self.end_program()

    def end_program(self) -> None:
        """By the dashboard. One that has ended already was ended by somebody else, and somebody
        else's is left alone; where nothing is heard, it may still run."""
        if self.controls and (self._gone or self._state is None or self._may_run()):
            self._halted = self._runs()
            tell(self.host, END_PROGRAM)

    def close_brakes(self) -> None:
        """By the dashboard."""
        if self.controls:
            tell(self.host, CLOSE_BRAKES)

    def rests(self) -> bool:
        """The program runs, and the arm is seen at rest: a program that was started again for the
        lift is not ended by the stop that ended the one before."""
        return self._runs() and self._way_m() < MOVED_M

    def moves(self) -> bool:
        """The arm is seen to move, whatever runs."""
        return MOVED_M < self._way_m() < math.inf

    def _way_m(self) -> float:
        """How far the tip went over `RECENT_S`; infinite where nothing was heard lately."""
        with self._fresh:
            recent = [state for state in (*self._recent, self._state) if state is not None]
        now_s = time.monotonic()
        if self._gone or not recent or now_s - recent[-1].arrival_s > self.silence_s:
            return math.inf
        first = next(s for s in recent if recent[-1].arrival_s - s.arrival_s <= RECENT_S)
        return math.dist(first.pose[:3], recent[-1].pose[:3])

    def close(self) -> None:
        """End the client, by force if it does not end by itself; it lifts nothing."""
        with suppress(DeviceFault):
            self._send("farewell", (), number=NO_ANSWER)
        self._gone = self._gone or "closed"
        self._child.end(timeout_s=1.5)
        self._thread.join(timeout=1.0)

    @contextmanager
    def _silent_while_starting(self) -> Iterator[None]:
        """The library locks the interpreter of its process while it waits for its program."""
        self._starting = True
        try:
            yield
        finally:
            self._starting = False

    def _runs(self) -> bool:
        return self._state is not None and self._state.runtime_state == PLAYING

    def _may_run(self) -> bool:
        return self._state is not None and self._state.runtime_state in PROGRAM_RUNS

    def _who_ended_it(self) -> str:
        """In words; whether the pendant has taken over is asked once after each end."""
        if self._ended_by_us:
            return HALTED if self._halted else UNHEARD
        if self._remote is None:
            self._remote = tell(self.host, IS_REMOTE) != "false"
        return STOPPED if self._remote else LOCAL

    def _fail(self, why: str) -> None:
        """Give up connecting, in the robot's words if it has any."""
        words = None if self._state is None else SAFETY_STOPS.get(self._state.safety_mode)
        self.close()
        raise DeviceAbsent(self.name, f"no connection to {self.host}: {words or why}")

    def _send(self, name: str, arguments: tuple[Any, ...], number: int | None = None) -> int:
        with self._lock:
            if number is None:
                self._number += 1
                number = self._number
            try:
                # Never waits: a client that hangs in the library leaves hundreds unread.
                if not select.select((), (self._commands,), (), 0)[1]:
                    raise DeviceFault(self.name, "the robot's client takes no commands")
                self._commands.send((number, name, arguments))
            except (OSError, ValueError):
                why = self._gone or "the robot's client has ended"
                raise DeviceFault(self.name, f"connection lost: {why}") from None
            return number

    def _answer(self, number: int, timeout_s: float) -> tuple[bool, Any]:
        with self._fresh:
            answered = self._fresh.wait_for(
                lambda: number in self._answers or bool(self._gone), timeout_s
            )
            if number in self._answers:
                return self._answers.pop(number)
        return False, self._gone or ("" if answered else f"no answer within {timeout_s:g} s")

    def _first(self) -> bool:
        with self._fresh:
            return self._fresh.wait_for(lambda: self._state is not None, FIRST_S)

    def _follow(self) -> None:
        """Take in what the client sends until it ends."""
        try:
            while True:
                for pipe in wait([self._states, self._commands]):
                    got: Any = self._states.recv() if pipe is self._states else None
                    message: Any = self._commands.recv() if pipe is self._commands else None
                    with self._fresh:
                        if got is not None:
                            self._samples.extend(got)
                            self._recent.extend(got)
                            self._take(got)
                        if message is not None:
                            self._answers[message[0]] = message[1:]
                        self._fresh.notify_all()
        except (EOFError, OSError):
            with self._fresh:
                self._gone = self._gone or "cut, or the library's client has crashed"
                self._fresh.notify_all()

    def _take(self, states: list[State]) -> None:
        for state in states:
            if self._runs() and state.runtime_state != PLAYING:
                able = why_stopped(state, controls=False) is None
                self._ended_by_us = able and (self._halted or state.starved)
            self._state = state


_links: dict[str, Link] = {}
_opening = threading.Lock()


def take_link(
    name: str, host: str, rate_hz: float | None, silence_s: float, connect_s: float = CONNECT_S
) -> Link:
    """The link to a host, opened by the first user. Raises `DeviceAbsent`, or `ConfigError` where
    it is open at another rate."""
    with _opening:
        link = _links.get(host)
        if link is None:
            link = _links[host] = Link(name, host, rate_hz, silence_s, connect_s)
        elif rate_hz not in (None, link.rate_hz):
            raise ConfigError(
                f"{name}: {rate_hz:g} Hz, but {link.name} has opened {host} at "
                f"{link.rate_hz:g} Hz: one robot sends at one rate"
            )
        link.users += 1
        return link


def renew_link(lost: Link, connect_s: float) -> Link:
    """A new one to the same robot. Raises `DeviceAbsent`: then the lost one is still the caller's.

    Others who use the lost one keep it, and its fault.
    """
    with _opening:
        if _links.get(lost.host) is lost:
            del _links[lost.host]
    link = take_link(lost.name, lost.host, lost.rate_hz, lost.silence_s, connect_s)
    leave_link(lost)
    return link


def leave_link(link: Link) -> None:
    """Close it if nobody else uses it."""
    with _opening:
        link.users -= 1
        if link.users <= 0:
            if _links.get(link.host) is link:
                del _links[link.host]
            link.close()
